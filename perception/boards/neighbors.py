"""Local maps about points of a board from where their neighbors are imaged."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from perception.boards.local_maps import LocalMaps, Places, fit_maps

MOST, FARTHEST, NEAR = 13, 2.3, 0.8
"""Neighbors of a map, how far they may be, and the standard deviation of the Gaussian by which they
count, squares."""

BESIDE = 1.5
"""Points so near each other are beside each other, diagonally too, squares."""

FEWEST, SPREAD = 4, 0.17
"""Neighbors that a map needs at least, and how far they must be spread along any direction, as a
standard deviation, squares."""


def maps_from_neighbors(
    points: Places,
    known: Float[np.ndarray, "known 2"],
    places: Float[np.ndarray, "known 2"],
    square: float,
    *,
    within: float,
    apart: bool = False,
) -> tuple[Int[np.ndarray, " chosen"], LocalMaps, Float[np.ndarray, "chosen 2"]]:
    """Maps about those points that have neighbors enough.

    Args:
        points: on the board, mm.
        known: others on the board, mm.
        places: where these are imaged, px.
        square: side of a square, mm.
        within: a point has a neighbor this near, squares.
        apart: a known one that is the point itself is no neighbor.

    Returns:
        Which points these are, their maps, and where these image the points.
    """
    tree, most = KDTree(known / square), MOST + apart
    near = tree.query(points / square, k=most, distance_upper_bound=FARTHEST)
    away, which = (np.asarray(part) for part in near)
    away, which = away[:, int(apart) :], np.minimum(which[:, int(apart) :], len(known) - 1)
    weights = np.exp(-0.5 * (away / NEAR) ** 2)  # 0 where there is none
    shares = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
    offsets = known[which] / square
    offsets = offsets - (shares[..., None] * offsets).sum(axis=1, keepdims=True)
    spreads = np.linalg.eigvalsh((offsets * shares[..., None]).swapaxes(1, 2) @ offsets)[:, 0]
    enough = (np.count_nonzero(weights, axis=1) >= FEWEST) & (spreads > SPREAD**2)
    chosen = np.flatnonzero(enough & (away[:, 0] < within))
    neighbors = which[chosen]
    maps = fit_maps(places[neighbors], known[neighbors], weights[chosen])
    return chosen, maps, maps.places_of(points[chosen], places[neighbors[:, 0]])
