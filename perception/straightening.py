"""What corners are found of an outline whose sides are not quite straight.

`perception.quads` fits a line to every side and takes for corners where they meet. Refraction in a
pad's layers and an entrance pupil that moves bend the sides, so that these are not the corners;
what lies between is computed from the outline that is expected.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from perception.lens import Lens, TangentPlane
from perception.sides import POINTS, TRIMMED

SHARES = np.linspace(TRIMMED, 1 - TRIMMED, POINTS)
"""Parts of the way along a side at which its edge is looked for."""

PARALLEL = 1e-6
"""Sine of the angle between sides below which they are parallel: those of a pad seen edge-on."""


def find_straight_corners(
    sides: Float[np.ndarray, "4 points 2"], lens: Lens
) -> Float[np.ndarray, "4 2"]:
    """Where lines through the sides of an outline meet: corner i is that of sides i − 1 and i.

    Args:
        sides: rays along every side, from corner to corner, at `SHARES`.
        lens: of the camera.

    Returns:
        Columns and rows, within the image or not; NaN where two sides are parallel.

    Example:
        >>> rows, columns = np.mgrid[:90, :120]
        >>> rays = np.stack([(44.5 - rows) / 200, (columns - 59.5) / 200], axis=-1)
        >>> lens = Lens(
        ...     rays, lambda r: np.stack([59.5 + 200 * r[:, 1], 44.5 - 200 * r[:, 0]], axis=-1)
        ... )
        >>> corners = np.array([[30.0, 70.0], [30.0, 19.0], [89.0, 19.0], [89.0, 70.0]])
        >>> steps = np.roll(corners, -1, axis=0) - corners
        >>> places = corners[:, None] + SHARES[:, None] * steps[:, None]
        >>> sides = lens.rays(places.reshape(-1, 2)).reshape(places.shape)
        >>> find_straight_corners(sides, lens).round().tolist()
        [[30.0, 70.0], [30.0, 19.0], [89.0, 19.0], [89.0, 70.0]]
    """
    rays = sides.reshape(-1, 2)
    plane = TangentPlane(float(rays[:, 0].min() + rays[:, 0].max()) / 2)
    flat = plane.flat(rays).reshape(sides.shape)
    middles = flat.mean(axis=1)
    ways = np.linalg.svd(flat - middles[:, None])[2][:, 0]
    # Lines as homogeneous vectors: their cross product is where they meet.
    normals = np.stack([-ways[:, 1], ways[:, 0]], axis=-1)
    lines = np.column_stack([normals, -np.sum(normals * middles, axis=-1)])
    meeting = np.cross(np.roll(lines, 1, axis=0), lines)
    sine = np.where(np.abs(meeting[:, 2:]) < PARALLEL, np.nan, meeting[:, 2:])
    return lens.project(plane.rays(meeting[:, :2] / sine))
