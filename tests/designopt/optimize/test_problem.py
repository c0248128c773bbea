"""Terms and forms of a problem against their definitions; no solver runs here."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.optimize import (
    BOUND,
    EpigraphVariables,
    Evaluation,
    Problem,
    draw_sobol_starts,
    make_epigraph,
    make_epigraph_starts,
    make_soft_minimum,
    select_starts,
)
from tests.designopt.optimize.cases import case

ONE = jnp.asarray(1.0)


def test_a_value_is_that_of_what_is_asked():
    values = {"a": jnp.asarray([3.0, 2.0]), "b": jnp.asarray(5.0)}
    assert float(Evaluation(objective=ONE).value) == 1.0
    assert float(Evaluation(residuals=jnp.asarray([3.0, 4.0])).value) == 12.5
    assert float(Evaluation(least=values).value) == -2.0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "only one"),
        ({"objective": ONE, "residuals": ONE[None]}, "only one"),
        ({"objective": ONE, "equalities": {"a": ONE}, "inequalities": {"a": ONE}}, "things: a"),
        ({"least": {"a": ONE}, "inequalities": {"a": ONE}}, "two things: a"),
        ({"objective": ONE, "inequalities": {BOUND: ONE}}, f"two things: {BOUND}"),
    ],
)
def test_one_thing_is_asked_and_a_name_stands_for_one_thing(given, words):
    with pytest.raises(ValueError, match=words):
        Evaluation(**given)


def test_scales_are_the_widths_of_bounds():
    lower = {"a": jnp.asarray([0.0, 1.0]), "b": jnp.asarray(-jnp.inf)}
    upper = {"a": jnp.asarray([3.0, 1.0]), "b": jnp.asarray(4.0)}
    units = Problem(lambda _: Evaluation(objective=ONE), lower, upper).units
    np.testing.assert_array_equal(units["a"], [3.0, 1.0])
    assert float(units["b"]) == 1.0


def test_the_epigraph_form_asks_for_a_level_below_all_values():
    cb2 = case("cb2")
    form = make_epigraph(cb2.problem, scale=2.0)
    at = cb2.problem.terms(cb2.start)
    assert at.least is not None
    terms = form.terms(EpigraphVariables(cb2.start, jnp.asarray(-4.0)))
    assert terms.objective is not None
    assert float(terms.objective) == 2.0
    assert terms.inequalities.keys() == at.least.keys()
    for name, value in at.least.items():
        np.testing.assert_allclose(terms.inequalities[name], (value + 4.0) / 2.0, rtol=1e-15)
    np.testing.assert_array_equal(form.upper.design, cb2.problem.upper)
    assert (float(form.lower.level), float(form.units.level)) == (-np.inf, 2.0)


def test_starts_of_the_epigraph_form_are_at_their_levels():
    cb2 = case("cb2").problem
    starts = draw_sobol_starts(cb2, 4, seed=0)
    found = make_epigraph_starts(cb2, starts)
    x, y = np.asarray(starts).T
    worst = np.max([x**2 + y**4, (2 - x) ** 2 + (2 - y) ** 2, 2 * np.exp(y - x)], axis=0)
    np.testing.assert_allclose(found.level, -worst, rtol=1e-14)
    np.testing.assert_array_equal(found.design, starts)


@pytest.mark.parametrize("temperature", [1e-6, 0.1, 10.0])
def test_a_soft_minimum_is_below_the_least_value_by_at_most_its_bound(temperature):
    cb2 = case("cb2").problem
    soft = make_soft_minimum(cb2, temperature)
    gap = jax.jit(jax.vmap(lambda x: soft.terms(x).value - cb2.terms(x).value))
    below = np.asarray(gap(draw_sobol_starts(cb2, 16, seed=1)))
    # Both are known to rounding of values up to 700.
    assert np.all((below >= -1e-12) & (below <= temperature * np.log(3) + 1e-12))


def test_forms_are_for_problems_with_least():
    hs71 = case("hs71")
    with pytest.raises(ValueError, match="`least`"):
        make_epigraph(hs71.problem).terms(EpigraphVariables(hs71.start, ONE))
    with pytest.raises(ValueError, match="`least`"):
        make_soft_minimum(hs71.problem, 0.1).terms(hs71.start)


def test_forms_keep_the_constraints():
    inner = Problem(
        lambda x: Evaluation(least={"v": x}, equalities={"h": x[0]}, inequalities={"g": x[1]}),
        jnp.zeros(2),
        jnp.ones(2),
    )
    at = jnp.asarray([0.25, 0.5])
    exact = make_epigraph(inner).terms(EpigraphVariables(at, ONE))
    soft = make_soft_minimum(inner, 0.1).terms(at)
    assert exact.equalities == soft.equalities == {"h": 0.25}
    assert exact.inequalities["g"] == soft.inequalities["g"] == 0.5
    assert soft.inequalities.keys() == {"g"}


def test_sobol_starts_are_a_net_in_the_box():
    lower = {"a": jnp.asarray([0.0, 10.0]), "b": jnp.asarray(-1.0)}
    upper = {"a": jnp.asarray([1.0, 30.0]), "b": jnp.asarray(3.0)}
    problem = Problem(lambda _: Evaluation(objective=ONE), lower, upper)
    starts = draw_sobol_starts(problem, 64, seed=3)
    assert starts["a"].shape == (64, 2)
    columns = [starts["a"][:, 0], (starts["a"][:, 1] - 10) / 20, (starts["b"] + 1) / 4]
    # 2^m points of a scrambled Sobol sequence: one in every 64th of every axis.
    for column in columns:
        assert sorted(np.floor(64 * np.asarray(column)).astype(int)) == list(range(64))
    again = draw_sobol_starts(problem, 64, seed=3)
    np.testing.assert_array_equal(starts["a"], again["a"])
    assert not np.array_equal(starts["b"], draw_sobol_starts(problem, 64, seed=4)["b"])
    assert draw_sobol_starts(problem, 5, seed=3)["b"].shape == (5,)


def test_starts_need_bounds():
    with pytest.raises(ValueError, match="finite lower and upper bound"):
        draw_sobol_starts(case("hs35").problem, 4, seed=0)


def test_the_best_starts_are_those_of_least_merit():
    hs71 = case("hs71").problem
    found = np.asarray(select_starts(hs71, 5, seed=2, among=64).parameters)
    points = np.asarray(draw_sobol_starts(hs71, 64, seed=2))
    a, b, c, d = points.T
    objective = a * d * (a + b + c) + c
    unmet = ((a**2 + b**2 + c**2 + d**2) / 40 - 1) ** 2
    unmet += np.minimum(a * b * c * d / 25 - 1, 0) ** 2
    order = np.argsort(objective + 5 * unmet)[:5]
    np.testing.assert_array_equal(found, points[order])


def test_starts_without_numbers_are_the_last():
    problem = Problem(
        lambda x: Evaluation(objective=x[0] - jnp.log(x[0])), -jnp.ones(1), 3 * jnp.ones(1)
    )
    found = np.asarray(select_starts(problem, 16, seed=0, among=16).parameters)[:, 0]
    assert np.all(found[:12] > 0)
    assert np.all(found[12:] < 0)
    assert abs(found[0] - 1) < 0.25  # the least is at 1, and the points are 1/4 apart
    assert select_starts(problem, 8, seed=0, among=2).parameters.shape == (8, 1)
