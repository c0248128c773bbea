"""Bundle adjustment against SciPy's, and poses against those of which boards were drawn."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.ndimage
import scipy.optimize
from scipy.spatial.transform import Rotation

from optics.calibration.bundle import Poses, Prior, adjust, find_poses, lens_of, parameters_of, turn
from optics.calibration.fisheye import Fisheye
from optics.calibration.prior import prior_of
from optics.calibration.starts import find_starts
from tests.optics.calibration.pictures import LENS, NOISE, POINTS, TRUTH, boards, sightings

WIDE = Prior(np.array([300.0, 639.5, 479.5, *6 * [0.0]]), np.diag([1e3, 1e3, 1e3, *6 * [1e2]]))
START = Fisheye(300.0, jnp.array([639.5, 479.5]), jnp.zeros(4), jnp.zeros(2))


def scipy_fit(turns, shifts, seen):
    """Lens and covariance by SciPy's trust region, its own differences, and its own rotations."""
    places, there = np.asarray(seen.places), np.asarray(seen.used)

    def project(lens, points):
        off = np.hypot(points[:, 0], points[:, 1])
        angle = np.arctan2(off, points[:, 2])
        for _ in range(30):  # a fixed point: the pupil moves by less than the board is away
            shift = lens[7] * angle**2 + lens[8] * angle**4
            angle = np.arctan2(off, points[:, 2] - shift)
        radius = lens[0] * (angle + sum(lens[3 + i] * angle ** (2 * i + 3) for i in range(4)))
        return lens[1:3] + (radius / off)[:, None] * points[:, :2]

    def residuals(values):
        lens, poses = values[:9] * scale, values[9:].reshape(-1, 6)
        left = []
        for pose, seen_places, which in zip(poses, places, there, strict=True):
            matrix = Rotation.from_rotvec(pose[:3]).as_matrix()
            points = POINTS[which] @ matrix[:, :2].T + pose[3:]
            left.append((project(lens, points) - seen_places[which]) / NOISE)
        return np.concatenate(left).ravel()

    scale = np.array([100.0, 100, 100, 0.1, 0.01, 1e-3, 1e-4, 1.0, 0.1])
    poses = np.concatenate([Rotation.from_matrix(turns).as_rotvec(), shifts], axis=1)
    begin = np.concatenate(
        [np.array([350.0, 644, 471, *4 * [0.0], 0.6, 0.03]) / scale, poses.ravel()]
    )
    fit = scipy.optimize.least_squares(residuals, begin, x_scale="jac", xtol=1e-14, ftol=1e-14)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)[:9, :9] * scale * scale[:, None]
    return fit.x[:9] * scale, covariance


def test_a_rotation_vector_is_scipys():
    for vector in (np.array([0.3, -1.2, 2.0]), np.array([1e-8, 2e-8, 0.0]), np.zeros(3)):
        expected = Rotation.from_rotvec(vector).as_matrix()
        np.testing.assert_allclose(turn(jnp.asarray(vector)), expected, atol=1e-14)


def test_lens_and_covariance_are_those_of_scipy():
    turns, shifts = boards(0, 4)
    seen, _ = sightings(turns, shifts, 1)
    weighted = type(seen)(seen.points, seen.places, seen.deviations * NOISE)
    found = adjust(
        weighted, START, Poses(jnp.asarray(turns), jnp.asarray(shifts)), WIDE, robust=False
    )
    assert found.solved
    expected, covariance = scipy_fit(turns, shifts, seen)
    deviations = np.sqrt(np.diagonal(covariance))
    # Both searches end within a hundredth of a deviation of the minimum.
    np.testing.assert_allclose((parameters_of(found.lens) - expected) / deviations, 0.0, atol=0.01)
    correlations = found.covariance / deviations / deviations[:, None]
    np.testing.assert_allclose(
        correlations, covariance / deviations / deviations[:, None], atol=2e-3
    )


def test_deviations_are_the_scatter_of_repeated_fits():
    turns, shifts = boards(0, 4)
    poses, off = Poses(jnp.asarray(turns), jnp.asarray(shifts)), []
    for seed in range(40):
        seen, _ = sightings(turns, shifts, seed)
        weighted = type(seen)(seen.points, seen.places, seen.deviations * NOISE)
        found = adjust(weighted, lens_of(jnp.asarray(TRUTH)), poses, WIDE, robust=False)
        errors = parameters_of(found.lens) - TRUTH
        off.append(errors @ np.linalg.solve(found.covariance, errors))
    # χ² of 360 degrees of freedom, whose mean over them is known to 7.5 %.
    np.testing.assert_allclose(np.mean(off) / 9, 1.0, atol=0.2)


def test_scatter_is_that_of_image_heights_where_neighbors_are_off_together():
    turns, shifts = boards(0, 12)
    poses, squares, scatters = Poses(jnp.asarray(turns), jnp.asarray(shifts)), [], []
    shares, generator = np.array([0.5, 0.9, 1.3]), np.random.default_rng(0)
    # Eight coefficients, as calibration fits them, of which the last four are 0.
    truth = np.insert(TRUTH, 7, np.zeros(4))
    prior = prior_of(lens_of(jnp.asarray(truth)), LENS.size)

    def heights(lens):
        own = lens_of(lens)
        return own.focal * own.projection.height(jnp.asarray(shares))

    slopes = np.asarray(jax.jacfwd(heights)(jnp.asarray(truth)))
    exact, _ = sightings(turns, shifts, 0, noise=0.0)
    for _ in range(24):
        # Of the mean of three by three neighbors a corner has a third of the deviation.
        noise = generator.normal(0, 3 * NOISE, (12, 2, 9, 11))
        noise = scipy.ndimage.uniform_filter(noise, 3, axes=(2, 3))[..., 1:-1, 1:-1]
        off = np.moveaxis(noise, 1, -1).reshape(12, -1, 2)
        seen = type(exact)(exact.points, exact.places + off, exact.deviations * NOISE)
        found = adjust(seen, lens_of(jnp.asarray(truth)), poses, prior, robust=False)
        errors = np.asarray(heights(jnp.asarray(parameters_of(found.lens)))) - np.asarray(
            heights(jnp.asarray(truth))
        )
        spread = np.einsum("hi,ij,hj->h", slopes, found.covariance, slopes)
        squares.append(errors**2 / spread)
        scatters.append(found.scatter)
    plain, scatter = np.array(squares), np.array(scatters)[:, None]
    assert np.sqrt(np.mean(plain)) > 1.5
    # Compared in the lens's parameters alone, pictures would leave 1.2 of it.
    assert np.sqrt(np.mean(plain / scatter)) == pytest.approx(1.0, abs=0.15)


def test_a_held_parameter_stays_where_it_is():
    turns, shifts = boards(0, 4)
    seen, _ = sightings(turns, shifts, 1)
    mean, root = WIDE.mean.copy(), WIDE.root.copy()
    mean[7:], root[7:] = (0.4, 0.0), 0.0
    poses = Poses(jnp.asarray(turns), jnp.asarray(shifts))
    found = adjust(seen, START, poses, Prior(mean, root), robust=False)
    assert parameters_of(found.lens)[7:].tolist() == [0.4, 0.0]
    assert not found.covariance[7:].any()
    assert found.covariance[0, 0] > 0


def test_starts_are_near_the_truth_and_poses_end_there():
    turns, shifts = boards(2, 4)
    seen, _ = sightings(turns, shifts, 3, noise=1e-6)
    lens, poses, error = find_starts(seen, LENS.size)[0]
    assert abs(float(lens.focal) / LENS.focal - 1) < 0.25
    assert 0 < error < 20
    for found, true in zip(poses.turns, turns, strict=True):
        assert Rotation.from_matrix(np.asarray(found).T @ true).magnitude() < 0.25
    # With the true lens, poses are the true ones.
    found, left = find_poses(lens_of(jnp.asarray(TRUTH)), seen, poses)
    np.testing.assert_allclose(found.turns, turns, atol=1e-6)
    np.testing.assert_allclose(found.shifts, shifts, atol=1e-4)
    assert np.abs(left).max() < 1e-4
