"""What is black on a board, against OpenCV's drawings."""

import cv2
import numpy as np
import pytest

from perception.boards import Board
from perception.boards.pattern import Pattern, dark_rectangles, opencv_dictionary
from tests.perception.boards.pictured import CHARUCO, TAGS, Print
from tests.perception.boards.test_board import board_of

ODD = Print("charuco", 5, 4, 12.0, 7.0, "DICT_5X5_50", 2)


def painted(board: Board, density: int) -> np.ndarray:
    """Rectangles painted on pixels, whose edges they all have."""
    columns, rows = np.rint(np.array(board.size) * density).astype(int)
    image = np.full((rows, columns), 255, np.uint8)
    for left, top, right, bottom in np.rint(dark_rectangles(board) * density).astype(int):
        assert np.all(image[top:bottom, left:right])  # none overlaps another
        image[top:bottom, left:right] = 0
    return image


@pytest.mark.parametrize("printed", [CHARUCO, TAGS, ODD])
def test_it_is_opencvs_drawing_pixel_for_pixel(printed):
    np.testing.assert_array_equal(
        painted(board_of(printed), printed.density), printed.drawn(printed.density)
    )


def test_the_first_marker_is_that_of_the_dictionary():
    board = Board(columns=3, rows=3, square=8.0, marker=6.0, first_marker=40)
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_100)
    image = painted(board, 1)
    for number, corners in enumerate(board.marker_corners.astype(int)):
        (left, top), (right, bottom) = corners[0], corners[2]
        wanted = words.generateImageMarker(40 + number, 6, borderBits=1)
        np.testing.assert_array_equal(image[top:bottom, left:right], wanted)
    corners, numbers, _ = cv2.aruco.ArucoDetector(opencv_dictionary(board)).detectMarkers(
        cv2.copyMakeBorder(
            painted(board, 10), *4 * [20], borderType=cv2.BORDER_CONSTANT, value=(255,)
        )
    )
    assert sorted(numbers.ravel()) == [0, 1, 2, 3]


@pytest.mark.parametrize("printed", [CHARUCO, TAGS, ODD])
def test_every_level_has_the_share_of_white(printed):
    board = board_of(printed)
    pattern = Pattern(board)
    low = np.array([-pattern.margin, -pattern.margin])
    for across, down in ((0, 0), (2, 0), (3, 4)):
        image = pattern.level(across, down)
        size = np.array([2**across, 2**down]) / pattern.density
        pixels = np.random.default_rng(0).integers(0, image.shape[::-1], (300, 2))
        starts, ends = low + pixels * size, low + (pixels + 1) * size
        rectangles = dark_rectangles(board)
        overlaps = np.minimum(ends[:, None], rectangles[:, 2:])
        overlaps = overlaps - np.maximum(starts[:, None], rectangles[:, :2])
        dark = np.prod(np.maximum(overlaps, 0), axis=2).sum(axis=1) / np.prod(size)
        values = image[tuple(pixels[:, ::-1].T)]
        np.testing.assert_allclose(values, 1 - dark, atol=1e-5)
        assert 0.1 < np.mean(dark > 0.5) < 0.9


def test_a_large_board_takes_no_more_room():
    board = Board(columns=30, rows=30, square=1.0, dictionary="apriltag-36h11")
    pattern, rectangles = Pattern(board), dark_rectangles(board)
    whole = pattern.level(0, 0)
    assert 0.5e7 < whole.size < 1.2e7
    dark = np.prod(rectangles[:, 2:] - rectangles[:, :2], axis=1).sum() * pattern.density**2
    assert np.sum(1 - whole, dtype=float) == pytest.approx(dark, rel=1e-5)
