"""Every dimension from η, against the forward equations, against iterations, and derivatives."""

import dataclasses
import functools
import inspect
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.roots import RootMethod
from optics import ChamberResult, solve_dimension_for_ratio
from optics.chamber.ratio import Dimension
from studies.oracles.chamber import dimension_roots
from tests.helpers import check_gradients
from tests.optics.chambers import chamber as make

DIMENSIONS = get_args(Dimension)
ITERATED = ("offset_d", "pinhole_offset")
ROUND_TRIP = 1e-9  # relative; a quadratic's root may lose half the digits next to a double root
GRADIENT = 1e-6
DIFFERENCES = 1e-9  # of the largest entry: what central differences themselves can tell
COUNT = 32

solve = functools.partial(jax.jit, static_argnums=1, static_argnames=("method", "bracket"))(
    solve_dimension_for_ratio
)
solve_all = jax.jit(jax.vmap(solve_dimension_for_ratio, (0, None, 0)), static_argnums=1)
ratios_of = jax.jit(jax.vmap(lambda chamber: chamber.imaging_ratio().value))
every_dimension = pytest.mark.parametrize("dimension", DIMENSIONS)


def many(**changes):
    """`COUNT` chambers, of which some dimension may be another one for each."""
    fields = {field.name: getattr(make(), field.name) for field in dataclasses.fields(make())}
    broadcast = {name: jnp.full(COUNT, value) for name, value in (fields | changes).items()}
    return dataclasses.replace(make(), **broadcast)


@every_dimension
def test_the_answer_gives_the_ratio_back(dimension):
    ratios = np.linspace(0.55, 0.65, COUNT)
    found = solve_all(many(), dimension, ratios)
    assert found.ok.all()
    assert (found.margin > 0).all()
    assert (np.abs(found.residual) < 1e-12).all()
    np.testing.assert_allclose(ratios_of(many(**{dimension: found.value})), ratios, rtol=ROUND_TRIP)
    designed = float(getattr(make(), dimension))
    moved = many(**{dimension: designed * np.linspace(0.95, 1.05, COUNT)})
    back = solve_all(moved, dimension, ratios_of(many()))
    np.testing.assert_allclose(back.value, designed, rtol=ROUND_TRIP)


@every_dimension
def test_what_is_ok_can_be_built(dimension):
    found = solve_all(many(), dimension, np.geomspace(0.01, 3.0, COUNT))
    built = many(**{dimension: found.value})
    shortest = np.min([built.length_ab, built.length_bc, built.length_cd], axis=0)
    np.testing.assert_array_equal(found.ok, found.margin > 0)
    assert not np.any(found.ok & (shortest <= 0))
    assert np.isfinite(found.value).all()


@pytest.mark.parametrize("method", get_args(RootMethod))
@pytest.mark.parametrize("dimension", ITERATED)
def test_iterations_agree_with_the_closed_form(dimension, method):
    expected = solve(make(), dimension, 0.65)
    found = solve(make(), dimension, 0.65, method=method, bracket=(-10.0, 20.0), tolerance=1e-13)
    assert bool(found.ok), found.messages()
    np.testing.assert_allclose(found.value, expected.value, rtol=1e-9)
    np.testing.assert_allclose(found.margin, expected.margin, rtol=1e-9)


@pytest.mark.parametrize(
    ("dimension", "method"),
    [
        *((dimension, "closed form") for dimension in DIMENSIONS),
        *((dimension, "newton") for dimension in ITERATED),
        *(
            pytest.param(dimension, "newton", marks=pytest.mark.nightly)
            for dimension in sorted({*DIMENSIONS} - {*ITERATED})
        ),
    ],
)
def test_gradients_are_central_differences(dimension, method):
    def answer(design):
        chamber, ratio = design
        # The dimension's own value only chooses between answers.
        return solve(chamber, dimension, ratio, method=method).value

    designs = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], (make(), 0.65))
    check_gradients(answer, designs, rtol=GRADIENT, of_largest=DIFFERENCES)


def test_of_two_answers_the_one_that_can_be_built_counts_then_the_nearer():
    chamber = make(wall_angle_bc=0.0, offset_d=-2.2, reference_height=1.0, offset_b=2.0)
    plain = {name: float(value) for name, value in vars(chamber).items()}
    low, high = sorted(dimension_roots("pinhole_offset", 0.05, 0.0, **plain))
    for start in map(float, (low - 1, high + 1)):
        sketch = dataclasses.replace(chamber, pinhole_offset=jnp.asarray(start))
        found = solve(sketch, "pinhole_offset", 0.05)
        expected, _ = dimension_roots("pinhole_offset", 0.05, start, **plain)
        np.testing.assert_allclose(found.value, float(expected), rtol=1e-9)


def test_no_answer_is_reported_and_stays_finite():
    found = solve(make(wall_angle_bc=0.0, offset_d=-10.0), "pinhole_offset", 3.0)
    assert not bool(found.ok)
    assert float(found.margin) <= 0
    assert np.isfinite(found.value)
    # Nothing depends on Δl_D when D lies in the pinhole plane with B.
    blind = make(pinhole_offset=-40.0)
    assert bool(solve(blind, "offset_d", 0.6).result == ChamberResult.no_solution)
    gradient = jax.grad(lambda chamber: solve(chamber, "offset_d", 0.6).value)(blind)
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(gradient))


def test_an_iteration_that_does_not_arrive_says_so():
    found = solve(
        make(), "offset_d", 0.65, method="bisection", bracket=(50.0, 60.0), tolerance=1e-13
    )
    assert bool(found.result == ChamberResult.not_converged)


def test_unknown_dimension_names_the_known_ones():
    # The test run's type check would answer first.
    unchecked = inspect.unwrap(solve_dimension_for_ratio)
    with pytest.raises(ValueError, match="solve for one of length_ab, length_bc"):
        unchecked(make(), "focal_length", 0.6)


@pytest.mark.parametrize("method", ["closed form", "newton"])
@pytest.mark.parametrize("size", [1e-100, 1e160, 1e305])
def test_the_unit_of_length_does_not_matter(method, size):
    chamber = make()
    scaled = jax.tree.map(lambda leaf: leaf * size, chamber)
    scaled = dataclasses.replace(scaled, wall_angle_bc=chamber.wall_angle_bc)
    found = solve(scaled, "offset_d", 0.6, method=method)
    assert all(np.isfinite(part) for part in (found.value, found.margin, found.residual))
    assert bool(found.ok)
    expected = solve(chamber, "offset_d", 0.6, method=method)
    np.testing.assert_allclose(found.value / size, expected.value, rtol=1e-9)


def test_an_answer_beyond_the_float_type_is_reported():
    with jax.enable_x64(False):
        chamber = make(length_ab=3e37, length_bc=1.0, length_cd=3e37)
        found = solve(chamber, "offset_d", 1e9)
    assert not bool(found.ok)
    assert np.isfinite(found.value)
