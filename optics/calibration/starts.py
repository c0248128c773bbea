"""Where a bundle adjustment starts: a field of view from a few that are tried, poses from lines."""

from __future__ import annotations

import itertools
import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from optics.calibration.bundle import Poses, Sightings
from optics.calibration.fisheye import Fisheye

FIELDS_DEG = (60, 80, 100, 120, 140, 160, 180, 200, 220, 240)
"""Fields of view over the image's diagonal that are tried, each with every one of `BENDS`."""

BENDS = (-0.06, 0.0, 0.06)
"""Values of k₁: lenses that compress the edge of the image as the equisolid one and more, and that
stretch it as the stereographic one."""

TERMS = 8
"""Coefficients of a lens: five leave the focal length of a blend with the arctangent off by twelve
of its deviations, eight by less than two."""

TABLED = 1000
"""Angles at which image heights are tabulated: rough rays are enough."""

LEAST_POINTS = 6
"""Of a picture whose pose is looked for; four determine one."""

AHEAD = np.array([0.0, 0.0, 30.0])
"""Where a board is supposed that is not seen, mm."""


def find_starts(sightings: Sightings, size: tuple[int, int]) -> list[tuple[Fisheye, Poses, float]]:
    """Lenses with poses of the board to start from, the likeliest first.

    None has a moving pupil, and each has its axis in the middle of the image. Poses
    are those of the direct linear transformation on rays (R. Hartley, A. Zisserman, *Multiple View
    Geometry in Computer Vision*, 2nd ed., §4.1, with rays in place of image points).

    Args:
        sightings: of the board; pictures of less than `LEAST_POINTS` have a pose before the camera
            that nothing determines.
        size: columns and rows of the image.

    Returns:
        Lens, poses and the median angle between seen and predicted rays over that angle's pixels:
        the median error, px.
    """
    columns, rows = size
    points, places = np.asarray(sightings.points), np.asarray(sightings.places)
    used, middle = np.asarray(sightings.used), np.array([columns - 1, rows - 1]) / 2
    found = []
    for field, bend in itertools.product(np.radians(FIELDS_DEG), BENDS):
        tabled = np.linspace(0, field, TABLED)
        heights = tabled * (1 + bend * tabled**2)
        # Beyond where a lens images nothing more, its last ray.
        last = 1 + int(np.argmax(heights))
        tabled, heights = tabled[:last], heights[:last]
        focal = math.hypot(columns, rows) / 2 / float(np.interp(field / 2, tabled, heights))
        away = (places - middle) / focal
        radius = np.hypot(*np.moveaxis(away, -1, 0))
        angle = np.interp(radius, heights, tabled)
        share = np.sin(angle) / np.where(radius > 0, radius, 1.0)
        rays = np.concatenate([away * share[..., None], np.cos(angle)[..., None]], axis=-1)
        poses, errors = start_poses(points, rays, used)
        lens = Fisheye(focal, middle, np.array([bend, *(TERMS - 1) * [0.0]]), np.zeros(2))
        found.append((lens, poses, focal * float(np.median(errors))))
    return sorted(found, key=lambda start: start[2])


def start_poses(
    points: Float[np.ndarray, "pictures most 2"],
    rays: Float[np.ndarray, "pictures most 3"],
    used: Bool[np.ndarray, "pictures most"],
) -> tuple[Poses, Float[np.ndarray, " corners"]]:
    """Poses of the board in several pictures, by rays from one point.

    Returns:
        Poses, and angles between seen and predicted rays, rad.
    """
    turns, shifts, errors = [], [], []
    for one, seen, which in zip(points, rays, used, strict=True):
        if which.sum() < LEAST_POINTS:
            rotation, shift, off = np.eye(3), AHEAD, np.zeros(0)
        else:
            rotation, shift, off = _pose_of_plane(one[which], seen[which])
        turns.append(rotation)
        shifts.append(shift)
        errors.append(off)
    return Poses(jnp.asarray(np.array(turns)), jnp.asarray(np.array(shifts))), np.concatenate(
        errors
    )


def _pose_of_plane(
    points: Float[np.ndarray, "n 2"], rays: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"], Float[np.ndarray, " n"]]:
    """Rotation and translation of a plane whose points lie on rays from the origin; angles off."""
    scale = np.abs(points).max()
    plane = np.column_stack([points / scale, np.ones(len(points))])
    # ray x (M plane) = 0: three equations a point, of which two are independent.
    crossed = np.zeros((len(points), 3, 3, 3))
    x, y, z = rays.T
    for row, column, value in ((0, 1, -z), (0, 2, y), (1, 0, z), (1, 2, -x), (2, 0, -y), (2, 1, x)):
        crossed[:, row, column] = value[:, None] * plane
    matrix = np.linalg.svd(crossed.reshape(-1, 9), full_matrices=False)[2][-1].reshape(3, 3)
    # Of both signs, the one that puts points before the camera's pupil along their rays.
    matrix *= np.sign(np.sum((plane @ matrix.T) * rays))
    matrix[:, :2] /= scale
    matrix /= (np.linalg.norm(matrix[:, 0]) + np.linalg.norm(matrix[:, 1])) / 2
    first, second, shift = matrix.T
    left, _, right = np.linalg.svd(np.column_stack([first, second, np.cross(first, second)]))
    rotation = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    predicted = points @ rotation[:, :2].T + shift
    cosine = np.sum(predicted * rays, axis=1) / np.linalg.norm(predicted, axis=1)
    return rotation, shift, np.arccos(np.clip(cosine, -1, 1))
