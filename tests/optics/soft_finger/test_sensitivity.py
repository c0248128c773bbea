"""How far the image moves: against differences, and what is hidden."""

import dataclasses
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from optics import ChamberResult, solve_dimension_for_ratio
from optics.chamber import Endoscope, find_extreme_points, solve_image_rates
from tests.helpers import check_gradients
from tests.optics.chambers import chamber as finger

CAMERA = Endoscope(math.radians(60.0), distortion=-0.1)
DOWN = math.pi / 2


solve_rates = eqx.filter_jit(solve_image_rates)
find_points = eqx.filter_jit(find_extreme_points)


@pytest.mark.parametrize("direction", [0.0, DOWN, 2.5])
def test_rates_are_differences_of_the_points(direction):
    high, low = (
        find_points(finger(), CAMERA, jnp.asarray(bend), jnp.asarray(direction)).value
        for bend in (1e-5, -1e-5)
    )
    found = solve_rates(finger(), CAMERA, jnp.asarray(direction))
    assert bool(found.ok)
    ahead = np.array([np.cos(direction), np.sin(direction)])
    np.testing.assert_allclose(found.value, (high - low) @ ahead / 2e-5, rtol=1e-7)


def test_slopes_of_the_rates_with_respect_to_the_design():
    def rates(knobs):
        eta, offset_b, angle = knobs
        chamber = dataclasses.replace(finger(), offset_b=offset_b, wall_angle_bc=angle)
        offset_d = solve_dimension_for_ratio(chamber, "offset_d", eta).value
        designed = dataclasses.replace(chamber, offset_d=offset_d)
        return jnp.sum(solve_image_rates(designed, CAMERA, DOWN).value)

    knobs = jnp.asarray([[0.6, 2.0, math.radians(2.0)], [0.9, 3.0, math.radians(1.2)]])
    check_gradients(rates, tuple(knobs.T), rtol=1e-6, atol=1e-6)


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
