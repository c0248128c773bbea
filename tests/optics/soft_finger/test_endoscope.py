"""The endoscope against OpenCV's projection with rotations composed by SciPy, and by hand."""

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from optics.chamber import Endoscope
from tests.helpers import check_gradients

PIXELS = 1e-9
GRADIENT = 1e-6  # relative to the largest slope: what central differences can tell
QUARTER = np.deg2rad(90.0)
"""A field of view that makes the focal length half the diagonal."""

CASES = {
    "plain": ({}, (0.0, 0.0), 0.0),
    "barrel": ({"distortion": -0.12}, (0.0, 0.0), 0.0),
    "pincushion": ({"distortion": 0.2}, (0.0, 0.0), 0.0),
    "right": ({}, (0.2, 0.0), 0.0),
    "down": ({}, (0.0, 0.15), 0.0),
    "rolled": ({}, (0.0, 0.0), 0.4),
    "all": ({"distortion": -0.08, "columns": 401, "rows": 300}, (-0.11, 0.07), -0.3),
}


def endoscope(case: str) -> Endoscope:
    settings, pointing, roll = CASES[case]
    return Endoscope(np.deg2rad(75.0), pointing=np.array(pointing), roll=roll, **settings)


def slopes() -> np.ndarray:
    side = np.linspace(-0.6, 0.6, 9)
    return np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("case", CASES)
def test_images_are_those_of_opencv(case):
    settings, (right, down), roll = CASES[case]
    camera = endoscope(case)
    columns, rows = settings.get("columns", 640), settings.get("rows", 480)
    focal = np.hypot(columns, rows) / 2 / np.tan(np.deg2rad(75.0) / 2)
    matrix = np.array([[focal, 0, (columns - 1) / 2], [0, focal, (rows - 1) / 2], [0, 0, 1]])
    # x right, y down, z ahead: about y to the right, about the camera's x down, about its z.
    turned = Rotation.from_euler("YXZ", [right, -down, roll])
    points = np.concatenate([slopes(), np.ones((81, 1))], axis=1)
    wanted, _ = cv2.projectPoints(
        points,
        turned.inv().as_rotvec(),
        np.zeros(3),
        matrix,
        np.array([settings.get("distortion", 0.0), 0, 0, 0]),
    )
    np.testing.assert_allclose(camera.image(jnp.asarray(slopes())), wanted[:, 0], atol=PIXELS)


def test_a_camera_sees_in_the_middle_what_it_points_at():
    pointing = np.array([0.2, -0.1])
    camera = Endoscope(QUARTER).turned(pointing, 0.7)
    # The direction that is turned to by spherical coordinates: azimuth, then elevation.
    ahead = np.array(
        [np.sin(0.2) * np.cos(0.1), -np.sin(0.1), np.cos(0.2) * np.cos(0.1)]
    )  # y is down
    place = camera.image(jnp.asarray(ahead[:2] / ahead[2]))
    np.testing.assert_allclose(place, camera.center, atol=PIXELS)


def test_gradients_are_central_differences():
    def seen(values: list[jax.Array]) -> jax.Array:
        x, y, field, distortion, right, down, roll = values
        camera = Endoscope(field, distortion, jnp.stack([right, down]), roll)
        place = camera.image(jnp.stack([x, y]))
        return place[0] + 0.3 * place[1]

    points = [
        [0.0, 0.0, 1.3, 0.0, 0.0, 0.0, 0.0],
        [0.3, -0.2, 1.5, -0.1, 0.1, 0.2, 0.3],
        [-0.5, 0.4, 1.0, 0.1, -0.2, 0.05, -2.0],
    ]
    check_gradients(seen, [*jnp.array(points).T], of_largest=GRADIENT)


def test_pointing_comes_before_the_roll():
    # A camera on its side that points to the right sees the axis above the middle, not beside it.
    camera = Endoscope(QUARTER, roll=np.pi / 2).turned(np.array([0.1, 0.0]), 0.0)
    across, down = np.asarray(camera.image(jnp.zeros(2))) - np.array(camera.center)
    assert abs(across) < 1e-9
    assert down == pytest.approx(float(camera.focal_px) * np.tan(0.1))
