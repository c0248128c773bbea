"""Points that are not what they seem: off their neighbors, or about markers of another number."""

import numpy as np
import pytest

from perception.boards import Board
from perception.boards.checking import checked_points, marker_correlations
from tests.perception.boards.test_registration import BOARD, TAGS, drawn


def image_of(board: Board) -> tuple[np.ndarray, np.ndarray]:
    """A picture of a board, and where its points are."""
    image, _, places = drawn(board)
    return image.astype(np.float32), places


@pytest.mark.parametrize("board", [BOARD, TAGS])
def test_markers_are_read_where_points_are_right(board):
    image, places = image_of(board)
    read, middles = marker_correlations(image, board, board.points, places)
    assert len(read) > 8
    assert read.min() > 0.9
    inner = board.marker_corners.mean(axis=1)
    assert all(np.isclose(inner, one).all(axis=1).any() for one in middles)
    # Two squares further on are other markers.
    far = np.linalg.norm(board.points - board.points[0], axis=1) > 0
    shift = 2 * board.square * np.array([1.0, 0])
    other, _ = marker_correlations(image, board, board.points[far] + shift, places[far])
    assert len(other) > 5
    assert abs(other.mean()) < 0.3
    empty, _ = marker_correlations(image, board, board.points[:3], places[:3])
    assert empty.shape == (0,)


@pytest.mark.parametrize("board", [BOARD, TAGS])
def test_points_off_their_neighbors_are_left_out(board):
    image, places = image_of(board)
    every = np.arange(len(places))
    assert checked_points(image, board, every, places).tolist() == every.tolist()
    moved = places.copy()
    moved[[5, 11]] += [0.35 * 6.0 * board.square, 0]
    kept = checked_points(image, board, every, moved)
    assert not np.isin([5, 11], kept).any()
    # Of those beside them a few may be lost, until the search spreads once more.
    assert len(kept) > 0.85 * len(every)


def test_a_part_with_wrong_numbers_is_left_out():
    image, places = image_of(BOARD)
    # Of 7 columns three are right, one is missing, and three have the numbers of others.
    column = np.arange(35) % 7
    wrong = places.copy()
    wrong[column > 3] = places[np.flatnonzero(column > 3) - 2]
    numbers = np.flatnonzero(column != 3)
    kept = checked_points(image, BOARD, numbers, wrong[numbers])
    assert np.all(column[kept] < 3)
    assert np.isin(np.flatnonzero(column < 2), kept).all()


def test_of_nothing_nothing_is_left():
    image, _ = image_of(BOARD)
    assert checked_points(image, BOARD, np.zeros(0, int), np.zeros((0, 2))).tolist() == []
