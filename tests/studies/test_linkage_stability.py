"""The study ``linkage-stability``: its oracles by other means, and faults that it must catch."""

import dataclasses
import functools

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.optimize

from designopt import Records
from designopt.study.report import Report
from designopt.study.runner import run_study
from studies.oracles import linkages as exact
from studies.oracles import six_bar
from studies.stability.linkage import StabilitySpec, cases, mechanisms
from studies.stability.linkage.run import assess, judge, report

MECHANISMS = {
    "four-bar": (mechanisms.four_bar, cases.four_bars, cases.random_four_bars),
    "slider-crank": (mechanisms.slider_crank, cases.slider_cranks, cases.random_slider_cranks),
}


@pytest.fixture(scope="module", params=list(MECHANISMS))
def feasible(request):
    """A mechanism with random cases that can be assembled, well inside their limits."""
    make, _, draw = MECHANISMS[request.param]
    mechanism, (_, inputs, sides) = make(), draw("float64", 400, 1.0, seed=3)
    found = mechanism.formula.pin(exact.extended(inputs), sides)
    inside = np.flatnonzero(found.margin > 0.05 * found.size)[:12]
    return mechanism, inputs[inside], sides[inside]


def test_pins_satisfy_the_lengths(feasible):
    """The oracle's positions against distances alone, in 50 digits, and in extended floats."""
    mechanism, inputs, sides = feasible
    fast = mechanism.formula.pin(exact.extended(inputs), sides)
    with mpmath.workdps(50):
        x = exact.digits(inputs)
        found = mechanism.formula.pin(x, sides)
        crank = x[:, mechanism.formula.inputs.index("crank")]
        a = x[:, :2] + crank[:, None] * exact.direction(x[:, -1]).T
        assert np.max(mechanism.formula.gaps(x, a, found.value)) < 1e-40
        # Other dimensions are missed by these pins, whichever it is; A has the angle in it.
        for column, name in enumerate(mechanism.formula.inputs[:-1]):
            other = x.copy()
            other[:, column] = x[:, column] + mpmath.mpf("1e-4")
            assert np.min(mechanism.formula.gaps(other, a, found.value)) > 1e-10, name
    for name in ("value", "gradient", "margin", "size"):
        slow, quick = (getattr(one, name).astype(float) for one in (found, fast))
        np.testing.assert_allclose(quick, slow, rtol=1e-14, atol=1e-14)


def test_gradients_are_central_differences(feasible):
    mechanism, inputs, sides = feasible

    def pin(*row, axis):
        return mechanism.formula.pin(np.array([row], object), sides[:1]).value[0, axis]

    with mpmath.workdps(50):
        row = exact.digits(inputs[:1])
        found = mechanism.formula.pin(row, sides[:1]).gradient[0]
        for (axis, entry), slope in np.ndenumerate(found):
            order = tuple(int(entry == other) for other in range(row.size))
            expected = mpmath.diff(functools.partial(pin, axis=axis), list(row[0]), n=order)
            assert abs(slope - expected) < 1e-20


def test_gradient_scale_is_that_of_second_derivatives():
    """x₁ sin x₂ has the second derivatives 0, cos x₂ and −x₁ sin x₂."""

    def pin(inputs, _):
        first, angle = inputs.T
        slopes = np.stack([exact.sin(angle), first * exact.cos(angle)], axis=1)
        value = np.stack([first * exact.sin(angle)] * 2, axis=1)
        return exact.Exact(value, np.stack([slopes, slopes], axis=1), first, first)

    with mpmath.workdps(50):
        x, side = exact.digits(np.array([[3.0, 0.7]])), np.ones(1)
        formula = exact.Formula(("first", "angle"), pin, "", "", ())
        scale = exact.gradient_scale(formula, x, abs(x), side, pin(x, side))
    sine, cosine = np.sin(0.7), np.cos(0.7)
    expected = [sine + 0.7 * cosine, 3 * cosine + 3 * cosine + 0.7 * 3 * sine]
    np.testing.assert_allclose(scale.astype(float)[0], expected, rtol=1e-14)


def test_the_six_bars_oracle_agrees_with_scipy():
    """P from six lengths alone, solved by SciPy from the oracle's neighbourhood, and its slopes."""
    mechanism, oracle = mechanisms.six_bar()
    row = mechanism.sketched_row()

    def place_p(row):
        d = row[4:6] + row[12] * np.array([np.cos(row[13]), np.sin(row[13])])
        beyond = np.hypot(row[7] - row[8], row[9])  # from B to P

        def gaps(places):
            a, b, p = places.reshape(3, 2)
            pairs = ((a, row[:2]), (b, row[2:4]), (a, b), (a, p), (b, p), (p, d))
            lengths = (row[6], row[10], row[7], np.hypot(row[8], row[9]), beyond, row[11])
            return [
                np.hypot(*(one - other)) - long
                for (one, other), long in zip(pairs, lengths, strict=True)
            ]

        start = [4, 45.5, 72.4, 57.8, 49.4, 94.5]
        return scipy.optimize.least_squares(gaps, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x[4:]

    moved = row.copy()
    moved[-1] += 0.3
    found = oracle(exact.digits(moved[None]), np.ones(1))
    np.testing.assert_allclose(found.value[0].astype(float), place_p(moved), rtol=1e-10)
    for entry in range(len(row)):
        step = 1e-4 * (np.arange(len(row)) == entry)
        slope = (place_p(moved + step) - place_p(moved - step)) / 2e-4
        np.testing.assert_allclose(found.gradient[0, :, entry].astype(float), slope, atol=1e-6)


def test_the_six_bar_locks_where_its_determinant_vanishes():
    mechanism, oracle = mechanisms.six_bar()
    sketched = mechanism.sketched_row()
    row = oracle.locking(sketched, cases.LONG_CRANK)
    follower = oracle.follower(tuple(row[:-1].tolist()))
    assert follower.lock is not None
    left = np.array([1e-2, 1e-4, 1e-6, 1e-8])
    rows = np.repeat(row[None], len(left), axis=0)
    rows[:, -1] = [float(follower.lock - some) for some in left]
    found = oracle(exact.digits(rows), np.ones(len(left)))
    np.testing.assert_allclose(found.margin.astype(float), left, rtol=1e-6)
    # A fold: the speed of P grows as the inverse root of what is left.
    speed = np.hypot(*found.gradient[:, :, -1].astype(float).T) * np.sqrt(left)
    np.testing.assert_allclose(speed, speed[-1], rtol=0.2)
    # The gallery's own crank turns fully, and comes back to where it began.
    own = oracle.follower(tuple(sketched[:-1].tolist()))
    assert own.lock is None
    assert len(own.poses) == int(np.ceil(2 * np.pi / six_bar.STEP))
    assert np.max(abs(own.poses[-1] - own.poses[0])) < 1


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("name", MECHANISMS)
def test_margins_of_the_families_are_as_named(name, dtype):
    make, families, _ = MECHANISMS[name]
    for case, inputs, sides in families(dtype, 16):
        assert inputs.dtype == dtype
        with mpmath.workdps(50):
            found = make().formula.pin(exact.digits(inputs), sides)
        size = np.where(found.size == 0, 1, found.size)
        margin = (found.margin / size).astype(float)
        if "margin 1e-1 to" in case or "margin −1e-1 to" in case:
            # Of `cases.SIZE`; other lengths of the linkage may be larger.
            expected = np.logspace(-1, -16, 16) * cases.SIZE / size.astype(float)
            expected *= -1 if "−" in case else 1
            np.testing.assert_allclose(margin, expected, rtol=1e-3, atol=2 * np.finfo(dtype).eps)
        if "tangent" in case:
            np.testing.assert_array_equal(margin, 0.0)


def judged(mechanism, inputs, sides, *, oracle=None, **changed):
    solved = mechanisms.solve(mechanism, inputs, sides)._replace(**changed)
    return judge(oracle or mechanism, inputs, sides, solved)


FAULTS = {
    "value_error": lambda right: {"value": right.value * (1 + 1e-12)},
    "gradient_error": lambda right: {"gradient": right.gradient * (1 + 1e-10)},
    "wrong_verdict": lambda right: {"margin": -right.margin},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_solve_that_differs_from_the_oracle_fails(feasible, fault):
    mechanism, inputs, sides = feasible

    def pin(*arguments):
        right = mechanism.formula.pin(*arguments)
        return right._replace(**FAULTS[fault](right))

    other = dataclasses.replace(mechanism, formula=mechanism.formula._replace(pin=pin))
    result = judged(mechanism, inputs, sides, oracle=other)
    assert np.all(result["failed"])
    limit = {"value_error": 64, "gradient_error": 1024}.get(fault, 0) * np.finfo(float).eps
    assert np.all(result[fault] > limit)


def test_injected_faults_of_the_answers_are_counted(feasible):
    mechanism, inputs, sides = feasible
    solved = mechanisms.solve(mechanism, inputs, sides)
    assert not np.any(judged(*feasible)["failed"])
    assert np.all(judge(mechanism, inputs, -sides, solved)["failed"])
    for column, changed in (
        ("open", {"crank_pin": solved.crank_pin * (1 + 1e-9)}),
        ("open", {"residual": solved.residual + 1e-11}),
        ("failed", {"value": np.full_like(solved.value, np.nan)}),
        ("non_finite", {"non_finite": np.ones(len(sides), int)}),
        ("wrong_verdict", {"ok": np.zeros(len(sides), bool)}),
    ):
        result = judged(*feasible, **changed)
        assert np.all(result[column]), column
        assert np.all(result["failed"]), column


def test_numbers_that_are_not_finite_are_counted(feasible):
    mechanism, inputs, sides = feasible
    anchors = mechanism.linkage.anchors
    broken = dataclasses.replace(
        mechanism,
        linkage=dataclasses.replace(mechanism.linkage, anchors=anchors * jnp.nan),
        leaves=lambda linkage: mechanism.leaves(linkage)[1:],
    )
    assert np.all(mechanisms.solve(broken, inputs[:2, anchors.size :], sides[:2]).non_finite > 0)


def reported(judged):
    out = Report(StabilitySpec(), package="studies.stability.linkage")
    report(out, judged)
    return out.results()


def test_findings_name_what_failed(feasible):
    good = judged(*feasible)
    found = Records({"case": "a, random", **good})
    found.add(case="b, random", **(good | {"dtype": ["float32"] * len(good)}))
    assert all(metric.met for metric in reported(found).metrics)
    wrong = {"residual": good["residual"] + 1.0, "open": good["ok"], "failed": good["ok"]}
    found.add(case="the bad one", **(good | wrong))
    results = reported(found)
    assert results.findings[-1].startswith("the bad one (float64")
    missed = {metric.name for metric in results.metrics if metric.met is False}
    assert missed == {"open_poses_float64", "worst_closure_float64", "stability_failures"}
    assert [row.failures for row in results.stability] == [0, 0, len(good)]


@pytest.mark.slow
def test_the_study_end_to_end(tmp_path):
    settings = {"random_cases": 100, "family_cases": 16, "triad": False}
    results = run_study("linkage-stability", settings, out=tmp_path / "out")
    assert not results.unmet
    for row in results.stability:
        assert (row.failures, row.non_finite) == (0, 0), row
    assert {row.dtype for row in results.stability} == {"float64", "float32"}
    cases_of = {row.case: row.cases for row in results.stability}
    assert cases_of["four-bar, random"] == cases_of["slider-crank, random"] == 100
    assert sum(cases_of.values()) * 2 == int(results.findings[0].split()[1])


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize("name", list(MECHANISMS))
def test_random_linkages_over_six_decades(name, seed):
    make, _, draw = MECHANISMS[name]
    for dtype in ("float64", "float32"):
        judged = assess(make(), [draw(dtype, 20_000, 6.0, seed)])
        assert not np.any(judged["failed"])
