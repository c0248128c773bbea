"""Every dimension from η, against the forward equations, against iterations, and derivatives."""

import dataclasses
import functools
import inspect
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from designopt.roots import RootMethod
from optics import ChamberResult, solve_dimension_for_ratio
from optics.chamber.ratio import _QUADRATIC, Dimension
from tests.helpers import central_differences
from tests.optics.test_chamber import make

DIMENSIONS = get_args(Dimension)
ITERATED = ("offset_d", "pinhole_offset")
ROUND_TRIP = 1e-9  # relative; a quadratic's root may lose half the digits next to a double root
GRADIENT = 1e-6
DIFFERENCES = 1e-9  # of the largest entry: what central differences themselves can tell


solve = functools.partial(jax.jit, static_argnums=1, static_argnames=("method", "bracket"))(
    solve_dimension_for_ratio
)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@settings(max_examples=20)
@given(ratio=st.floats(0.55, 0.65))
def test_the_answer_gives_the_ratio_back(dimension, ratio):
    found = solve(make(), dimension, ratio)
    assert bool(found.ok), found.messages()
    answer = dataclasses.replace(make(), **{dimension: found.value})
    np.testing.assert_allclose(answer.imaging_ratio().value, ratio, rtol=ROUND_TRIP)
    assert float(found.margin) > 0
    assert abs(float(found.residual)) < 1e-12
    moved = dataclasses.replace(make(), **{dimension: 1.05 * getattr(make(), dimension)})
    back = solve(moved, dimension, make().imaging_ratio().value)
    np.testing.assert_allclose(back.value, getattr(make(), dimension), rtol=ROUND_TRIP)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@settings(max_examples=20)
@given(ratio=st.floats(0.01, 3.0))
def test_what_is_ok_can_be_built(dimension, ratio):
    found = solve(make(), dimension, ratio)
    answer = dataclasses.replace(make(), **{dimension: found.value})
    lengths = [float(getattr(answer, name)) for name in ("length_ab", "length_bc", "length_cd")]
    assert bool(found.ok) == (float(found.margin) > 0)
    if min(lengths) <= 0:
        assert not bool(found.ok)


@pytest.mark.parametrize("dimension", sorted({*DIMENSIONS} - {*_QUADRATIC, "wall_angle_bc"}))
def test_the_equation_is_linear_in_what_is_said_to_be_linear(dimension):
    """η (T_B − T_C) − (T_C − T_D) times the depths has no second difference."""

    def equation(value):
        chamber = dataclasses.replace(make(), **{dimension: jnp.asarray(value)})
        image_b, image_c, image_d = chamber.image_heights().value
        return float((0.6 * (image_b - image_c) - (image_c - image_d)) * jnp.prod(chamber.depths))

    low, middle, high = equation(5.0), equation(10.0), equation(15.0)
    np.testing.assert_allclose(high - middle, middle - low, rtol=1e-9)


@pytest.mark.parametrize("method", get_args(RootMethod))
@pytest.mark.parametrize("dimension", ITERATED)
def test_iterations_agree_with_the_closed_form(dimension, method):
    chamber = make()
    expected = solve(chamber, dimension, 0.65)
    found = solve(chamber, dimension, 0.65, method=method, bracket=(-10.0, 20.0), tolerance=1e-13)
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

    design = (make(), jnp.asarray(0.65))
    found = [float(leaf) for leaf in jax.tree.leaves(jax.grad(answer)(design))]
    expected = central_differences(answer, design)
    scale = np.max(np.abs(expected))
    np.testing.assert_allclose(found, expected, rtol=GRADIENT, atol=DIFFERENCES * scale)


def test_of_two_answers_the_one_that_can_be_built_counts_then_the_nearer():
    chamber = make(wall_angle_bc=0.0, offset_d=-2.2, reference_height=1.0, offset_b=2.0)
    equation = np.polynomial.Polynomial.fit(
        xs := np.array([0.0, 1.0, 2.0]),
        [_pinhole_equation(chamber, x, ratio=0.05) for x in xs],
        deg=2,
    )
    low, high = sorted(equation.roots())
    for start in (low - 1, high + 1):
        sketch = dataclasses.replace(chamber, pinhole_offset=jnp.asarray(start))
        found = solve(sketch, "pinhole_offset", 0.05)
        buildable = [root for root in (low, high) if 40 + root > 0]
        expected = min(buildable, key=lambda root: abs(root - start))
        np.testing.assert_allclose(found.value, expected, rtol=1e-9)


def _pinhole_equation(chamber, offset, *, ratio):
    # η (T_B − T_C) − (T_C − T_D) times the three depths, from the image heights.
    moved = dataclasses.replace(chamber, pinhole_offset=jnp.asarray(offset))
    image_b, image_c, image_d = moved.image_heights().value
    return float((ratio * (image_b - image_c) - (image_c - image_d)) * jnp.prod(moved.depths))


def test_no_answer_is_reported_and_stays_finite():
    with_no_root = make(wall_angle_bc=0.0, offset_d=-10.0)
    found = solve_dimension_for_ratio(with_no_root, "pinhole_offset", 3.0)
    assert not bool(found.ok)
    assert float(found.margin) <= 0
    assert np.isfinite(found.value)
    # Nothing depends on Δl_D when D lies in the pinhole plane with B.
    blind = solve_dimension_for_ratio(make(pinhole_offset=-40.0), "offset_d", 0.6)
    assert bool(blind.result == ChamberResult.no_solution)
    gradient = jax.grad(lambda c: solve_dimension_for_ratio(c, "offset_d", 0.6).value)(
        make(pinhole_offset=-40.0)
    )
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(gradient))


def test_an_iteration_that_does_not_arrive_says_so():
    found = solve_dimension_for_ratio(
        make(), "offset_d", 0.65, method="bisection", bracket=(50.0, 60.0), tolerance=1e-13
    )
    assert bool(found.result == ChamberResult.not_converged)


def test_a_batch_with_failures_is_one_compiled_call():
    ratios = jnp.asarray([0.5, 0.6, 1e9])
    batched = jax.jit(
        jax.vmap(lambda ratio: solve_dimension_for_ratio(make(), "pinhole_offset", ratio))
    )
    found = batched(ratios)
    assert found.ok.tolist() == [True, True, False]
    assert [bool(message) for message in found.messages()] == [False, False, True]
    assert np.all(np.isfinite(found.value))


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
        found = solve_dimension_for_ratio(chamber, "offset_d", 1e9)
    assert not bool(found.ok)
    assert np.isfinite(found.value)
