"""How far the image moves: against the formula by hand, differences, and what is hidden."""

import dataclasses
import math

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


def by_hand(chamber, camera):
    """The formula of `solve_image_rates`, number by number."""
    length = float(chamber.length_ab + chamber.length_bc + chamber.length_cd)
    offset, k1 = float(chamber.pinhole_offset), float(camera.distortion)
    places = np.cumsum([float(chamber.length_ab), float(chamber.length_bc),
                        float(chamber.length_cd)])  # fmt: skip
    rates = []
    for s, r in zip(places, np.asarray(compute_wall_radii(chamber))[1:], strict=True):
        depth = s + offset
        sideways = s**2 / 2 / depth
        turn = r**2 * s / depth**2
        lens = 1 + 3 * k1 * (r / depth) ** 2
        rates.append(float(camera.focal_px) * (sideways + turn) / length * lens)
    return np.array(rates)


@pytest.mark.parametrize("direction", [0.0, DOWN, 2.5])
def test_rates_are_those_by_hand(direction):
    found = solve_image_rates(finger(), CAMERA, direction)
    assert bool(found.ok)
    np.testing.assert_allclose(found.value, by_hand(finger(), CAMERA), rtol=1e-12)


def test_rates_are_differences_of_the_points():
    def lowest(bend):
        return find_extreme_points(finger(), CAMERA, bend, DOWN).value[:, 1]

    step = 1e-5
    differences = (np.asarray(lowest(step)) - np.asarray(lowest(-step))) / (2 * step)
    np.testing.assert_allclose(
        solve_image_rates(finger(), CAMERA, DOWN).value, differences, rtol=1e-7
    )


def test_slopes_of_the_rates_with_respect_to_the_design():
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
        find_extreme_points(finger(), CAMERA, math.radians(deg), 0.0) for deg in (10.0, 90.0)
    )
    assert bool(near.ok)
    assert float(near.margin) > 0
    assert far.messages() == [ChamberResult[ChamberResult.hidden]]
    assert float(far.margin) < 0
    assert np.isfinite(np.asarray(far.value)).all()


@pytest.mark.parametrize("changed", [{"offset_d": 9.0}, {"pinhole_offset": -45.0}])
def test_a_chamber_without_an_image_has_no_rates(changed):
    changed = {name: jnp.asarray(value) for name, value in changed.items()}
    found = solve_image_rates(dataclasses.replace(finger(), **changed), CAMERA, DOWN)
    assert found.messages() == [ChamberResult[ChamberResult.hidden]]
    assert np.isfinite(np.asarray(found.value)).all()


def test_the_margin_is_a_width_in_the_image():
    bend = math.radians(50.0)
    found = find_extreme_points(finger(), Endoscope(math.radians(60.0)), bend, 0.0)
    # On the other side, points are those of the finger bent the other way.
    other = find_extreme_points(finger(), Endoscope(math.radians(60.0)), -bend, 0.0)
    center = (640 - 1) / 2
    top = float(found.value[2, 0]) - (2 * center - float(other.value[2, 0]))
    assert float(found.margin) * float(CAMERA.focal_px) == pytest.approx(top, rel=1e-9)
