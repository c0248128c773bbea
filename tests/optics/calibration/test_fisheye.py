"""A lens in space against roots in 30 digits, the plane camera, and central differences."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np

from optics import Camera, Imaging, KannalaBrandt
from optics.calibration import Fisheye
from optics.calibration.bundle import lens_of

PARAMETERS = np.array([351.0, 644.2, 470.9, -0.04, 0.003, -0.0006, 0.0001, 0.7, -0.04])
LENS = lens_of(PARAMETERS)
POINTS = np.array(
    [[12.0, -7.0, 20.0], [-30.0, 1.0, 4.0], [3.0, 40.0, -6.0], [0.0, 0.0, 25.0], [1e-7, 0.0, 15.0]]
)


def place_in_many_digits(x, y, z):
    """The root of the ray's equation by secants in 30 digits, and its place."""
    with mpmath.workdps(30):
        focal, column, row, *k, e2, e4 = map(mpmath.mpf, PARAMETERS.tolist())
        off = mpmath.hypot(x, y)
        angle = mpmath.findroot(
            lambda a: off * mpmath.cos(a) - (z - e2 * a**2 - e4 * a**4) * mpmath.sin(a),
            mpmath.atan2(off, z),
        )
        radius = focal * (angle + sum(k[i] * angle ** (2 * i + 3) for i in range(4)))
        return [float(column + radius * x / off), float(row + radius * y / off)]


def test_places_are_those_of_roots_in_many_digits():
    for point in POINTS[[0, 1, 2, 4]]:
        expected = place_in_many_digits(*point.tolist())
        np.testing.assert_allclose(LENS.places(jnp.asarray(point)), expected, atol=1e-9)
    np.testing.assert_allclose(LENS.places(jnp.asarray(POINTS[3])), PARAMETERS[1:3], atol=1e-12)


def test_places_without_a_moving_pupil_are_those_of_the_camera():
    still = Fisheye(LENS.focal, jnp.array([639.5, 479.5]), LENS.coefficients, jnp.zeros(2))
    projection = KannalaBrandt(LENS.coefficients)
    field = 2 * float(projection.angle(jnp.asarray(480 / 351.0)))
    camera = Camera(jnp.zeros(2), 0.0, field, 960.0, projection)
    points = POINTS[:2]
    angle = np.arctan2(-points[:, 1], points[:, 2])
    slope = points[:, 0] / np.hypot(points[:, 1], points[:, 2])
    expected = Imaging.of(camera).place(jnp.asarray(angle), jnp.asarray(slope))
    np.testing.assert_allclose(still.places(jnp.asarray(points)), expected, atol=1e-9)


def test_rays_pass_through_what_is_imaged():
    places = LENS.places(jnp.asarray(POINTS))
    rays, before = LENS.rays(places)
    begin = np.asarray(before)[:, None] * np.array([0.0, 0.0, 1.0])
    off = np.cross(np.asarray(rays), POINTS - begin)
    np.testing.assert_allclose(off, 0.0, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0, atol=1e-12)
    assert np.all(np.sum(np.asarray(rays) * (POINTS - begin), axis=-1) > 0)


def test_derivatives_are_central_differences():
    def places(parameters, points):
        return lens_of(parameters).places(points)

    given = PARAMETERS, POINTS[:4]
    by_lens, by_point = jax.jit(jax.jacfwd(places, (0, 1)))(*map(jnp.asarray, given))
    for slopes, steps, number in (
        (by_lens, 1e-6 * np.maximum(np.abs(PARAMETERS), 1e-2) * np.eye(9), 0),
        (jnp.einsum("nknj->nkj", by_point), 1e-6 * np.eye(3), 1),
    ):
        for i, step in enumerate(steps):
            ends = []
            for sign in (1, -1):
                moved = list(given)
                moved[number] = moved[number] + sign * step
                ends.append(np.asarray(places(*map(jnp.asarray, moved))))
            high, low = ends
            np.testing.assert_allclose(
                slopes[..., i], (high - low) / (2 * step[i]), rtol=1e-5, atol=1e-4
            )


def test_a_point_at_the_pupil_has_finite_values_and_derivatives():
    value, slope = jax.value_and_grad(lambda p: jnp.sum(LENS.places(p)))(jnp.zeros(3))
    assert np.isfinite(value)
    assert np.all(np.isfinite(slope))
