"""Predicted deviations against the scatter of fits, and suggested pictures against those taken."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from designopt.fitting import add_information
from optics.calibration import CalibratedLens
from optics.calibration.bundle import Poses, Prior, Sightings, adjust, lens_of, parameters_of
from optics.calibration.guidance import (
    GRID,
    _board_slopes,
    _boards,
    _information,
    _slopes,
    predict_deviations,
    suggest_pictures,
)
from optics.calibration.lens import calibrate_lens
from optics.calibration.prior import prior_of
from tests.optics.calibration.pictures import LENS, NOISE, POINTS, TRUTH, boards, sightings

DISTANCE = 30.0


@pytest.fixture(scope="module")
def few():
    """A lens from pictures of its middle."""
    turns, shifts = boards(0, 5)
    shifts = np.linalg.norm(shifts, axis=1)[:, None] * [0.1, -0.1, 0.99]
    seen, _ = sightings(turns, shifts, 1)
    return calibrate_lens(seen, LENS.size), turns, shifts


def rigidly_left(points, off):
    """What a small rotation and translation of the points leave of changes of their places."""
    size, columns = 1e-5, []
    for axis in np.eye(3):
        for moved in (
            points @ Rotation.from_rotvec(size * axis).as_matrix().T,
            points + size * axis,
        ):
            columns.append((LENS.project(moved) - LENS.project(points)).ravel() / size)
    basis = np.linalg.qr(np.array(columns).T)[0]
    return off - basis @ (basis.T @ off)


def test_deviations_are_the_scatter_of_fits_without_a_motion_of_the_camera():
    # A prior without weight: what it adds to a deviation does not scatter.
    prior = Prior(TRUTH, np.diag([1e3, 1e3, 1e3, *6 * [1e2]]))
    turns, shifts = boards(0, 4)
    poses = Poses(jnp.asarray(turns), jnp.asarray(shifts))

    def fitted(seed):
        seen, _ = sightings(turns, shifts, 100 + seed)
        weighted = Sightings(seen.points, seen.places, seen.deviations * NOISE)
        return adjust(weighted, lens_of(jnp.asarray(TRUTH)), poses, prior, robust=False)

    one = fitted(0)
    calibrated = CalibratedLens(one.lens, LENS.size, one.covariance, NOISE, 0, 1.2, (18, 45), 4)
    found = predict_deviations(calibrated, DISTANCE)
    assert found.places.shape == (GRID[1], GRID[0], 2)
    imaged = np.isfinite(found.deviations)
    rays, before = one.lens.rays(jnp.asarray(found.places[imaged]))
    points = DISTANCE * np.asarray(rays) + np.asarray(before)[:, None] * [0, 0, 1]
    # Places of the true lens differ from those of the fit by less than a pixel.
    there = np.isfinite(LENS.project(points)[:, 0])
    assert np.mean(there) > 0.9
    off = []
    for seed in range(1, 26):
        places = np.asarray(fitted(seed).lens.places(jnp.asarray(points[there])))
        off.append(rigidly_left(points[there], (places - LENS.project(points[there])).ravel()))
    scatter = np.sqrt(np.mean(np.square(off), axis=0).reshape(-1, 2).mean(axis=1))
    predicted = found.deviations[imaged][there]
    # 25 draws of the few parameters that matter determine a deviation to 15 %.
    ratio = np.sqrt(np.mean(scatter**2) / np.mean(predicted**2))
    assert 0.65 < ratio < 1.5
    assert np.corrcoef(np.log(scatter), np.log(predicted))[0, 1] > 0.8


@pytest.mark.parametrize(
    "coefficients",
    # Heights that end to rise at 85°, 298 px from the middle; and at 105°, to where Newton's method
    # from r/f does not lead.
    [(-0.15, 0.0, 0.0, 0.0), (1 / 12, 1 / 120, 0.0, -0.002)],
)
def test_deviations_and_boards_are_of_the_image_alone(coefficients):
    lens = lens_of(jnp.array([300.0, *LENS.middle, *coefficients, 0.0, 0.0]))
    calibrated = CalibratedLens(
        lens, LENS.size, np.diag([1.0, 0.1, 0.1, *6 * [1e-4]]), NOISE, 0, 1.4, (18, 45), 4
    )
    found = predict_deviations(calibrated, DISTANCE)
    # Its rays by a search that keeps to where the height rises.
    most = 0.999 * lens.projection.widest
    widest = min(1.15 * 1.4, most)

    def height(angle):
        return 300.0 * float(lens.projection.height(jnp.array(angle)))

    away = np.linalg.norm(found.places - LENS.middle, axis=-1)
    imaged = away <= height(widest)
    assert 0.2 < np.mean(imaged) < 1
    assert np.array_equal(np.isfinite(found.deviations), imaged)
    angles = np.array([brentq(lambda a, r=r: height(a) - r, 0, widest) for r in away[imaged]])
    assert np.array_equal(found.reached[imaged], angles <= 1.4)
    outwards = (found.places[imaged] - LENS.middle) / away[imaged][:, None]
    points = DISTANCE * np.column_stack([np.sin(angles)[:, None] * outwards, np.cos(angles)])
    by_lens, by_motion = map(
        np.asarray, _slopes(jnp.asarray(parameters_of(lens)), jnp.asarray(points))
    )
    basis = np.linalg.qr(by_motion.reshape(-1, 6) / np.linalg.norm(by_motion, axis=(0, 1)))[0]
    flat = by_lens.reshape(-1, by_lens.shape[-1])
    left = (flat - basis @ (basis.T @ flat)).reshape(by_lens.shape)
    variances = np.einsum("nci,ij,ncj->n", left, calibrated.covariance, left) / 2
    assert np.allclose(found.deviations[imaged], np.sqrt(variances), rtol=1e-4)
    boards = list(_boards(calibrated, (15.0, 30.0, 60.0)))
    assert max(one.angle for one in boards) <= 0.95 * widest + 1e-9


def test_suggested_pictures_lower_the_deviations_as_predicted(few):
    fit, _, _ = few
    first_map = predict_deviations(fit.calibrated, DISTANCE)
    before = first_map.rms
    suggestions = suggest_pictures(fit.calibrated, POINTS, (15.0, 60.0))
    assert 1 <= len(suggestions) <= 3
    predicted = [one.deviation for one in suggestions]
    assert predicted == sorted(predicted, reverse=True)
    assert predicted[0] < 0.9 * before
    first = suggestions[0]
    assert first.distance == pytest.approx(15) or 15 < first.distance < 61
    # Take it: a board whose middle is there, turned as stated, by the outline of its points.
    imaged = np.isfinite(first.outline[:, 0])
    assert np.mean(imaged) >= 0.4
    taken = np.asarray(fit.sightings.places).copy()
    more = Sightings(
        jnp.asarray(np.concatenate([fit.sightings.points, POINTS[None]])),
        jnp.asarray(np.concatenate([taken, first.outline[None]])),
        jnp.asarray(
            np.concatenate([fit.sightings.deviations, np.where(imaged, 1.0, np.inf)[None]])
        ),
    )
    after = predict_deviations(calibrate_lens(more, LENS.size).calibrated, DISTANCE)
    # At the same places, but for few that the image is not supposed to have any more.
    left = after.deviations[first_map.reached]
    assert np.sqrt(np.nanmean(left**2)) < 0.7 * before


def test_a_picture_adds_its_information():
    """The covariance with a picture more, as adjustment has it."""
    prior = prior_of(lens_of(jnp.asarray(TRUTH)), LENS.size)
    every = jax.tree.map(np.asarray, sightings(*boards(7, 6), 8, noise=1e-9)[0])
    poses = Poses(*map(jnp.asarray, boards(7, 6)))

    def covariance(count):
        some = Sightings(
            *(jnp.asarray(leaf[:count]) for leaf in (every.points, every.places, every.deviations))
        )
        own = jax.tree.map(lambda leaf: leaf[:count], poses)
        return adjust(some, lens_of(jnp.asarray(TRUTH)), own, prior, robust=False).covariance

    given = jnp.asarray(TRUTH), poses.turns[5:], poses.shifts[5:], jnp.asarray(POINTS)
    _, _, by_lens, by_pose = map(np.asarray, _board_slopes(*given))
    which = np.isfinite(every.deviations[5])
    expected = covariance(6)
    found = add_information(covariance(5), _information(by_lens[0][which], by_pose[0][which]))
    size = np.sqrt(np.diagonal(expected))
    np.testing.assert_allclose(
        found / size / size[:, None], expected / size / size[:, None], atol=0.02
    )


def test_nothing_is_suggested_where_nothing_helps(few):
    fit, _, _ = few
    sure = fit.calibrated.__class__(
        **{**vars(fit.calibrated), "covariance": 1e-12 * fit.calibrated.covariance}
    )
    assert suggest_pictures(sure, POINTS, (15.0, 60.0)) == []
