"""The study ``linkage-stability``: its oracles by other means, and faults that it must catch."""

import dataclasses
import functools
import json

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.optimize

from designopt import cli
from designopt.study.results import StabilityRow
from studies.oracles import linkages as exact
from studies.stability.linkage import STUDY, cases, judging, mechanisms, triad
from studies.stability.linkage.judging import Family
from studies.stability.linkage.run import assess
from studies.stability.linkage.statements import findings, metrics

MECHANISMS = {
    "four-bar": (mechanisms.four_bar, cases.four_bars, cases.random_four_bars),
    "slider-crank": (mechanisms.slider_crank, cases.slider_cranks, cases.random_slider_cranks),
}


@pytest.fixture(scope="module", params=list(MECHANISMS))
def feasible(request):
    """A mechanism with random cases that can be assembled, well inside their limits."""
    make, _, draw = MECHANISMS[request.param]
    mechanism, drawn = make(), draw("float64", 400, 1.0, seed=3)
    found = mechanism.formula(exact.EXTENDED, exact.EXTENDED.number(drawn.inputs), drawn.sides)
    inside = np.flatnonzero(found.margin > 0.05 * found.size)[:12]
    return mechanism, drawn.inputs[inside], drawn.sides[inside]


def test_pins_satisfy_the_lengths(feasible):
    """The oracle's positions against distances alone, in 50 digits."""
    mechanism, inputs, sides = feasible
    with mpmath.workdps(50):
        x = exact.DIGITS.number(inputs)
        pin = mechanism.formula(exact.DIGITS, x, sides).value
        named = dict(zip(mechanism.inputs, x.T, strict=True))
        angle = named["angle"]
        a_x = named["o2_x"] + named["crank"] * exact.DIGITS.cos(angle)
        a_y = named["o2_y"] + named["crank"] * exact.DIGITS.sin(angle)
        link = named["coupler" if "coupler" in named else "rod"]
        gaps = [(pin[:, 0] - a_x) ** 2 + (pin[:, 1] - a_y) ** 2 - link**2]
        if "rocker" in named:
            squares = (pin[:, 0] - named["o4_x"]) ** 2 + (pin[:, 1] - named["o4_y"]) ** 2
            gaps.append(squares - named["rocker"] ** 2)
        else:
            tangent = [mpmath.tan(value) for value in named["direction"]]
            gaps.append(pin[:, 1] - named["point_y"] - tangent * (pin[:, 0] - named["point_x"]))
        assert max(float(abs(gap)) for gap in np.concatenate(gaps)) < 1e-40


def test_gradients_are_central_differences(feasible):
    mechanism, inputs, sides = feasible
    with mpmath.workdps(50):
        found = mechanism.formula(exact.DIGITS, exact.DIGITS.number(inputs[:3]), sides[:3])
        for case in range(3):
            row = list(exact.DIGITS.number(inputs[case]))

            def pin(*row, axis, side=sides[case : case + 1]):
                array = np.array([row], object)
                return mechanism.formula(exact.DIGITS, array, side).value[0, axis]

            for axis in range(2):
                for entry in range(len(row)):
                    order = tuple(int(entry == other) for other in range(len(row)))
                    slope = mpmath.diff(functools.partial(pin, axis=axis), row, n=order)
                    assert abs(slope - found.gradient[case, axis, entry]) < 1e-20


def test_extended_floats_agree_with_fifty_digits(feasible):
    mechanism, inputs, sides = feasible
    fast = mechanism.formula(exact.EXTENDED, exact.EXTENDED.number(inputs), sides)
    with mpmath.workdps(50):
        slow = mechanism.formula(exact.DIGITS, exact.DIGITS.number(inputs), sides)
    for name in ("value", "gradient", "margin", "size"):
        np.testing.assert_allclose(
            getattr(fast, name).astype(float),
            getattr(slow, name).astype(float),
            rtol=1e-14,
            atol=1e-14,
        )


def test_gradient_scale_is_that_of_second_derivatives():
    """x₁ sin x₂ has the second derivatives 0, cos x₂ and −x₁ sin x₂."""

    def formula(arithmetic, inputs, _):
        first, angle = inputs.T
        slopes = np.stack([arithmetic.sin(angle), first * arithmetic.cos(angle)], axis=1)
        value = np.stack([first * arithmetic.sin(angle)] * 2, axis=1)
        return exact.Exact(value, np.stack([slopes, slopes], axis=1), first, first)

    x = np.array([[3.0, 0.7]])
    with mpmath.workdps(50):
        numbers = exact.DIGITS.number(x)
        found = formula(exact.DIGITS, numbers, np.ones(1))
        scale = exact.gradient_scale(
            formula, exact.DIGITS, numbers, abs(numbers), np.ones(1), found
        )
    sine, cosine = np.sin(0.7), np.cos(0.7)
    expected = [sine + 0.7 * cosine, 3 * cosine + 3 * cosine + 0.7 * 3 * sine]
    np.testing.assert_allclose(scale.astype(float)[0], expected, rtol=1e-14)


def test_the_six_bars_oracle_agrees_with_scipy():
    """P from six lengths alone, solved by SciPy from the oracle's neighbourhood, and its slopes."""
    _, oracle, row = triad.six_bar()

    def place_p(row):
        d = row[4:6] + row[12] * np.array([np.cos(row[13]), np.sin(row[13])])
        beyond = np.hypot(row[7] - row[8], row[9])  # from B to P

        def gaps(places):
            a, b, p = places.reshape(3, 2)
            pairs = ((a, row[:2]), (b, row[2:4]), (a, b), (a, p), (b, p), (p, d))
            lengths = (row[6], row[10], row[7], np.hypot(row[8], row[9]), beyond, row[11])
            return [
                np.hypot(*(one - other)) - length
                for (one, other), length in zip(pairs, lengths, strict=True)
            ]

        start = [4, 45.5, 72.4, 57.8, 49.4, 94.5]
        return scipy.optimize.least_squares(gaps, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x[4:]

    moved = row.copy()
    moved[-1] += 0.3
    found = oracle(exact.DIGITS, exact.DIGITS.number(moved[None]), np.ones(1))
    np.testing.assert_allclose(found.value[0].astype(float), place_p(moved), rtol=1e-10)
    for entry in range(len(row)):
        step = 1e-4 * (np.arange(len(row)) == entry)
        slope = (place_p(moved + step) - place_p(moved - step)) / 2e-4
        np.testing.assert_allclose(found.gradient[0, :, entry].astype(float), slope, atol=1e-6)


def test_the_six_bar_locks_where_its_determinant_vanishes():
    _, oracle, _ = triad.six_bar()
    row = triad.locking_row()
    follower = oracle.follower(tuple(row[:-1].tolist()))
    assert follower.lock is not None
    left = np.array([1e-2, 1e-4, 1e-6, 1e-8])
    rows = np.repeat(row[None], len(left), axis=0)
    rows[:, -1] = [float(follower.lock - some) for some in left]
    found = oracle(exact.DIGITS, exact.DIGITS.number(rows), np.ones(len(left)))
    np.testing.assert_allclose(found.margin.astype(float), left, rtol=1e-6)
    # A fold: the speed of P grows as the inverse root of what is left.
    speed = np.hypot(*found.gradient[:, :, -1].astype(float).T) * np.sqrt(left)
    np.testing.assert_allclose(speed, speed[-1], rtol=0.2)
    # The gallery's own crank turns fully, and comes back to where it began.
    own = oracle.follower(tuple(triad.six_bar()[2][:-1].tolist()))
    assert own.lock is None
    assert len(own.poses) == int(np.ceil(2 * np.pi / triad.STEP))
    assert np.max(abs(own.poses[-1] - own.poses[0])) < 1


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("name", MECHANISMS)
def test_margins_of_the_families_are_as_named(name, dtype):
    make, families, _ = MECHANISMS[name]
    mechanism = make()
    rounding = np.finfo(dtype).eps
    for family in families(dtype, 16):
        assert family.inputs.dtype == dtype
        with mpmath.workdps(50):
            found = mechanism.formula(
                exact.DIGITS, exact.DIGITS.number(family.inputs), family.sides
            )
        size = np.where(found.size == 0, 1, found.size)
        margin = (found.margin / size).astype(float)
        if "margin 1e-1 to" in family.case or "margin −1e-1 to" in family.case:
            sign = -1 if "−" in family.case else 1
            # Of `cases.SIZE`; other lengths of the linkage may be larger.
            expected = sign * np.logspace(-1, -16, 16) * cases.SIZE / size.astype(float)
            np.testing.assert_allclose(margin, expected, rtol=1e-3, atol=2 * rounding)
        if "tangent" in family.case:
            np.testing.assert_array_equal(margin, 0.0)


def shifted(mechanism, by):
    """The mechanism with an answer that is wrong."""

    def formula(arithmetic, inputs, sides):
        return dataclasses.replace(
            right := mechanism.formula(arithmetic, inputs, sides), **by(right)
        )

    return dataclasses.replace(mechanism, formula=formula)


FAULTS = {
    "value_error": lambda right: {"value": right.value * (1 + 1e-12)},
    "gradient_error": lambda right: {"gradient": right.gradient * (1 + 1e-10)},
    "wrong_verdict": lambda right: {"margin": -right.margin},
}


def judged(mechanism, inputs, sides, *, oracle=None, **changed):
    solved = mechanisms.solve(mechanism, inputs, sides)._replace(**changed)
    return judging.judge(oracle or mechanism, inputs, sides, solved)


def test_sound_answers_pass(feasible):
    result = judged(*feasible)
    assert not np.any(result.failed)
    row = result.row("sound")
    assert isinstance(row, StabilityRow)
    assert (row.failures, row.non_finite, row.infeasible) == (0, 0, 0)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_solve_that_differs_from_the_oracle_fails(feasible, fault):
    mechanism, inputs, sides = feasible
    result = judged(mechanism, inputs, sides, oracle=shifted(mechanism, FAULTS[fault]))
    assert np.all(result.failed)
    marked = getattr(result, fault)
    limit = {"value_error": 64, "gradient_error": 1024}.get(fault, 0) * np.finfo(float).eps
    assert np.all(marked > limit)


def test_the_other_assembly_is_an_error(feasible):
    mechanism, inputs, sides = feasible
    solved = mechanisms.solve(mechanism, inputs, -sides)
    assert np.all(judging.judge(mechanism, inputs, sides, solved).failed)


def test_injected_faults_of_the_answers_are_counted(feasible):
    mechanism, inputs, sides = feasible
    solved = mechanisms.solve(mechanism, inputs, sides)
    moved = judged(*feasible, crank_pin=solved.crank_pin * (1 + 1e-9))
    assert np.all(moved.open_closure)
    assert np.all(moved.failed)
    said = judged(*feasible, residual=solved.residual + 1e-11)
    assert np.all(said.open_closure)
    absent = judged(*feasible, value=np.full_like(solved.value, np.nan))
    assert np.all(absent.failed)
    counted = judged(*feasible, non_finite=np.ones(len(sides), int))
    assert np.all(counted.failed)
    assert counted.row("").non_finite == len(sides)
    refused = judged(*feasible, ok=np.zeros(len(sides), bool))
    assert np.all(refused.wrong_verdict)


def test_numbers_that_are_not_finite_are_seen(feasible):
    mechanism, inputs, sides = feasible

    def spoiled(linkage, row):
        whole = mechanism.dimensioned(linkage, row)
        return dataclasses.replace(whole, anchors=whole.anchors / jnp.zeros_like(row[0]))

    broken = dataclasses.replace(mechanism, dimensioned=spoiled)
    assert np.all(mechanisms.solve(broken, inputs[:2], sides[:2]).non_finite > 0)


def test_findings_name_what_failed(feasible):
    good = judged(*feasible)
    bad = dataclasses.replace(good, closure=good.closure + 1.0)
    single = dataclasses.replace(good, dtype="float32")
    found = [Family("a, random", good), Family("b, random", single)]
    assert "none is answered wrongly" in findings(found)[0]
    assert all(metric.met for metric in metrics(found))
    said = findings([*found, Family("the bad one", bad)])
    assert "targets that they miss stand as missed" in said[0]
    assert said[-1].startswith("the bad one (float64")
    assert "leave gaps of up to 1.0e+00" in said[-1]
    missed = {m.name for m in metrics([*found, Family("the bad one", bad)]) if m.met is False}
    assert missed == {"open_poses_float64", "worst_closure_float64", "stability_failures"}


def quick(tmp_path, *settings):
    out = tmp_path / "out"
    arguments = [f"--set={setting}" for setting in settings]
    assert cli.run(["run", STUDY.name, "--out", str(out), *arguments]) == 0
    return out, json.loads((out / "results.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_the_study_end_to_end(tmp_path):
    out, document = quick(tmp_path, "random_cases=2000", "family_cases=16", "triad=false")
    for row in document["stability"]:
        assert (row["failures"], row["non_finite"]) == (0, 0), row
    assert {row["dtype"] for row in document["stability"]} == {"float64", "float32"}
    cases_of = {row["case"]: row["cases"] for row in document["stability"]}
    assert cases_of["four-bar, random"] == cases_of["slider-crank, random"] == 2000
    for name in ("stability", "approach", "random"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 10_000
    assert "tables/verdicts.csv" in document["tables"]
    assert sum(cases_of.values()) * 2 == int(document["findings"][0].split()[1])


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize("name", list(MECHANISMS))
def test_random_linkages_over_six_decades(name, seed):
    make, _, draw = MECHANISMS[name]
    for dtype in ("float64", "float32"):
        (family,) = assess(make(), [draw(dtype, 20_000, 6.0, seed)])
        assert not np.any(family.judged.failed), family.judged.row(family.case)


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        ("random_case=5", "did you mean 'random_cases'"),
        ("random_cases=5", "--set random_cases=5"),
        ("family_cases=17", "--set family_cases=17"),
        ("decades=0", "--set decades=0"),
    ],
)
def test_faulty_settings_are_one_line(tmp_path, capsys, assignment, words):
    arguments = ["run", STUDY.name, "--out", str(tmp_path / "out"), "--set", assignment]
    assert cli.run(arguments) == 2
    shown = capsys.readouterr().err
    assert words in shown
    assert shown.count("\n") == 1
