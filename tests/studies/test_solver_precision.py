"""The study ``solver-precision``: its references, its claim, and one quick run."""

from contextlib import nullcontext

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.study.results import PrecisionRow
from designopt.study.study import Context, load_study
from studies.benchmarks.solvers import SolverPrecisionSpec, box, grasp
from tests.helpers import marked, nightly


def rosenbrock(x):
    return 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2


def test_the_minimum_with_a_bound_is_the_published_one():
    """Hock and Schittkowski give the value 0.0504261879; its slope is 0 but for the bound's."""
    found = box.minimum()
    np.testing.assert_allclose(rosenbrock(found), 0.0504261879, atol=5e-11)
    slope = jax.grad(rosenbrock)(jnp.asarray(found))
    assert abs(float(slope[0])) < 1e-12
    assert float(slope[1]) > 0.1
    grid = np.linspace(-3, 3, 601)
    assert rosenbrock(found) <= rosenbrock(np.meshgrid(grid, 1.5 + grid[300:])).min()


def row(method, error, seconds):
    return PrecisionRow(method, "", "", error, seconds, seconds, seconds, 0.0)


@pytest.mark.parametrize(
    ("error", "seconds", "holds"), [(1e-16, 0.5, False), (1e-9, 0.5, True), (1e-16, 2.0, True)]
)
def test_the_claim_of_the_grasp_can_be_proved_wrong(error, seconds, holds):
    ours = [row(grasp.OURS, 1e-2, 3.0), row(grasp.OURS, 1e-15, 1.0)]  # the closest counts
    _, found = grasp.compare_with_minimizers([*ours, row("other", error, seconds)])
    assert found == holds


@pytest.mark.parametrize("minimizers", [*marked("slow", False), *nightly(True)])
def test_every_method_reaches_the_references(minimizers, monkeypatch):
    if not minimizers:  # each tolerance is compiled anew
        monkeypatch.setattr(box, "TOLERANCES", box.TOLERANCES[-1:])
    spec = SolverPrecisionSpec(angles=20, repeats=3, minimizers=minimizers)
    context = Context(0, "float64", lambda _: nullcontext())
    results = load_study("solver-precision").run(spec, context)
    assert not results.unmet
    assert results.precision is not None
    reached = {}
    for row in results.precision.rows:
        key = (row.panel, row.method)
        reached[key] = min(row.error, reached.get(key, np.inf))
    assert len({panel for panel, _ in reached}) == 4
    # A convex program and a line search see an objective, which is flat at its minimum.
    coarse = {"jaxopt QP, sequential", "jaxopt projected gradient", "SciPy SLSQP"}
    for (_, method), error in reached.items():
        assert error < (1e-5 if method in coarse else 1e-10), method
    for package in ("designopt", "Optimistix", "jaxopt", "SciPy"):
        panels = {panel for panel, method in reached if method.startswith(package)}
        assert len(panels) >= (4 if minimizers else 3), package
