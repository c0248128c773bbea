"""What is said of a point, without a solver: published optima, and points that are none."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.optimize import (
    BOUND,
    FEASIBLE,
    EpigraphVariables,
    Evaluation,
    Optimum,
    OptimumResult,
    Problem,
    Requirement,
    explain_conflict,
    find_active_set,
    make_epigraph,
)
from designopt.optimize.augmented_lagrangian import Trace
from designopt.optimize.flat import Flat
from designopt.optimize.optimality import make_optimality_check
from tests.designopt.optimize.cases import apart, case, rosenbrock

PUBLISHED_DIGITS = 2e-7
"""Multipliers are published to seven digits."""


def judged(problem: Problem, parameters) -> Optimum:
    flat = Flat.of(problem)
    nothing = Trace(jnp.zeros(1), jnp.zeros(1), jnp.zeros(1, int))
    return make_optimality_check(flat)(flat.point(parameters), flat.own, nothing)


def corner(x):
    """Least at (1, 2, 3), of a slope of 1 per unit, 2 per unit and none."""
    return Evaluation(
        objective=x["a"] + 2 * (2 - x["b"][0]) + (x["b"][1] - 3) ** 2,
        inequalities={"left": (x["a"] - 1) / 4, "far": jnp.asarray([[9.0, 8.0], [7.0, 6.0]])},
    )


CORNER = Problem(
    corner,
    {"a": jnp.asarray(-10.0), "b": jnp.asarray([-jnp.inf, 3.0])},
    {"a": jnp.asarray(10.0), "b": jnp.asarray([2.0, jnp.inf])},
    scale={"a": jnp.asarray(5.0), "b": jnp.asarray([0.1, 1.0])},
    requirements={"left": Requirement(lambda _: "a right of the wall", "mm", 4.0)},
)
BEST = {"a": jnp.asarray(1.0), "b": jnp.asarray([2.0, 3.0])}


@pytest.mark.parametrize("name", ["hs35", "hs43", "hs71"])
def test_multipliers_are_the_published_ones(name):
    published = case(name)
    found = judged(published.problem, jnp.asarray(published.point))
    assert bool(found.solution.ok), found.solution.messages()
    assert found.feasible
    np.testing.assert_allclose(found.objective, published.value, rtol=PUBLISHED_DIGITS)
    for constraint, multiplier in published.multipliers.items():
        # Of a constraint over its unit, the multiplier is so many times larger.
        np.testing.assert_allclose(
            found.multipliers[constraint] / published.units[constraint],
            multiplier,
            rtol=0,
            atol=2 * PUBLISHED_DIGITS,
        )


def test_multipliers_have_their_constraints_shapes_and_the_bounds_order():
    found = judged(CORNER, BEST)
    assert bool(found.solution.ok)
    assert found.multipliers["far"].shape == (2, 2)
    assert not np.any(found.multipliers["far"])
    np.testing.assert_allclose(found.multipliers["left"], 4.0, rtol=1e-12)
    # Lower bounds of a and b[1], then upper ones of a and b[0]; a scaled unit of b[0] is 0.1.
    np.testing.assert_allclose(found.multipliers[BOUND], [0, 0, 0, 0.2], atol=1e-12)
    assert found.violations == {"left": 0.0, "far": 0.0, BOUND: 0.0}
    assert found.worst == {}


def test_prices_are_in_the_units_of_people():
    wall, bound = sorted(find_active_set(CORNER, judged(CORNER, BEST)), key=lambda one: one.words)
    # One less of b[0]'s bound, 3 instead of 2, is worth 2; a wall 1 mm to the left is worth 1.
    assert (bound.name, bound.index, bound.words) == (BOUND, (3,), "b[0] at its upper bound")
    np.testing.assert_allclose(bound.price, 2.0, rtol=1e-6)
    assert (wall.words, wall.unit, wall.index) == ("a right of the wall", "mm", ())
    np.testing.assert_allclose(wall.price, 1.0, rtol=1e-12)
    np.testing.assert_allclose(wall.share + bound.share, 1.0, rtol=1e-12)


def test_a_parameter_is_told_in_its_own_words_and_unit():
    """Half a radian beyond a bound, in the problem and in its epigraph form."""

    def terms(arm):
        return Evaluation(least={"lift": arm["turn"]})

    problem = Problem(
        terms,
        {"turn": jnp.zeros(2)},
        {"turn": jnp.ones(2)},
        parameters={"turn": Requirement(lambda index: f"turn of arm {index[0]}", "°", 100.0)},
    )
    exact = make_epigraph(problem)
    at = EpigraphVariables({"turn": jnp.asarray([0.5, 1.5])}, jnp.asarray(0.0))
    line = "turn of arm 1 at its upper bound by 50 °"
    assert explain_conflict(exact, judged(exact, at)) == [line]
    unnamed = replace(exact, parameters={})
    assert explain_conflict(unnamed, judged(unnamed, at)) == ["turn[1] at its upper bound by 0.5"]


def test_a_conflict_is_told_in_the_units_of_people():
    bad = {"a": jnp.asarray(-1.0), "b": jnp.asarray([2.5, 3.0])}
    found = judged(CORNER, bad)
    assert not found.feasible
    assert found.violations == pytest.approx({"left": 0.5, "far": 0.0, BOUND: 5.0})
    assert found.worst == {"left": (), BOUND: (3,)}
    lines = ["b[0] at its upper bound by 0.5", "a right of the wall by 2 mm"]
    assert explain_conflict(CORNER, found) == lines
    assert found.solution.messages() == [OptimumResult[OptimumResult.not_met]]
    np.testing.assert_allclose(found.solution.margin, -5.0, rtol=1e-6)


def test_only_where_violations_balance_do_requirements_conflict():
    found = judged(apart(), jnp.zeros(1))
    assert found.solution.messages() == [OptimumResult[OptimumResult.infeasible]]
    assert sorted(explain_conflict(apart(), found)) == ["high by 1", "low by 1"]
    found = judged(apart(), jnp.ones(1))
    assert found.solution.messages() == [OptimumResult[OptimumResult.not_met]]
    assert explain_conflict(apart(), found) == ["low by 2"]


def test_a_requirement_conflicts_with_a_bound_too():
    problem = Problem(
        lambda x: Evaluation(objective=x[1] ** 2, equalities={"seven": (x[0] - 7) / 7}),
        jnp.zeros(2),
        jnp.asarray([5.0, 1.0]),
    )
    found = judged(problem, jnp.asarray([5.0, 0.3]))
    assert found.solution.messages() == [OptimumResult[OptimumResult.infeasible]]
    assert explain_conflict(problem, found) == ["seven by 0.286"]


def test_without_constraints_the_gradient_decides():
    free = rosenbrock()
    best, near = (judged(free, jnp.full(2, at)) for at in (1.0, 0.99))
    assert bool(best.solution.ok)
    assert best.violation == 0.0
    assert best.multipliers == {}
    assert float(best.solution.margin) == np.inf
    assert near.feasible
    assert near.solution.messages() == [OptimumResult[OptimumResult.not_stationary]]
    assert find_active_set(free, near) == []


def test_a_minimum_in_single_precision_is_one():
    with jax.enable_x64(False):
        published = case("hs1", "float32")
        # Found to the square root of rounding, as the best that comparing values allows.
        found = judged(published.problem, jnp.asarray([1.0002, 1.0004], jnp.float32))
    assert bool(found.solution.ok), found.solution.residual


def test_an_active_bound_that_pushes_the_wrong_way_is_no_optimum():
    found = judged(rosenbrock(1.5), jnp.asarray([1.5, 2.25]))
    assert found.solution.messages() == [OptimumResult[OptimumResult.not_stationary]]
    assert not np.any(found.multipliers[BOUND])


def test_points_without_numbers_say_so():
    problem = Problem(
        lambda x: Evaluation(objective=jnp.log(x[0]), inequalities={"g": x[0]}),
        -jnp.ones(1),
        jnp.ones(1),
    )
    for at in (-0.5, np.nan):
        found = judged(problem, jnp.asarray([at]))
        assert found.solution.messages() == [OptimumResult[OptimumResult.no_number]]
        assert found.objective == np.inf
        assert not found.feasible
        parts = (found.parameters, found.solution.margin, found.solution.residual)
        assert all(np.all(np.isfinite(part)) for part in parts)
        assert (find_active_set(problem, found), explain_conflict(problem, found)) == ([], [])


def test_what_counts_as_feasible_is_the_scaled_violation():
    problem = Problem(
        lambda x: Evaluation(objective=x[0], inequalities={"g": x[0] / 100}),
        jnp.asarray([-jnp.inf]),
        jnp.asarray([jnp.inf]),
    )
    within, beyond = (judged(problem, jnp.asarray([-100 * FEASIBLE * f])) for f in (0.99, 1.01))
    assert within.feasible
    assert not beyond.feasible


def test_of_an_array_the_worst_element_is_told():
    problem = Problem(
        lambda x: Evaluation(objective=x[0, 0], inequalities={"g": x - 1}),
        jnp.full((2, 3), -10.0),
        jnp.full((2, 3), 10.0),
    )
    at = jnp.ones((2, 3)).at[1, 2].set(-1.0).at[0, 1].set(0.5)
    assert explain_conflict(problem, judged(problem, at)) == ["g[1, 2] by 2"]
    with_bound = jnp.ones((2, 3)).at[0, 2].set(-11.0)
    lines = ["g[0, 2] by 12", "parameter[0, 2] at its lower bound by 1"]
    assert explain_conflict(problem, judged(problem, with_bound)) == lines
