"""A lens from pictures whose truth is the judge's: errors in deviations, wrong corners, faults."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import UserError
from optics.calibration import PupilModel
from optics.calibration.bundle import lens_of, parameters_of
from optics.calibration.lens import HeldOut, _simplest, calibrate_lens
from tests.optics.calibration.pictures import LENS, NOISE, POINTS, TRUTH, boards, sightings


@pytest.fixture(scope="module")
def fit():
    seen, wrong = sightings(*boards(0, 8), 1, wrong=0.03)
    return calibrate_lens(seen, LENS.size, "judge"), wrong


def test_the_lens_is_right_within_its_deviations(fit):
    found, _ = fit
    calibrated = found.calibrated
    angles = np.array([0.3, 0.6, 0.9, 1.15])

    def quantities(parameters):
        own = lens_of(parameters)
        heights = own.focal * own.projection.height(jnp.asarray(angles))
        return jnp.concatenate([parameters[:3], heights, own.shift(jnp.asarray(angles[2:]))])

    parameters = jnp.asarray(parameters_of(calibrated.lens))
    heights = LENS.focal * LENS.heights(angles)
    truth = [LENS.focal, *LENS.middle, *heights, *LENS.shifts(angles[2:])]
    off = np.asarray(quantities(parameters)) - truth
    slopes = np.asarray(jax.jacfwd(quantities)(parameters))
    # χ² of nine quantities: below 27.9 with a probability of 0.999.
    assert off @ np.linalg.solve(slopes @ calibrated.covariance @ slopes.T, off) < 27.9
    assert found.pupil is PupilModel.MOVING
    assert calibrated.noise == pytest.approx(NOISE, rel=0.1)
    # The median distance of a corner is 1.18 deviations; poses and lens add a little.
    assert calibrated.held_out == pytest.approx(1.18 * NOISE, rel=0.25)
    assert calibrated.pictures == 8
    assert calibrated.widest < np.radians(85.1)


def test_wrong_corners_are_left_out(fit):
    found, wrong = fit
    assert wrong.sum() > 5
    assert not np.any(found.used & wrong)
    right = np.isfinite(np.asarray(found.sightings.places)[..., 0]) & ~wrong
    assert np.mean(found.used[right]) > 0.995


def test_distances_and_angles_are_those_of_the_boards(fit):
    found, _ = fit
    turns, shifts = boards(0, 8)
    points = POINTS @ np.swapaxes(turns[..., :2], 1, 2) + shifts[:, None]
    middles = [one[used].mean(axis=0) for one, used in zip(points, found.used, strict=True)]
    np.testing.assert_allclose(found.distances(), np.linalg.norm(middles, axis=1), rtol=1e-3)
    straight = np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2])
    # The pupil moves forward by at most 1.5 mm, the boards are 18 mm away and more.
    assert np.all(found.angles() >= straight - 1e-3)
    assert np.all(found.angles() - straight < 0.1)


def test_the_pupil_is_fixed_where_nothing_shows_that_it_moves():
    still = LENS._replace(pupil=(0.0, 0.0))
    seen, _ = sightings(*boards(4, 8), 5, lens=still)
    found = calibrate_lens(seen, LENS.size)
    assert found.pupil is PupilModel.FIXED
    assert parameters_of(found.calibrated.lens)[-2:].tolist() == [0.0, 0.0]
    assert found.calibrated.deviations[-2:].tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("fixed", "moving", "pupil"),
    [
        # One picture that the others have nothing near, as a path tracer's lens had it.
        ([0.272, 0.051, 0.067, 0.061, 0.029, 0.045, 0.046, 0.047],
         [0.364, 0.049, 0.066, 0.060, 0.024, 0.041, 0.043, 0.032], PupilModel.MOVING),
        # One alone that shows it, and well.
        ([0.05, 0.05, 0.05, 0.4], [0.051, 0.05, 0.05, 0.05], PupilModel.MOVING),
        ([0.05, 0.06, 0.04, 0.05], [0.051, 0.059, 0.041, 0.049], PupilModel.FIXED),
    ],
)  # fmt: skip
def test_the_pupil_moves_if_pictures_show_it(fixed, moving, pupil):
    held_out = {
        model: HeldOut(0.05, np.square(errors))
        for model, errors in zip(PupilModel, (fixed, moving), strict=True)
    }
    assert _simplest(held_out) is pupil


def test_pictures_that_show_too_little_are_left_out(fit):
    turns, shifts = boards(0, 8)
    seen, _ = sightings(turns, shifts, 1)
    hidden = np.asarray(seen.deviations).copy()
    hidden[3, 5:] = np.inf
    found = calibrate_lens(type(seen)(seen.points, seen.places, jnp.asarray(hidden)), LENS.size)
    assert found.pictures.tolist() == [0, 1, 2, 4, 5, 6, 7]
    assert len(found.residuals) == 7


def test_a_lens_is_found_exactly_from_exact_corners():
    seen, _ = sightings(*boards(0, 8), 1, noise=0.0)
    found = calibrate_lens(seen, LENS.size).calibrated
    np.testing.assert_allclose(parameters_of(found.lens)[:3], TRUTH[:3], atol=1e-3)
    angles = np.linspace(0, found.widest, 50)
    heights = found.lens.focal * found.lens.projection.height(jnp.asarray(angles))
    # The prior of the lens, against corners that are exact to `LEAST_PX`, moves less.
    np.testing.assert_allclose(heights, LENS.focal * LENS.heights(angles), atol=1e-3)
    np.testing.assert_allclose(
        found.lens.shift(jnp.asarray(angles)), LENS.shifts(angles), atol=1e-3
    )
    assert found.noise < 1e-5


def test_too_few_pictures_are_an_error():
    seen, _ = sightings(*boards(0, 2), 1)
    with pytest.raises(UserError, match="2 of 2 pictures show at least 6 corners"):
        calibrate_lens(seen, LENS.size)


def test_corners_that_are_none_are_an_error():
    seen, _ = sightings(*boards(0, 8), 1)
    anywhere = np.random.default_rng(0).uniform(0, 900, seen.places.shape)
    with pytest.raises(UserError, match="no lens fits the pictures: half of the corners"):
        calibrate_lens(type(seen)(seen.points, jnp.asarray(anywhere), seen.deviations), LENS.size)


def test_pictures_are_numbered_as_given(fit):
    found, _ = fit
    assert found.pictures.tolist() == list(range(8))
    assert jax.tree.map(lambda leaf: leaf.shape[0], found.poses).shifts == 8
