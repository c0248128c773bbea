"""Maps from an image to a board that are quadratic about a place, each about its own.

A lens bends a plane smoothly. About one place, over two or three squares, a quadratic polynomial
follows that without any model of the lens.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

RIDGE = 0.01
"""By so much, in the spread of its neighbors, quadratic terms are held back: that matters only
where neighbors are too few to fix those terms."""

NEWTON_STEPS, FARTHEST = 4, 1e6
"""Steps after which no place moves any more, and px beyond which none is looked for."""

Places = Float[np.ndarray, "maps 2"]
Warps = Float[np.ndarray, "maps 3 3"]


class LocalMaps(NamedTuple):
    """Quadratic maps from places in an image (column, row) to places on a board (mm).

    Attributes:
        forms: symmetric matrices F; each coordinate on the board is hᵀ F h of
            h = (column, row, 1).
    """

    forms: Float[np.ndarray, "maps 2 3 3"]

    def points_at(self, places: Places) -> Places:
        """Where one place of each map is on the board."""
        whole = np.append(places, np.ones((len(places), 1)), axis=1)[:, None, :, None]
        return (whole.swapaxes(2, 3) @ self.forms @ whole)[..., 0, 0]

    def slopes(self, places: Places) -> Float[np.ndarray, "maps 2 2"]:
        """Derivatives at one place of each map, mm per px; the last axis is along the image."""
        whole = np.append(places, np.ones((len(places), 1)), axis=1)[:, None, :, None]
        return 2 * (self.forms[:, :, :2] @ whole)[..., 0]

    def places_of(self, points: Places, start: Places) -> Places:
        """Where places on the board are imaged, by Newton's method from places near by."""
        places = start
        for _ in range(NEWTON_STEPS):
            (a, b), (c, d) = np.moveaxis(self.slopes(places), 0, -1)
            right, down = (points - self.points_at(places)).T
            determinant = a * d - b * c
            determinant = np.where(np.abs(determinant) < 1e-12, 1e-12, determinant)
            steps = np.stack([d * right - b * down, a * down - c * right], axis=1)
            places = np.clip(places + steps / determinant[:, None], -FARTHEST, FARTHEST)
        return places

    def warped(self, warps: Warps) -> LocalMaps:
        """The maps of images whose places these affine maps take to places of the image."""
        return LocalMaps(warps[:, None].swapaxes(2, 3) @ self.forms @ warps[:, None])

    def part(self, chosen: Int[np.ndarray, " _"]) -> LocalMaps:
        """Some of the maps."""
        return LocalMaps(self.forms[chosen])


def fit_maps(
    places: Float[np.ndarray, "maps neighbors 2"],
    points: Float[np.ndarray, "maps neighbors 2"],
    weights: Float[np.ndarray, "maps neighbors"],
) -> LocalMaps:
    """The maps that take places near by to where they are on the board, by least squares.

    Args:
        places: in the image, px.
        points: on the board, mm.
        weights: of the squares of their errors; three at least of each map are positive.
    """
    total = weights.sum(axis=1)
    middles = (weights[..., None] * places).sum(axis=1) / total[:, None]
    offsets = places - middles[:, None]
    scales = np.sqrt((weights * (offsets**2).sum(axis=2)).sum(axis=1) / total) + 1e-9
    x, y = np.moveaxis(offsets / scales[:, None, None], -1, 0)
    terms = np.stack([np.ones_like(x), x, y, x * x, 2 * x * y, y * y], axis=-1)
    turned = (terms * weights[..., None]).swapaxes(1, 2)
    held = RIDGE**2 * np.diag([1e-6, 1e-6, 1e-6, 1.0, 2.0, 1.0])
    found = np.linalg.solve(turned @ terms + total[:, None, None] * held, turned @ points)
    one, x, y, xx, xy, yy = np.moveaxis(found, 1, 0)
    forms = np.stack([xx, xy, x / 2, xy, yy, y / 2, x / 2, y / 2, one], axis=-1)
    shrinking = scaling(1 / scales, -middles / scales[:, None])
    return LocalMaps(forms.reshape(-1, 2, 3, 3)).warped(shrinking)


def scaling(scales: Float[np.ndarray, " maps"], shifts: Places) -> Warps:
    """Warps that multiply places and then add these shifts.

    Example:
        >>> scaling(np.array([2.0]), np.array([[3.0, 4.0]]))[0].tolist()
        [[2.0, 0.0, 3.0], [0.0, 2.0, 4.0], [0.0, 0.0, 1.0]]
    """
    warps = scales[:, None, None] * np.eye(3)
    warps[:, :2, 2], warps[:, 2, 2] = shifts, 1
    return warps


def shifting(shifts: Places) -> Warps:
    """Warps that add these shifts to places."""
    return scaling(np.ones(len(shifts)), shifts)
