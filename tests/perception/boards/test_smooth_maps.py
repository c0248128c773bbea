"""Slopes and curvatures of maps about points, against those of the map that images the board."""

import numpy as np
import pytest

from perception.boards.local_maps import LocalMaps
from perception.boards.neighbors import maps_from_neighbors
from perception.boards.smooth_maps import smooth_maps

MIDDLE, FOCAL, CENTER = np.array([30.7, 22.8]), 300.0, np.array([479.5, 359.5])
GRID = 5.0 * np.stack(np.meshgrid(np.arange(1, 12), np.arange(1, 9)), axis=-1).reshape(-1, 2)
HALF = 8
"""Of a window, px."""


def to_image(points: np.ndarray, away: float) -> np.ndarray:
    """A board that faces an equidistant lens."""
    aside = points - MIDDLE
    radius = np.linalg.norm(aside, axis=-1, keepdims=True)
    return CENTER + aside * FOCAL * np.arctan(radius / away) / radius


def to_board(places: np.ndarray, away: float) -> np.ndarray:
    aside = places - CENTER
    radius = np.linalg.norm(aside, axis=-1, keepdims=True)
    return MIDDLE + aside * np.tan(radius / FOCAL) * away / radius


def pulls(maps: LocalMaps, places: np.ndarray, away: float) -> np.ndarray:
    """By how much points in the middle of windows are off, as a map's curvature is, px."""
    step = 0.01
    line = step * np.eye(2)
    middle = to_board(places, away)
    found = 0
    for which, move in enumerate(line):
        ends = to_board(places + move, away), to_board(places - move, away)
        true = (ends[0] + ends[1] - 2 * middle) / step**2
        found = found + (2 * maps.forms[:, :, which, which] - true) / 2
    # The mean of x² over a window is a third of HALF².
    off = found * HALF**2 / 3
    return np.einsum("nij,nj->ni", np.linalg.inv(maps.slopes(places)), off)


@pytest.mark.parametrize("away", [20.0, 35.0])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_curvatures_are_those_of_the_image(away, noise):
    places = to_image(GRID, away)
    seen = places + np.random.default_rng(0).normal(0, noise, places.shape)
    off = pulls(smooth_maps(GRID, seen, 5.0), seen, away)
    assert np.abs(off).max() < 0.012
    assert np.sqrt(np.mean(off**2)) < 0.0025
    _, rough, start = maps_from_neighbors(GRID, GRID, seen, 5.0, within=1.5)
    assert np.sqrt(np.mean(pulls(rough, start, away) ** 2)) > 0.007  # what they are for


def test_points_are_where_they_are_seen():
    places = to_image(GRID, 20.0)
    maps = smooth_maps(GRID, places, 5.0)
    np.testing.assert_allclose(maps.points_at(places), GRID, atol=1e-9)
    step = 1e-4
    slopes = [
        (to_board(places + move, 20.0) - to_board(places - move, 20.0)) / (2 * step)
        for move in step * np.eye(2)
    ]
    np.testing.assert_allclose(maps.slopes(places), np.stack(slopes, axis=-1), atol=1e-3)


def test_few_points_are_enough():
    few = GRID[np.all(GRID < 12, axis=1)]
    places = to_image(few, 35.0)
    maps = smooth_maps(few, places, 5.0)
    assert len(few) == 4
    np.testing.assert_allclose(maps.points_at(places), few, atol=1e-9)
    assert np.abs(pulls(maps, places, 35.0)).max() < 0.2
