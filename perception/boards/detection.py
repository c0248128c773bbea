"""A board's points in a picture, also in one of a fisheye lens that shows only a part of it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int

from perception.boards.board import Board
from perception.boards.checking import checked_points
from perception.boards.markers import find_markers
from perception.boards.neighbors import BESIDE, maps_from_neighbors
from perception.boards.registration import register
from perception.boards.search import Search
from perception.boards.smooth_maps import smooth_maps
from perception.images import checked_image

FEWEST = 6
"""Points of a board in a picture; fewer are no board."""

HALVES = {"charuco": 8, "apriltag": 10}
"""From the middle of windows to their ends, px: markers' corners have lines on one side only."""

STEPS, SHIFT = {"charuco": 4, "apriltag": 6}, 0.1
"""How often points are fitted in the end, and how far the last step may be, px."""

UNLIKE, UNLIKELY = 4.0, 0.02
"""A point is wrong where the print leaves more of its light unexplained than so many times the
median of all, and than this share."""

LEAST_ERRORS = {"charuco": 0.01, "apriltag": 0.03}
"""What is added, as variance, for what is no noise, px: found with rendered pictures."""


@dataclass(frozen=True)
class BoardCorners:
    """Points of a board that a picture shows.

    Attributes:
        numbers: of the points, rising; see `Board.points`.
        places: where they are imaged, column and row; whole numbers are the middles of pixels.
        errors: standard deviation of either coordinate, px.
    """

    numbers: Int[np.ndarray, " points"]
    places: Float[np.ndarray, "points 2"]
    errors: Float[np.ndarray, " points"]


def detect_board(image: object, board: Board) -> BoardCorners | None:
    """The points of a board that a picture shows.

    No model of the lens is needed. OpenCV finds markers (its `ArucoDetector`); about each point
    whose neighbors are known a quadratic map from the image to the board is fitted to these, and
    the point placed by fitting what is printed there to the pixels, from the markers to all that
    is in sight. What does not look like the print, or is not where its neighbors have it, is left
    out.

    Args:
        image: red, green and blue, or one channel, 8 bits.
        board: the board.

    Returns:
        The points; ``None`` where there is no board, or almost nothing of it.

    Raises:
        UserError: it is no image.

    Example:
        >>> import cv2
        >>> made = cv2.aruco.CharucoBoard(
        ...     (5, 4), 8.0, 6.0, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_100)
        ... )
        >>> image = made.generateImage((300, 252), marginSize=30)
        >>> corners = detect_board(image, Board(columns=5, rows=4, square=8.0))
        >>> len(corners.numbers), corners.places[0].round(1).tolist()
        (12, [77.5, 77.5])
    """
    gray = checked_image(image, channels=(1, 3), what="a picture of a board")
    if gray.ndim == 3:
        gray = cv2.cvtColor(gray, cv2.COLOR_RGB2GRAY)
    numbers, corners = find_markers(gray, board)
    search = Search(board, gray)
    if len(numbers):
        search.begin(board.marker_corners[numbers].reshape(-1, 2), corners.reshape(-1, 2))
    search.spread()
    good = _checked(search, board)
    if len(good) < len(search.found):
        # What was wrong may have stood in the way of what is right.
        search.keep(good)
        search.spread()
        search.keep(_checked(search, board))
    return _finished(search, board)


def _checked(search: Search, board: Board) -> Int[np.ndarray, " _"]:
    return checked_points(search.images[0], board, search.found, search.places[search.found])


def _finished(search: Search, board: Board) -> BoardCorners | None:
    """All points of a search fitted once more in the picture itself, without those that are wrong.

    Neighbors now are points too, and not corners of markers; the tone curve is known.
    """
    numbers = np.sort(search.found)
    if len(numbers) < FEWEST:
        return None
    points, places = board.points[numbers], search.places[numbers]
    chosen, _, _ = maps_from_neighbors(points, points, places, board.square, within=BESIDE)
    numbers, points, places = numbers[chosen], points[chosen], places[chosen]
    if len(numbers) < FEWEST:
        return None
    fit = register(
        search.images[0],
        search.pattern,
        smooth_maps(points, places, board.square),
        points,
        search.look,
        start=places,
        half=HALVES[board.kind],
        steps=STEPS[board.kind],
        learn_tone=False,
    )
    unexplained = 1 - fit.likeness
    good = unexplained < max(UNLIKE * float(np.median(unexplained)), UNLIKELY)
    good &= fit.shifts < SHIFT
    if np.count_nonzero(good) < FEWEST:
        return None
    errors = np.hypot(fit.errors[good], LEAST_ERRORS[board.kind])
    return BoardCorners(numbers[good], fit.places[good], errors)
