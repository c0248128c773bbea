"""How far the image moves: against the formula by hand, differences, and what is hidden."""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import ChamberResult, solve_dimension_for_ratio
from optics.chamber import Endoscope, compute_wall_radii, find_extreme_points, solve_image_rates
from tests.helpers import central_differences
from tests.optics.soft_finger.marched import finger

CAMERA = Endoscope(math.radians(60.0), distortion=-0.1)
DOWN = math.pi / 2


solve_rates = eqx.filter_jit(solve_image_rates)
find_points = eqx.filter_jit(find_extreme_points)


def by_hand(chamber):
    """The formula of `solve_image_rates` in NumPy."""
    places = np.cumsum(
        [float(chamber.length_ab), float(chamber.length_bc), float(chamber.length_cd)]
    )
    depths, radii = places + float(chamber.pinhole_offset), np.asarray(compute_wall_radii(chamber))
    slopes = radii[1:] / depths
    moved = places**2 / 2 / depths + slopes**2 * places
    lens = 1 + 3 * float(CAMERA.distortion) * slopes**2
    return float(CAMERA.focal_px) * moved / places[-1] * lens


@pytest.mark.parametrize("direction", [0.0, DOWN, 2.5])
def test_rates_are_those_by_hand(direction):
    found = solve_rates(finger(), CAMERA, jnp.asarray(direction))
    assert bool(found.ok)
    np.testing.assert_allclose(found.value, by_hand(finger()), rtol=1e-12)


def test_rates_are_differences_of_the_points():
    high, low = (
        np.asarray(find_points(finger(), CAMERA, jnp.asarray(bend), DOWN).value)[:, 1]
        for bend in (1e-5, -1e-5)
    )
    found = solve_rates(finger(), CAMERA, jnp.asarray(DOWN)).value
    np.testing.assert_allclose(found, (high - low) / 2e-5, rtol=1e-7)


def test_slopes_of_the_rates_with_respect_to_the_design():
    @jax.jit
    def rates(knobs):
        eta, offset_b, angle = knobs
        chamber = dataclasses.replace(finger(), offset_b=offset_b, wall_angle_bc=angle)
        offset_d = solve_dimension_for_ratio(chamber, "offset_d", eta).value
        designed = dataclasses.replace(chamber, offset_d=offset_d)
        return jnp.sum(solve_image_rates(designed, CAMERA, DOWN).value)

    knobs = jnp.asarray([[0.6, 2.0, math.radians(2.0)], [0.9, 3.0, math.radians(1.2)]])
    found = jax.jit(jax.vmap(jax.grad(rates)))(tuple(knobs.T))
    for one, slopes in zip(knobs, np.transpose(found), strict=True):
        expected = central_differences(rates, tuple(one))
        np.testing.assert_allclose(slopes, expected, rtol=1e-6, atol=1e-6)


def test_points_that_the_wall_hides_are_said_to_be():
    near, far = (
        find_points(finger(), CAMERA, jnp.asarray(math.radians(deg)), DOWN) for deg in (10.0, 90.0)
    )
    assert bool(near.ok)
    assert float(near.margin) > 0
    assert far.messages() == [ChamberResult[ChamberResult.hidden]]
    assert float(far.margin) < 0
    assert np.isfinite(np.asarray(far.value)).all()


@pytest.mark.parametrize("changed", [{"offset_d": 9.0}, {"pinhole_offset": -45.0}])
def test_a_chamber_without_an_image_has_no_rates(changed):
    changed = {name: jnp.asarray(value) for name, value in changed.items()}
    found = solve_rates(dataclasses.replace(finger(), **changed), CAMERA, jnp.asarray(DOWN))
    assert found.messages() == [ChamberResult[ChamberResult.hidden]]
    assert np.isfinite(np.asarray(found.value)).all()


def test_the_margin_is_a_width_in_the_image():
    camera = Endoscope(math.radians(60.0))
    # On the other side, points are those of the finger bent the other way.
    found, other = (
        find_points(finger(), camera, jnp.asarray(math.radians(deg)), 0.0) for deg in (50.0, -50.0)
    )
    top = float(found.value[2, 0]) - (640 - 1 - float(other.value[2, 0]))
    assert float(found.margin) * float(camera.focal_px) == pytest.approx(top, rel=1e-9)
