"""Distances of outlines, by Shapely."""

from __future__ import annotations

import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely

from kinematics.solve.clearance import find_separation

COUNTS = list(itertools.product((1, 2, 3), repeat=2))
CASES = 500


def pairs_of_hulls(first: int, second: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng([first, second])
    apart = 1.5 * generator.normal(size=(CASES, 1, 2))
    one, other = (generator.normal(size=(CASES, count, 2)) for count in (first, second))
    return one, other + apart


def hull(corners: np.ndarray) -> Any:
    return shapely.convex_hull(shapely.multipoints(corners))


@pytest.mark.parametrize(("first", "second"), COUNTS)
def test_it_is_the_distance_of_the_hulls_or_the_way_out(first, second):
    """The way out is the distance of the origin from the border of the hulls' difference."""
    one, other = pairs_of_hulls(first, second)
    found = np.asarray(jax.jit(find_separation)(one, other))
    distance = [shapely.distance(hull(a), hull(b)) for a, b in zip(one, other, strict=True)]
    np.testing.assert_allclose(np.maximum(found, 0), distance, atol=1e-12)
    inside = np.flatnonzero(found < 0)
    assert (len(inside) > 5) == (first + second > 3)
    for case in inside:
        difference = hull((other[case][None] - one[case][:, None]).reshape(-1, 2))
        out = shapely.distance(shapely.boundary(difference), shapely.Point(0, 0))
        assert found[case] == pytest.approx(-out, abs=1e-12)
        assert difference.contains(shapely.Point(0, 0))


@pytest.mark.parametrize(("first", "second"), COUNTS)
def test_its_slopes_are_central_differences(first, second):
    one, other = pairs_of_hulls(first, second)
    both = np.concatenate([one, other], axis=1)

    def separation(corners: jax.Array) -> jax.Array:
        return find_separation(corners[:first], corners[first:])

    slopes = np.asarray(jax.jit(jax.vmap(jax.grad(separation)))(both))
    values, step = jax.jit(jax.vmap(separation)), 1e-6
    for corner, axis in itertools.product(range(first + second), range(2)):
        moved = np.zeros_like(both)
        moved[:, corner, axis] = step
        difference = (values(both + moved) - values(both - moved)) / (2 * step)
        # Where another corner is as near, within the step, there is a kink.
        off = np.abs(difference - slopes[:, corner, axis]) > 1e-7
        assert off.mean() < 0.005


@pytest.mark.parametrize(("first", "second"), COUNTS)
def test_slopes_are_finite_where_corners_coincide(first, second):
    one, other = jnp.zeros((first, 2)), jnp.zeros((second, 2))
    for shift in (0.0, 1.0):
        value, slopes = jax.value_and_grad(find_separation, (0, 1))(one, other + shift)
        assert float(value) == pytest.approx(shift * np.sqrt(2))
        assert all(np.isfinite(slope).all() for slope in slopes)


def test_batches_broadcast():
    bar = jnp.array([[0.0, 0.0], [4.0, 0.0]])
    pins = jnp.array([[[7.0, 4.0]], [[2.0, 3.0]], [[-1.0, 0.0]]])
    np.testing.assert_allclose(find_separation(bar, pins), [5.0, 3.0, 1.0])
