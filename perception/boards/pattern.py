"""What is black on a board: as rectangles in mm, and as a picture that can be sampled."""

from __future__ import annotations

import functools
from itertools import groupby

import cv2
import numpy as np
from jaxtyping import Bool, Float

from perception.boards.board import Board, Dictionary

PER_SQUARE, MOST = 256, 10_000_000
"""Pixels of the finest picture along a square, and in all squares at most."""

COARSEST = 6
"""How often it can be halved."""


def opencv_dictionary(board: Board) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of the board's markers alone, the first of which has the number 0.

    Among fewer markers, fewer are mistaken for each other, and the search takes less time.
    """
    found = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(board.family)))
    last = board.first_marker + board.marker_count
    rows = found.bytesList[board.first_marker : last]
    return cv2.aruco.Dictionary(rows, found.markerSize, found.maxCorrectionBits)


def opencv_name(dictionary: Dictionary) -> str:
    """OpenCV's name of a dictionary.

    Example:
        >>> opencv_name("aruco-4x4-50"), opencv_name("aruco-mip-36h12")
        ('DICT_4X4_50', 'DICT_ARUCO_MIP_36h12')
    """
    family, *rest = dictionary.split("-")
    words = rest if rest[0][0].isdigit() and family == "aruco" else [family, *rest]
    return "_".join(["DICT", *(w if "h" in w else w.upper() for w in words)])


def marker_modules(board: Board) -> Bool[np.ndarray, "markers modules modules"]:
    """Which modules of the board's markers are white; around them is a ring of black ones."""
    dictionary = opencv_dictionary(board)
    side = dictionary.markerSize + 2
    drawn = [dictionary.generateImageMarker(i, side) for i in range(board.marker_count)]
    return np.array(drawn) > 0


def dark_rectangles(board: Board) -> Float[np.ndarray, "_ 4"]:
    """All that is black, as rectangles that do not overlap: left, top, right and bottom, mm.

    Example:
        >>> dark_rectangles(Board(columns=3, rows=3, square=10.0))[1].tolist()
        [20.0, 0.0, 30.0, 10.0]
    """
    modules = marker_modules(board)
    module = board.marker_side / modules.shape[1]
    found = []
    if board.kind == "charuco":
        row, column = np.indices((board.rows, board.columns))
        dark = (row + column) % 2 == 0
        starts = np.stack([column[dark], row[dark]], axis=-1)
        found.append(board.square * np.concatenate([starts, starts + 1], axis=1))
    for white, corners in zip(modules, board.marker_corners, strict=True):
        runs = [run for row, line in enumerate(white) for run in _dark_runs(row, line)]
        found.append(np.tile(corners[0], 2) + module * np.array(runs))
    return np.concatenate(found)


def _dark_runs(row: int, line: np.ndarray) -> list[tuple[int, int, int, int]]:
    """Runs of black modules of a marker's row, as rectangles in modules."""
    runs, start = [], 0
    for light, group in groupby(line):
        end = start + len(list(group))
        if not light:
            runs.append((start, row, end, row + 1))
        start = end
    return runs


class Pattern:
    """A board as pictures, each of which has half the pixels of another along x or y.

    Attributes:
        square: side of a square, mm.
        size: of the board, mm.
        margin: white that is sure to be around the board, mm.
        density: pixels of the finest picture along 1 mm.
    """

    def __init__(self, board: Board) -> None:
        """The pictures of a board."""
        self.square, self.size, self.margin = board.square, board.size, board.square / 4
        most = (MOST / (board.columns * board.rows)) ** 0.5
        self.density = min(PER_SQUARE, most) / board.square
        self._finest = self._rasterized(board)
        self._levels: dict[tuple[int, int], Float[np.ndarray, "rows columns"]] = {}

    @classmethod
    def of(cls, board: Board) -> Pattern:
        """The pictures of a board, drawn once for all images in which it is looked for."""
        return _drawn_once(board.model_dump_json())

    def level(self, across: int, down: int) -> Float[np.ndarray, "rows columns"]:
        """What share of every pixel is white, of the picture halved so often along x and y."""
        if (across, down) not in self._levels:
            rows, columns = self._finest.shape
            size = columns >> across, rows >> down
            halved = cv2.resize(self._finest, size, interpolation=cv2.INTER_AREA)
            self._levels[across, down] = halved
        return self._levels[across, down]

    def _rasterized(self, board: Board) -> Float[np.ndarray, "rows columns"]:
        whole = 1 << COARSEST
        columns, rows = (
            -int(-(side + 2 * self.margin) * self.density // whole) * whole for side in board.size
        )
        image = np.ones((rows, columns), np.float32)
        for left, top, right, bottom in (dark_rectangles(board) + self.margin) * self.density:
            down, rows_ = _covered(top, bottom)
            across, columns_ = _covered(left, right)
            image[rows_, columns_] -= down[:, None] * across
        return image


def _covered(start: float, end: float) -> tuple[Float[np.ndarray, " _"], slice]:
    """Shares of pixels between two places of a line, and which pixels these are."""
    first, last = int(np.floor(start)), int(np.ceil(end))
    edges = np.arange(first, last + 1, dtype=float)
    shares = np.diff(np.clip(edges, start, end))
    return shares.astype(np.float32), slice(first, last)


@functools.lru_cache(maxsize=2)
def _drawn_once(board: str) -> Pattern:
    return Pattern(Board.model_validate_json(board))
