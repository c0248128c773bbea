"""The rings of the straight finger against paper A's image heights, and presses against circles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import Chamber
from optics.chamber import Rings, compute_wall_radii, press_wall
from tests.helpers import check_gradients
from tests.optics.chambers import chamber as finger
from tests.optics.soft_finger.marched import Tube

ROUNDING = 1e-13  # relative
GRADIENT = 1e-8

CHAMBERS = {
    "fitted": finger(),
    "printed": finger().as_printed(),
    "other": finger(
        length_ab=22.0, length_bc=31.0, length_cd=17.0, wall_angle_bc=np.deg2rad(6.0), offset_d=1.0
    ),
}
every_chamber = pytest.mark.parametrize("chamber", CHAMBERS.values(), ids=CHAMBERS.keys())


def ends_of(chamber: Chamber, per_region: int = 20) -> tuple[np.ndarray, float]:
    """Tangents at which the regions' ends are seen, and the ratio of their distances."""
    rings = Rings.of(chamber, per_region)
    ends = np.array(rings.ends)
    b, c, d = np.asarray(rings.radius)[ends] / (
        np.asarray(rings.arc)[ends] + float(rings.pinhole_offset)
    )
    return np.array([b, c, d]), (c - d) / (b - c)


@every_chamber
def test_straight_rings_are_imaged_where_the_paper_has_them(chamber: Chamber):
    slopes, ratio = ends_of(chamber)
    heights = chamber.image_heights()
    assert bool(heights.ok)
    gap = float(chamber.focal_length) - float(chamber.image_distance)
    np.testing.assert_allclose(gap * slopes, heights.value, rtol=ROUNDING)
    assert ratio == pytest.approx(float(chamber.imaging_ratio().value))


@every_chamber
@pytest.mark.parametrize("per_region", [1, 20])
def test_rings_lie_evenly_on_the_wall(chamber, per_region):
    tube, rings = Tube.of(chamber), Rings.of(chamber, per_region)
    np.testing.assert_allclose(compute_wall_radii(chamber), tube.radii, rtol=ROUNDING)
    arcs = np.interp(np.arange(1, 3 * per_region + 1) / per_region, range(4), tube.arcs)
    np.testing.assert_allclose(rings.arc, arcs, rtol=ROUNDING)
    np.testing.assert_allclose(rings.radius, np.interp(arcs, tube.arcs, tube.radii), rtol=ROUNDING)
    assert float(rings.length) == pytest.approx(tube.arcs[-1])
    assert float(rings.pinhole_offset) == tube.pinhole
    np.testing.assert_allclose(np.asarray(rings.arc)[list(rings.ends)], tube.arcs[1:])
    middles = arcs - 1e-6
    np.testing.assert_array_equal(rings.region, np.searchsorted(tube.arcs[1:], middles))


def pressed(arcs: np.ndarray, place: float, radius: float, depth: float) -> np.ndarray:
    values = (jnp.asarray(value) for value in (place, radius, depth))
    return np.asarray(press_wall(jnp.asarray(arcs), *values))


@pytest.mark.parametrize("depth", [1e-4, 0.01, 0.3])
@pytest.mark.parametrize("radius", [5.0, 40.0])
def test_a_shallow_press_is_a_circle(depth, radius):
    # Where a circle sinks in, x² < 2 r d, and its sagitta is the parabola's + x⁴/8r³ + …, the more.
    place = 40.0
    half = np.sqrt(2 * radius * depth)
    arcs = place + half * np.linspace(-1.5, 1.5, 31)
    off = arcs - place
    sagitta = off**2 / (radius + np.sqrt(radius**2 - off**2))
    circle = np.maximum(depth - sagitta, 0)
    found = pressed(arcs, place, radius, depth)
    left = found - circle
    bound = depth**2 / (2 * radius)  # x⁴/8r³ at x² = 2 r d, and the series' next term
    assert left.min() > -1e-12 * depth
    assert left.max() < bound * (1 + depth / radius)
    assert found.max() == pytest.approx(depth)
    assert not found[np.abs(off) > half].any()
    assert (found[np.abs(off) < 0.99 * half] > 0).all()


def test_a_negative_depth_presses_the_other_side():
    arcs = np.linspace(0, 100, 41)
    np.testing.assert_array_equal(pressed(arcs, 40.0, 20.0, -3.0), -pressed(arcs, 40.0, 20.0, 3.0))
    assert pressed(arcs, 40.0, 20.0, -3.0).min() == pytest.approx(-3)
    assert not pressed(arcs, 40.0, 20.0, 0.0).any()


def test_gradients_of_a_press_are_central_differences():
    arcs = jnp.asarray(np.linspace(1, 99, 15))
    weights = jnp.asarray(np.random.default_rng(0).normal(size=15))

    def deep(values: tuple[jax.Array, jax.Array, jax.Array]) -> jax.Array:
        return jnp.sum(weights * press_wall(arcs, *values))

    points = jnp.array([[40.0, 20.0, 3.0], [61.0, 35.0, -4.0], [5.0, 8.0, 0.5], [48.0, 9.0, 1.0]])
    check_gradients(deep, tuple(points.T), atol=GRADIENT)
    # An object that does not press at all: finite.
    assert np.isfinite(jax.jit(jax.grad(deep))((40.0, 20.0, 0.0))).all()
