"""The lens as perception takes it, against the camera's own projection, and against OpenCV's."""

import cv2
import jax.numpy as jnp
import numpy as np
import pytest

from optics import Camera, Imaging
from optics.scene.camera import Equidistant, KannalaBrandt, Pinhole, Projection, Stereographic
from studies.models.sensor.estimators import lens_of

COEFFICIENTS = np.array([0.05, -0.02, 0.003, -0.0002])

OFFSET = 3.0, -2.0
"""Of the axis, px."""


@pytest.mark.parametrize(
    ("projection", "widest"),
    [
        (Equidistant(), 1.9),
        (Pinhole(), np.radians(80.0)),
        (Stereographic(), 2.0),
        (KannalaBrandt(COEFFICIENTS), 1.6),
    ],
)
def test_rays_are_imaged_where_the_camera_images_them(projection: Projection, widest: float):
    imaging = imaging_with(projection)
    rays = rays_of(directions(widest))
    rays[0] = 0.0
    wanted = np.asarray(imaging.place(*jnp.asarray(rays.T)))
    np.testing.assert_allclose(lens_of(imaging).project(rays), wanted, rtol=0, atol=1e-4)


def test_rays_are_imaged_where_opencv_images_them():
    imaging, ways = imaging_with(KannalaBrandt(COEFFICIENTS)), directions(1.4)
    rows, columns = imaging.shape
    focal = float(imaging.camera.focal_pixels)
    middle = columns / 2 - 0.5 + OFFSET[0], rows / 2 - 0.5 + OFFSET[1]
    matrix = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]])
    points = (ways * [1, -1, 1])[:, None]  # its rows go down
    wanted, _ = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), matrix, COEFFICIENTS)
    found = lens_of(imaging).project(rays_of(ways))
    np.testing.assert_allclose(found, wanted[:, 0], rtol=0, atol=1e-5)


def imaging_with(projection: Projection) -> Imaging:
    """The image of a camera with a lens, whose axis is beside the middle."""
    camera = Camera(
        np.zeros(2), 0.0, np.radians(120.0), 1080.0, projection, axis_offset=jnp.array(OFFSET)
    )
    return Imaging.of(camera)


def directions(widest: float) -> np.ndarray:
    """Unit vectors (right, up, forward) within an angle of the axis."""
    generator = np.random.default_rng(3)
    away, around = widest * generator.uniform(size=4000), generator.uniform(0, 2 * np.pi, 4000)
    aside = np.sin(away)
    return np.stack([aside * np.cos(around), aside * np.sin(around), np.cos(away)], axis=-1)


def rays_of(ways: np.ndarray) -> np.ndarray:
    """Section angles and lateral slopes of directions."""
    right, up, forward = ways.T
    return np.stack([np.arctan2(up, forward), right / np.hypot(up, forward)], axis=-1)
