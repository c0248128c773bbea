"""Local maps against polynomials that are known, and against finite differences."""

import numpy as np
import pytest

from perception.boards.local_maps import LocalMaps, fit_maps, scaling, shifting
from perception.boards.neighbors import maps_from_neighbors


def bent(places: np.ndarray) -> np.ndarray:
    """A quadratic map from an image to a board."""
    x, y = places[..., 0] - 300, places[..., 1] - 200
    return np.stack(
        [2 + 0.1 * x - 0.02 * y + 1e-4 * x * x + 3e-5 * x * y, 5 + 0.11 * y - 2e-4 * y * y],
        axis=-1,
    )


@pytest.fixture
def places() -> np.ndarray:
    """Nine places about each of four."""
    about = np.array([[300, 200], [310, 230], [250, 180], [330, 150.0]])
    grid = np.stack(np.meshgrid(*2 * [np.array([-30.0, 0, 30])]), axis=-1).reshape(-1, 2)
    return about[:, None] + grid


@pytest.fixture
def maps(places) -> LocalMaps:
    return fit_maps(places, bent(places), np.ones(places.shape[:2]))


def test_a_quadratic_map_is_found(maps, places):
    # The ridge of 0.01² holds its quadratic terms back by as much.
    for which in range(9):
        np.testing.assert_allclose(
            maps.points_at(places[:, which]), bent(places[:, which]), atol=2e-4
        )


def test_slopes_are_finite_differences(maps, places):
    about, step = places[:, 2], 1e-3
    differences = [
        (maps.points_at(about + move) - maps.points_at(about - move)) / (2 * step)
        for move in step * np.eye(2)
    ]
    np.testing.assert_allclose(maps.slopes(about), np.stack(differences, axis=-1), atol=1e-9)


def test_places_are_the_inverse_and_stay_finite_where_there_is_none(maps, places):
    points = maps.points_at(places[:, 0])
    np.testing.assert_allclose(maps.places_of(points, places[:, 4]), places[:, 0], atol=1e-9)
    assert np.isfinite(maps.places_of(points + 1e4, places[:, 4])).all()
    flat = LocalMaps(np.zeros((4, 2, 3, 3)))
    assert np.isfinite(flat.places_of(points, places[:, 4])).all()


def test_a_warp_comes_before_the_map(maps, places):
    warps = scaling(np.full(4, 2.0), np.full((4, 2), 0.5))
    warped = maps.warped(warps)
    small = (places[:, 3] - 0.5) / 2
    np.testing.assert_allclose(warped.points_at(small), maps.points_at(places[:, 3]), atol=1e-9)
    moved = maps.part(np.array([2])).warped(shifting(np.array([[1.0, -2.0]])))
    np.testing.assert_allclose(
        moved.points_at(places[2:3, 0] - [1, -2]), maps.points_at(places[:, 0])[2:3], atol=1e-9
    )


def board_places(points: np.ndarray) -> np.ndarray:
    """A smooth image of a plane, with terms of the third order."""
    x, y = points.T / 50
    return np.stack([100 + 500 * np.sin(x + 0.2 * y), 80 + 400 * np.tan(0.7 * y)], axis=1)


def test_a_point_is_where_its_neighbors_have_it():
    grid = 5.0 * np.stack(np.meshgrid(np.arange(8), np.arange(6)), axis=-1).reshape(-1, 2)
    places = board_places(grid)
    chosen, maps, start = maps_from_neighbors(grid, grid, places, 5.0, within=1.5, apart=True)
    assert chosen.tolist() == list(range(48))
    inner = np.all((grid > 5) & (grid < [30, 20]), axis=1)
    errors = np.linalg.norm(start - places, axis=1)
    assert errors[inner].max() < 0.3  # of squares of 40 to 50 px
    assert errors.max() < 2
    np.testing.assert_allclose(maps.points_at(start), grid, atol=1e-9)
    _, _, near = maps_from_neighbors(grid, grid, places, 5.0, within=1.5)
    assert np.linalg.norm(near - places, axis=1).max() < 0.5 * errors.max()


def test_points_without_neighbors_enough_have_no_map():
    line = np.stack([5.0 * np.arange(8), np.zeros(8)], axis=1)
    square = np.array([[0.0, 20], [5, 20], [0, 25], [5, 25]])
    known = np.concatenate([line, square])
    asked = np.array([[17.5, 2.5], [2.5, 22.5], [10.0, 30], [30.0, 60]])
    chosen, _, start = maps_from_neighbors(asked, known, board_places(known), 5.0, within=1.0)
    assert chosen.tolist() == [1]
    assert np.linalg.norm(start - board_places(asked[1:2])) < 1.5
