"""Which of a board's points that were found in a picture are those that they seem to be."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from perception.boards.board import Board
from perception.boards.neighbors import BESIDE, maps_from_neighbors
from perception.boards.pattern import marker_modules

OFF = 0.2
"""A point that is farther than this from where its neighbors have it, along either side, is wrong,
squares."""

AROUND, CORNERS = 0.75, 4
"""Markers are read that have so many points this near their middle, squares."""

READ = 0.4
"""Least correlation of modules that are read with those that are printed, in the mean of a part's
markers without the best one, which may have been misread; of other markers it is about 0."""

Numbers = Int[np.ndarray, " _"]


def checked_points(
    image: Float[np.ndarray, "rows columns"],
    board: Board,
    numbers: Numbers,
    places: Float[np.ndarray, "_ 2"],
) -> Numbers:
    """Those points that are where their neighbors have them, and whose markers are the board's.

    One corner of squares looks like any other: a marker that was misread may have begun a part of
    the board with wrong numbers, of which each point fits its neighbors.

    Args:
        image: brightness.
        board: the board.
        numbers: of points that were found.
        places: where, px.

    Returns:
        Their numbers.
    """
    chosen = _consistent(board.points[numbers], places, board.square)
    numbers, places = numbers[chosen], places[chosen]
    if not len(numbers):
        return numbers
    points = board.points[numbers]
    tree = KDTree(points / board.square)
    count, parts = connected_components(tree.sparse_distance_matrix(tree, BESIDE))
    read, middles = marker_correlations(image, board, points, places)
    _, nearest = KDTree(points).query(middles)
    markers = parts[nearest]
    best = np.zeros(count)
    np.maximum.at(best, markers, read)
    others = np.bincount(markers, minlength=count) - 1
    means = (np.bincount(markers, read, count) - best) / np.maximum(others, 1)
    return numbers[means[parts] > READ]


def marker_correlations(
    image: Float[np.ndarray, "rows columns"],
    board: Board,
    points: Float[np.ndarray, "points 2"],
    places: Float[np.ndarray, "points 2"],
) -> tuple[Float[np.ndarray, " markers"], Float[np.ndarray, "markers 2"]]:
    """How markers with points all around agree with what is printed there.

    Args:
        image: brightness.
        board: the board.
        points: on the board, mm.
        places: where these are imaged, px.

    Returns:
        Correlation of the brightness at their modules with these, and their middles (mm).
    """
    modules = marker_modules(board)[:, 1:-1, 1:-1]
    middles = board.marker_corners.mean(axis=1)
    around = KDTree(points).query_ball_point(middles, AROUND * board.square, return_length=True)
    within = np.flatnonzero(around >= CORNERS)
    chosen, maps, start = maps_from_neighbors(
        middles[within], points, places, board.square, within=AROUND
    )
    within = within[chosen]
    side = modules.shape[1]
    line = (np.arange(side) - (side - 1) / 2) * board.marker_side / (side + 2)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    each = np.repeat(np.arange(len(within)), side**2)
    wanted = (middles[within][:, None] + grid).reshape(-1, 2)
    at = maps.part(each).places_of(wanted, start[each]).reshape(len(within), side**2, 2)
    if not len(within):
        return np.zeros(0), middles[within]
    columns, rows = np.moveaxis(at, -1, 0).astype(np.float32)
    light = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    white = modules[within].reshape(light.shape).astype(float)
    light, white = (one - one.mean(axis=1, keepdims=True) for one in (light, white))
    spread = np.linalg.norm(light, axis=1) * np.linalg.norm(white, axis=1)
    return (light * white).sum(axis=1) / np.maximum(spread, 1e-6), middles[within]


def _consistent(
    points: Float[np.ndarray, "points 2"], places: Float[np.ndarray, "points 2"], square: float
) -> Numbers:
    """Which points are where their neighbors have them; the worst are left out first."""
    left = np.arange(len(points))
    while len(left):
        chosen, maps, expected = maps_from_neighbors(
            points[left], points[left], places[left], square, within=BESIDE, apart=True
        )
        away = (maps.slopes(expected) @ (expected - places[left[chosen]])[..., None])[..., 0]
        off = np.abs(away).max(axis=1) / square
        good = off <= max(OFF, 0.5 * float(off.max(initial=0)))
        if len(chosen) == len(left) and good.all():
            break
        left = left[chosen[good]]
    return left
