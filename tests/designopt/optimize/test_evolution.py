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


@pytest.mark.parametrize(
    ("name", "seconds", "seed", "violation", "tolerance"),
    [
        # No epigraph: the kink of the least value is no trouble to it.
        ("cb2", 100, 0, 0.0, {"rtol": 1e-4}),
        ("hs65", 60, 1, 0.0, {"rtol": 1e-2}),
        ("hs28", 200, 2, EQUALITY, {"atol": 0.05}),
    ],
)
def test_published_optima(name, seconds, seed, violation, tolerance):
    """Without a constraint, with an inequality, and with an equality met to its tolerance."""
    published = case(name)
    lower, upper = jnp.clip(published.problem.lower, -5), jnp.clip(published.problem.upper, None, 5)
    problem = Problem(published.problem.terms, lower, upper)
    found = run_differential_evolution(problem, seconds=seconds, seed=seed)
    assert len(found.seconds) == seconds
    assert found.seconds.shape == found.objective.shape == found.violation.shape
    np.testing.assert_array_equal(found.seconds, 1 + np.arange(seconds))
    np.testing.assert_allclose(found.objective[-1], published.value, **tolerance)
    np.testing.assert_allclose(
        found.objective[-1], problem.terms(found.parameters).value, rtol=1e-12
    )
    assert inside(problem, found.parameters)
    assert np.all(found.violation >= 0)
    assert found.violation[-1] <= violation
    assert (found.violation[-1] > 0) == (violation > 0)
    if name == "hs65":  # none is better where nothing is violated
        assert found.objective[-1] >= published.value * (1 - 1e-9)
    if name == "cb2":
        assert np.all(np.diff(found.objective) <= 0)
        assert np.all(found.violation == 0)


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
