"""Local maps about points of a board, with slopes and bends of a polynomial through many of them.

How far a point seems to be off is a map's error of curvature times a window's size squared. Over a
few squares, where a wide lens images them, a quadratic polynomial has another curvature than in
the middle, and of its errors all have the same sign. A polynomial of the sixth degree has the
right one; and it is fitted to places as a function of points, for image heights are smooth far
beyond a few squares, such as the arctangent of a distance on the board, and their inverse is not.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import KDTree

from perception.boards.local_maps import LocalMaps, Places, shifting

MOST, FARTHEST, NEAR = 49, 4.3, 1.2
"""Points that a polynomial goes through, how far they may be, and the standard deviation of the
Gaussian by which they count, squares."""

DEGREE = 6
"""Of the polynomials."""

NOISE, SMOOTH = 1e-4, 0.25
"""Errors of places, and by how much terms of each degree are expected to be smaller than those of
the degree before, in the spread of the points: that matters where points are too few to fix all
terms."""


def smooth_maps(points: Places, places: Places, square: float) -> LocalMaps:
    """Maps about points that are imaged at places.

    Args:
        points: on the board, mm.
        places: of the same points in the image, px.
        square: side of a square, mm.
    """
    tree = KDTree(points / square)
    near = tree.query(points / square, k=MOST, distance_upper_bound=FARTHEST)
    away, which = (np.asarray(part) for part in near)
    weights, which = np.exp(-0.5 * (away / NEAR) ** 2), np.minimum(which, len(points) - 1)
    offsets, total = points[which] - points[:, None], weights.sum(axis=1)
    scales = np.sqrt((weights * (offsets**2).sum(axis=2)).sum(axis=1) / total)
    x, y = np.moveaxis(offsets / scales[:, None, None], -1, 0)
    terms, held = [], []
    for degree in range(DEGREE + 1):
        ridge = (NOISE / SMOOTH ** max(degree - 1, 0)) ** 2
        for power in range(degree + 1):
            # Each as often as it is in the expanded power of a sum: ridges then have no axes.
            count = math.comb(degree, power)
            terms.append(count * x ** (degree - power) * y**power)
            held.append(count * ridge)
    stacked = np.stack(terms, axis=-1)
    turned = (stacked * weights[..., None]).swapaxes(1, 2)
    normal = turned @ stacked + total[:, None, None] * np.diag(held)
    found = np.linalg.solve(normal, turned @ places[which])
    # place = … + S p + pᵀ B p of scaled points p, and so p = S⁻¹ e − S⁻¹ (S⁻¹ e)ᵀ B (S⁻¹ e) + ….
    bends = found[:, [[3, 4], [4, 5]]].transpose(0, 3, 1, 2)
    back = np.linalg.inv(found[:, 1:3].swapaxes(1, 2))
    bent = back[:, None].swapaxes(2, 3) @ bends @ back[:, None]
    forms = np.zeros((len(points), 2, 3, 3))
    forms[:, :, :2, :2] = -np.einsum("mij,mjkl->mikl", back, bent)
    forms[:, :, :2, 2] = forms[:, :, 2, :2] = back / 2
    forms *= scales[:, None, None, None]
    forms[:, :, 2, 2] = points
    return LocalMaps(forms).warped(shifting(-places))
