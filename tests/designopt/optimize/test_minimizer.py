"""Local solves, every method, against published optima; failures that stay in their place."""

import functools
import itertools
from dataclasses import replace
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.optimize import (
    BOUND,
    FEASIBLE,
    Evaluation,
    Method,
    Minimizer,
    OptimumResult,
    Problem,
    draw_sobol_starts,
    explain_conflict,
    find_active_set,
    make_epigraph,
    make_epigraph_starts,
    make_soft_minimum,
    minimize,
)
from tests.designopt.optimize.cases import PUBLISHED, apart, case, rosenbrock
from tests.designopt.tables import cases

VALUE = 1e-6
"""Relative to 1 + |value|: constraints are met to about 1e-7, and multipliers are of order one."""

POINT = 1e-3
"""A minimum is flat: its place is known to the square root of its value."""

TIGHT = {"slsqp": 1e-12}
"""SLSQP's tolerance is of the objective, to which its place belongs by the square root."""

SMOOTH = ["hs1", "hs21", "hs28", "hs35", "hs43", "hs61", "hs65", "hs71"]


WEAK = {
    ("hs1", "levenberg-marquardt"): "without residuals it sees the slope and no curvature",
    ("hs1", "jaxopt-lbfgsb"): "its backtracking line search stalls in the valley",
    ("hs1", "jaxopt-projected-gradient"): "a gradient method needs thousands of steps in it",
    ("hs61", "slsqp"): "at the published start the linearised equalities have no solution",
    ("logarithmic", "jaxopt-projected-gradient"): "its line search does not return into the domain",
}
"""What a method does not solve with these settings; then it must not be called an optimum."""


def floors(method, value):
    """Levenberg–Marquardt's floor: a little below the least value, as a designer may guess it."""
    return value - 1.0 if method == "levenberg-marquardt" else None


@functools.cache
def solved(name, method):
    published = case(name)
    return published, minimize(
        published.problem,
        published.starts,
        method,
        floor=floors(method, published.value),
        tolerance=TIGHT.get(method, 1e-8),
    )


def check(published, optimum):
    assert bool(optimum.solution.ok), (optimum.solution.messages(), optimum.violations)
    assert optimum.violation <= FEASIBLE
    # BFGS knows no bounds and comes near them from outside; what is found is inside all the same.
    assert optimum.violations.get(BOUND, 0.0) == 0.0
    scale = 1 + abs(published.value)
    np.testing.assert_allclose(optimum.objective, published.value, rtol=0, atol=VALUE * scale)
    np.testing.assert_allclose(optimum.parameters, published.point, rtol=0, atol=POINT)
    for name, multiplier in published.multipliers.items():
        found = optimum.multipliers[name] / published.units[name]
        np.testing.assert_allclose(found, multiplier, rtol=0, atol=POINT)


@pytest.mark.parametrize(
    ("name", "method"),
    [
        *cases("published_optima"),
        pytest.param("hs71", "bfgs", marks=pytest.mark.as_users),
        *(
            pytest.param(*each, marks=pytest.mark.nightly)
            for each in itertools.product(SMOOTH, get_args(Method))
        ),
    ],
)
def test_published_optima(name, method):
    """By day a few; at night every method on every problem."""
    published, optima = solved(name, method)
    if (name, method) in WEAK:
        assert not bool(optima.best.solution.ok), WEAK[name, method]
    else:
        check(published, optima.best)
        assert explain_conflict(published.problem, optima.best) == []
        assert optima.seconds > 0
        assert optima.compile_seconds > 0


def test_the_active_set_of_hs71():
    """The equality and the product hold it, and the lower bound of x1, as published."""
    published, optima = solved("hs71", "slsqp")
    active = find_active_set(published.problem, optima.best)
    words = {one.words: one for one in active}
    assert words.keys() == {"parameter[0] at its lower bound", "product", "sphere"}
    assert [one.share for one in active] == sorted((one.share for one in active), reverse=True)
    np.testing.assert_allclose(sum(one.share for one in active), 1.0, rtol=1e-6)
    # A price is what the optimum gains by a requirement's change: by solving anew.
    step = 1e-4

    def value(**change):
        lower = published.problem.lower.at[0].add(change.get("bound", 0.0))

        def terms(x):
            at = published.problem.terms(x)
            equalities = {"sphere": at.equalities["sphere"] - change.get("sphere", 0.0)}
            inequalities = {"product": at.inequalities["product"] - change.get("product", 0.0)}
            return replace(at, equalities=equalities, inequalities=inequalities)

        problem = replace(published.problem, terms=terms, lower=lower)
        return minimize(problem, published.starts, "slsqp", tolerance=1e-14).best.objective

    for key, name, less in (
        ("bound", "parameter[0] at its lower bound", -step),
        ("product", "product", -step),
        ("sphere", "sphere", step),  # of an equality, the price is of +1 instead of 0
    ):
        gain = (optima.best.objective - value(**{key: less})) / step
        # The optimal value is curved: by some 10 per squared unit, of a slope of some 10.
        np.testing.assert_allclose(words[name].price, gain, rtol=1e-3)


def test_plain_least_squares_is_one_solve():
    data = PUBLISHED["kowalik-osborne"]
    y, u = (jnp.asarray(data[key]) for key in "yu")

    def terms(x):
        return Evaluation(residuals=x[0] * (u * u + u * x[1]) / (u * u + u * x[2] + x[3]) - y)

    problem = Problem(terms, jnp.full(4, -jnp.inf), jnp.full(4, jnp.inf))
    start = jnp.asarray(data["start"])
    optima = minimize(problem, jnp.stack([start, 2 * start]), "levenberg-marquardt")
    for one in optima.found:
        assert bool(one.solution.ok)
        np.testing.assert_allclose(2 * one.objective, data["sum_of_squares"], rtol=2e-6)
        assert one.multipliers == {}
        # No multipliers to update: one row of history.
        assert one.history.steps.shape == (1,)
        np.testing.assert_allclose(one.history.objective[0], one.objective, rtol=1e-12)


def test_the_exact_form_of_max_min():
    """CB2 in 8 starts at once: where two of three functions meet, shares of the price sum to 1."""
    cb2 = case("cb2")
    form = make_epigraph(cb2.problem)
    starts = make_epigraph_starts(cb2.problem, draw_sobol_starts(cb2.problem, 8, seed=0))
    optima = minimize(form, starts, "bfgs", updates=15)
    best = optima.best
    assert bool(best.solution.ok)
    np.testing.assert_allclose(best.objective, cb2.value, rtol=1e-6)
    np.testing.assert_allclose(best.parameters.level, -cb2.value, rtol=1e-6)
    at = cb2.problem.terms(best.parameters.design)
    np.testing.assert_allclose(at.value, cb2.value, rtol=1e-6)
    weights = [float(best.multipliers[name]) for name in ("first", "second", "third")]
    # The first function and the second are the largest there; of weights the sum is one.
    np.testing.assert_allclose(sum(weights), 1.0, rtol=1e-6)
    assert weights[2] == pytest.approx(0.0, abs=1e-6)
    assert {one.name for one in find_active_set(form, best)} == {"first", "second"}
    feasible = optima.feasible
    assert feasible[0] is best
    assert [one.objective for one in feasible] == sorted(one.objective for one in feasible)


def test_the_smooth_form_of_max_min_ends_within_its_bound():
    cb3, temperature = case("cb3"), 0.01
    optima = minimize(
        make_soft_minimum(cb3.problem, temperature), cb3.starts, "slsqp", tolerance=1e-12
    )
    best = optima.best
    assert bool(best.solution.ok)
    assert cb3.value <= best.objective <= cb3.value + temperature * np.log(3)
    exact = float(cb3.problem.terms(best.parameters).value)
    assert cb3.value - 1e-9 <= exact <= cb3.value + temperature * np.log(3)


@pytest.mark.parametrize("method", ["bfgs", "trust-constr"])
def test_an_infeasible_problem_says_what_conflicts(method):
    optima = minimize(apart(), jnp.asarray([[3.0]]), method)
    best = optima.best
    assert best.solution.messages() == [OptimumResult[OptimumResult.infeasible]]
    np.testing.assert_allclose(best.parameters, 0.0, atol=1e-6)
    assert sorted(explain_conflict(apart(), best)) == ["high by 1", "low by 1"]
    np.testing.assert_allclose([best.violations[n] for n in ("high", "low")], 1.0, atol=1e-6)
    np.testing.assert_allclose(best.violation, 1.0, atol=1e-6)
    assert optima.feasible == []


def logarithmic(x):
    """Least at (1, 0), where the requirement holds with room; no numbers left of 0."""
    return Evaluation(
        objective=x[0] - jnp.log(x[0]) + x[1] ** 2, inequalities={"root": jnp.sqrt(x[0]) - 0.5}
    )


LOGARITHMIC = Problem(logarithmic, jnp.full(2, -2.0), jnp.full(2, 6.0))
DOMAIN_STARTS = jnp.asarray([[3.0, 1.0], [-1.0, 1.0], [0.5, 5.0]])


QUICK = ("bfgs", "slsqp", "trust-constr")


@pytest.mark.parametrize(
    "method",
    [
        pytest.param(one, marks=() if one in QUICK else pytest.mark.nightly)
        for one in get_args(Method)
    ],
)
def test_a_start_without_numbers_does_not_spoil_the_others(method):
    steps: dict[str, int] = {"updates": 6, "steps": 40} if method in QUICK else {}
    tolerance, floor = TIGHT.get(method, 1e-8), floors(method, 1.0)
    optima = minimize(LOGARITHMIC, DOMAIN_STARTS, method, floor=floor, tolerance=tolerance, **steps)
    good, bad, other = optima.found
    assert bad.solution.messages() == [OptimumResult[OptimumResult.no_number]]
    assert not bad.feasible
    arrived = [bool(one.solution.ok) for one in (good, other)]
    assert all(arrived) or (("logarithmic", method) in WEAK and any(arrived))
    for one in optima.feasible[: sum(arrived)]:
        np.testing.assert_allclose(one.parameters, [1.0, 0.0], atol=POINT)
    assert optima.best in (good, other)
    assert len(optima.feasible) == 2


def test_the_history_of_an_augmented_lagrangian():
    published, optima = solved("hs35", "jaxopt-projected-gradient")
    history = optima.best.history
    assert history.objective.shape == history.violation.shape == history.steps.shape == (12,)
    steps, violation = np.asarray(history.steps), np.asarray(history.violation)
    assert np.all(np.diff(steps) >= 0)
    # The first update is that of the plain penalty ρ/2 g², whose minimum is known for HS35: with
    # the gradient λ of the optimal value, the violation is near λ/ρ. The last meets the tolerance.
    np.testing.assert_allclose(violation[0], published.multipliers["plane"] / 10, rtol=0.2)
    assert violation[-1] <= 1e-8
    np.testing.assert_allclose(history.objective[-1], optima.best.objective, rtol=1e-12)
    ended = np.flatnonzero(steps == steps[-1])[0]
    assert ended < 11
    assert np.all(violation[ended:] == violation[-1])


def test_the_history_of_a_reference_solver():
    published, optima = solved("hs71", "slsqp")
    history = optima.best.history
    assert history.steps.tolist() == list(range(len(history.steps)))
    np.testing.assert_allclose(history.objective[-1], published.value, rtol=1e-8)
    assert float(history.violation[-1]) <= FEASIBLE
    # It begins at the published start: 52 instead of 40, over 40; the product is 25 there.
    np.testing.assert_allclose(history.violation[0], 12 / 40, rtol=1e-12)
    np.testing.assert_allclose(history.objective[0], 16.0, rtol=1e-12)


def test_single_precision():
    with jax.enable_x64(False):
        hs65 = case("hs65", "float32")
        minimizer = Minimizer(hs65.problem, 1, "bfgs")
        best = minimizer.solve(hs65.starts).best
        assert best.parameters.dtype == jnp.float32
    # The square root of rounding is 3e-4.
    np.testing.assert_allclose(best.objective, hs65.value, rtol=1e-3)
    np.testing.assert_allclose(best.parameters, hs65.point, rtol=0, atol=2e-2)
    assert best.violation <= 1e-5


def test_single_precision_beside_double():
    free = case("hs1", "float32")
    best = minimize(free.problem, free.starts, "slsqp").best
    assert best.parameters.dtype == jnp.float32
    np.testing.assert_allclose(best.parameters, free.point, rtol=0, atol=5e-2)


def test_a_method_that_mixes_float_types_says_so():
    hs28 = case("hs28", "float32")
    with pytest.raises(ValueError, match=r"enable_x64\(False\)"):
        Minimizer(hs28.problem, 1, "levenberg-marquardt")


def test_wrong_use_is_refused():
    hs71, cb2 = case("hs71"), case("cb2")
    with pytest.raises(ValueError, match="needs residuals, or a floor"):
        Minimizer(hs71.problem, 1, "levenberg-marquardt")
    with pytest.raises(ValueError, match=r"make_epigraph\(\) or make_soft_minimum\(\)"):
        Minimizer(cb2.problem, 1, "slsqp")


def test_a_minimiser_serves_more_than_once():
    minimizer = Minimizer(rosenbrock(), 2, "bfgs")
    for starts in ([[0.0, 0.0], [2.0, 1.0]], [[-1.0, 2.0], [0.5, 0.5]]):
        optima = minimizer.solve(jnp.asarray(starts))
        for one in optima.found:
            assert bool(one.solution.ok)
            np.testing.assert_allclose(one.parameters, 1.0, atol=POINT)
