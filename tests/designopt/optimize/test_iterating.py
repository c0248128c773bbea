"""A solve a few steps at a time: published optima, closed forms, and starts that are no design."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.optimize import (
    FEASIBLE,
    Evaluation,
    Iteration,
    Problem,
    make_epigraph,
    make_epigraph_starts,
    minimize,
)
from tests.designopt.optimize.cases import apart, case, inside, rosenbrock

POINT = 1e-3
"""A minimum is flat: its place is known to the square root of its value."""


def solved(problem, start, *, steps=5, updates=60):
    """All iterates, each checked for what every one of them promises."""
    iteration = Iteration(problem, steps=steps)
    iterates = list(iteration.run(start, problem.data, updates=updates))
    evaluate = jax.jit(lambda *given: problem.terms(*given))
    assert [one.done for one in iterates[:-1]] == [False] * (len(iterates) - 1)
    assert iterates[-1].done
    assert iterates[-1].converged or len(iterates) == updates
    for one in iterates:
        assert inside(problem, one.parameters)
        terms = evaluate(one.parameters, *problem.data)
        np.testing.assert_allclose(one.objective, terms.value, rtol=1e-12, atol=1e-15)
        unmet = [-np.min(part) for part in terms.inequalities.values()]
        unmet += [np.max(np.abs(part)) for part in terms.equalities.values()]
        np.testing.assert_allclose(one.violation, max([0.0, *map(float, unmet)]), atol=1e-12)
    return iterates


@pytest.mark.parametrize("name", ["hs61", "hs65"])
def test_published_optima(name):
    """HS65 starts outside its sphere and has bounds, HS61 off both of its equalities."""
    published = case(name)
    last = solved(published.problem, published.start)[-1]
    assert last.violation <= 10 * FEASIBLE
    scale = 1 + abs(published.value)
    np.testing.assert_allclose(last.objective, published.value, rtol=0, atol=1e-5 * scale)
    np.testing.assert_allclose(last.parameters, published.point, rtol=0, atol=POINT)


def test_it_ends_where_the_whole_solve_does():
    published = case("hs43")
    best = minimize(published.problem, published.starts, "bfgs").best
    last = solved(published.problem, published.start)[-1]
    np.testing.assert_allclose(last.parameters, best.parameters, rtol=0, atol=POINT)
    np.testing.assert_allclose(last.objective, best.objective, rtol=1e-6)


def test_max_min_in_its_exact_form():
    cb2 = case("cb2")
    form = make_epigraph(cb2.problem)
    start = jax.tree.map(lambda leaf: leaf[0], make_epigraph_starts(cb2.problem, cb2.starts))
    last = solved(form, start)[-1]
    assert last.violation <= 10 * FEASIBLE
    np.testing.assert_allclose(last.parameters.level, -cb2.value, rtol=1e-5)
    np.testing.assert_allclose(
        cb2.problem.terms(last.parameters.design).value, cb2.value, rtol=1e-5
    )


def disc(start, **settings):
    """The farthest point of the unit disc in a direction, with x at most 0.6: (0.6, 0.8)."""
    problem = Problem(
        lambda x: Evaluation(
            objective=-(x["right"] + x["up"]),
            inequalities={"disc": 1 - x["right"] ** 2 - x["up"] ** 2},
        ),
        {"right": jnp.asarray(-3.0), "up": jnp.asarray(-3.0)},
        {"right": jnp.asarray(0.6), "up": jnp.asarray(3.0)},
    )
    start = {name: jnp.asarray(value) for name, value in zip(("right", "up"), start, strict=True)}
    return solved(problem, start, **settings)


@pytest.mark.parametrize("start", [(0.0, 0.0), (-3.0, 3.0), (5.0, -9.0)])
def test_starts_outside_the_requirements_and_the_bounds(start):
    last = disc(start)[-1]
    np.testing.assert_allclose(last.parameters["right"], 0.6, atol=1e-5)
    np.testing.assert_allclose(last.parameters["up"], 0.8, atol=1e-5)
    np.testing.assert_allclose(last.objective, -1.4, atol=1e-5)


def test_few_steps_each_are_as_good_as_many():
    """The curvature that BFGS has learnt outlives an iteration: the same steps, told oftener."""
    often, seldom = disc((0.0, 0.0), steps=2, updates=200), disc((0.0, 0.0), steps=20)
    assert len(often) > len(seldom)
    np.testing.assert_allclose(often[-1].objective, seldom[-1].objective, rtol=0, atol=1e-12)
    # Iterates 10, 20, … of the one are 1, 2, … of the other.
    for one, other in zip(often[9::10], seldom, strict=False):
        np.testing.assert_allclose(one.objective, other.objective, rtol=0, atol=1e-9)


def test_nothing_to_hold():
    iterates = solved(rosenbrock(), jnp.asarray([-1.2, 1.0]))
    np.testing.assert_allclose(iterates[-1].parameters, 1.0, atol=POINT)
    # BFGS accepts no step that does not descend.
    objectives = [one.objective for one in iterates]
    assert all(after <= before for before, after in itertools.pairwise(objectives))


def test_the_cap():
    iterates = solved(case("hs43").problem, case("hs43").start, updates=3)
    assert len(iterates) == 3
    assert not any(one.converged for one in iterates)


def test_requirements_that_conflict_end_at_the_least_violation():
    last = solved(apart(), jnp.asarray([3.0]))[-1]
    np.testing.assert_allclose(last.parameters, 0.0, atol=1e-3)
    np.testing.assert_allclose(last.violation, 1.0, atol=1e-3)


def test_a_start_without_numbers_ends():
    problem = Problem(
        lambda x: Evaluation(objective=x[0] - jnp.log(x[0]), inequalities={"least": x[0] - 0.5}),
        jnp.asarray([-2.0]),
        jnp.asarray([6.0]),
    )
    iteration = Iteration(problem)
    iterates = list(iteration.run(jnp.asarray([-1.0])))
    assert iterates[-1].done
    assert not np.isfinite(iterates[-1].objective)
    np.testing.assert_allclose(
        list(iteration.run(jnp.asarray([3.0])))[-1].parameters, 1.0, atol=POINT
    )


def test_single_precision():
    with jax.enable_x64(False):
        hs65 = case("hs65", "float32")
        last = list(Iteration(hs65.problem).run(hs65.start))[-1]
        assert last.parameters.dtype == jnp.float32
    np.testing.assert_allclose(last.objective, hs65.value, rtol=1e-3)


def test_wrong_use_is_refused_at_once():
    with pytest.raises(ValueError, match=r"make_epigraph\(\) or make_soft_minimum\(\)"):
        Iteration(case("cb2").problem)


def test_one_program_serves_every_start_and_all_data():
    """The nearest point of a disc to points outside of it: of the same length as the radius."""
    traced = []

    def terms(x, radius, away):
        traced.append(x)
        return Evaluation(
            objective=jnp.sum((x - away) ** 2), inequalities={"disc": radius**2 - jnp.sum(x**2)}
        )

    def given(radius, away):
        return jnp.asarray(radius), jnp.asarray(away)

    limit = jnp.full(2, 10.0)
    problem = Problem(terms, -limit, limit, data=given(1.0, [3.0, 4.0]))
    iteration = Iteration(problem)
    (*_, first) = iteration.run(jnp.zeros(2))
    np.testing.assert_allclose(first.parameters, [0.6, 0.8], atol=1e-5)
    before = len(traced)
    for radius, away, start in ((2.0, [-8.0, 6.0], [5.0, 5.0]), (1.0, [0.0, -2.0], [-1.0, 0.0])):
        data = given(radius, away)
        (*_, last) = iteration.run(jnp.asarray(start), data)
        wanted = radius * np.array(away) / float(np.hypot(away[0], away[1]))
        np.testing.assert_allclose(last.parameters, wanted, atol=1e-5)
        assert last.converged
    assert len(traced) == before
