"""Differential evolution against published values, by a clock that counts its generations."""

import itertools
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from designopt.optimize import Evaluation, Problem, run_differential_evolution
from designopt.optimize import reference_solvers as references
from designopt.optimize.reference_solvers import EQUALITY
from tests.designopt.optimize.cases import case, inside


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """A second passes whenever somebody looks: the same run on every machine."""
    ticks = itertools.count()
    clock = SimpleNamespace(perf_counter=lambda: float(next(ticks)))
    monkeypatch.setattr(references, "time", clock)


def checked(evolution, problem, generations):
    """The parts of an answer that must fit together."""
    assert len(evolution.seconds) == generations
    assert evolution.seconds.shape == evolution.objective.shape == evolution.violation.shape
    np.testing.assert_array_equal(evolution.seconds, 1 + np.arange(len(evolution.seconds)))
    assert np.all(evolution.violation >= 0)
    at = problem.terms(evolution.parameters)
    np.testing.assert_allclose(evolution.objective[-1], at.value, rtol=1e-12)
    assert inside(problem, evolution.parameters)


def test_max_min_as_it_is():
    """No epigraph, no constraint: the kink of the least value is no trouble to it."""
    cb2 = case("cb2")
    found = run_differential_evolution(cb2.problem, seconds=100, seed=0)
    checked(found, cb2.problem, 100)
    assert np.all(np.diff(found.objective) <= 0)
    assert np.all(found.violation == 0)
    np.testing.assert_allclose(found.objective[-1], cb2.value, rtol=1e-4)


def test_inequalities_are_respected():
    hs65 = case("hs65")
    found = run_differential_evolution(hs65.problem, seconds=60, seed=1)
    checked(found, hs65.problem, 60)
    assert found.violation[-1] == 0
    np.testing.assert_allclose(found.objective[-1], hs65.value, rtol=1e-2)
    assert found.objective[-1] >= hs65.value * (1 - 1e-9)


def test_equalities_are_met_to_their_tolerance():
    hs28 = case("hs28")
    problem = Problem(hs28.problem.terms, jnp.full(3, -5.0), jnp.full(3, 5.0))
    found = run_differential_evolution(problem, seconds=200, seed=2)
    checked(found, problem, 200)
    assert 0 < found.violation[-1] <= EQUALITY
    np.testing.assert_allclose(found.objective[-1], hs28.value, atol=0.05)


def test_the_same_seed_the_same_search():
    cb2 = case("cb2").problem
    first, again, other = (
        run_differential_evolution(cb2, seconds=5, seed=seed).objective[-5:] for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_members_without_numbers_are_the_worst(dtype):
    problem = Problem(
        lambda x: Evaluation(
            objective=x[0] - jnp.log(x[0]), inequalities={"g": jnp.sqrt(x[0]) - 0.5}
        ),
        jnp.asarray([-3.0], dtype),
        jnp.asarray([3.0], dtype),
    )
    found = run_differential_evolution(problem, seconds=40, seed=0, population=4)
    assert found.parameters.dtype == dtype
    assert np.all(np.isfinite(found.objective))
    np.testing.assert_allclose(found.parameters, 1.0, atol=1e-2)


def test_bounds_are_needed():
    with pytest.raises(ValueError, match="finite"):
        run_differential_evolution(case("hs43").problem, seconds=1, seed=0)
