"""A printed plane target for calibrating a camera: what a person writes, and its points."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pydantic
from jaxtyping import Float

from designopt.design_kind import read_tables
from designopt.io.spec import Spec
from designopt.io.spec_files import validated

DEFAULT_SHARE = 0.75
"""Side of a marker in squares, unless it is given: as much of a square is left around it as one
ring of a marker of 4x4 bits is wide."""

Dictionary = Literal[
    "aruco-4x4-50",
    "aruco-4x4-100",
    "aruco-4x4-250",
    "aruco-4x4-1000",
    "aruco-5x5-50",
    "aruco-5x5-100",
    "aruco-5x5-250",
    "aruco-5x5-1000",
    "aruco-6x6-50",
    "aruco-6x6-100",
    "aruco-6x6-250",
    "aruco-6x6-1000",
    "aruco-7x7-50",
    "aruco-7x7-100",
    "aruco-7x7-250",
    "aruco-7x7-1000",
    "aruco-mip-36h12",
    "aruco-original",
    "apriltag-16h5",
    "apriltag-25h9",
    "apriltag-36h10",
    "apriltag-36h11",
]

MARKERS = {
    "aruco-mip-36h12": 250,
    "aruco-original": 1024,
    "apriltag-16h5": 30,
    "apriltag-25h9": 35,
    "apriltag-36h10": 2320,
    "apriltag-36h11": 587,
}
"""How many a dictionary has; the others have that number in their name."""

DEFAULT_DICTIONARIES: dict[str, Dictionary] = {
    "charuco": "aruco-4x4-100",
    "apriltag": "apriltag-36h11",
}

Length = Annotated[float, pydantic.Field(strict=True, ge=0.1, le=1000)]
Count = Annotated[int, pydantic.Field(strict=True, ge=1, le=100)]


class Board(Spec):
    """A plane target for calibrating a camera.

    Places on it are in mm from its upper left corner, x to the right and y down, so that its z axis
    points into it.
    """

    kind: Literal["charuco", "apriltag"] = pydantic.Field(
        default="charuco",
        description="a chessboard with a marker in every white square, whose inner corners are the "
        "points; or a grid of AprilTags, whose corners are",
    )
    columns: Count = pydantic.Field(default=12, description="squares, or tags, along x")
    rows: Count = pydantic.Field(default=9, description="squares, or tags, along y")
    square: Length = pydantic.Field(
        default=5.0, description="side of a square, or from one tag to the next (mm)"
    )
    marker: Length | None = pydantic.Field(
        default=None, description=f"side of a marker (mm); {DEFAULT_SHARE:g} of a square by default"
    )
    dictionary: Dictionary | None = pydantic.Field(
        default=None,
        description="the markers' family; by default "
        + ", ".join(f"{name} of {kind}" for kind, name in DEFAULT_DICTIONARIES.items()),
    )
    first_marker: Annotated[int, pydantic.Field(strict=True, ge=0, le=10_000)] = pydantic.Field(
        default=0,
        description="number of the first marker; boards in one picture must not share any",
    )

    @pydantic.model_validator(mode="after")
    def _can_be_printed(self) -> Board:
        faults = []
        if self.kind == "charuco" and min(self.columns, self.rows) < 3:
            faults.append("columns and rows must be at least 3 of charuco; make it larger")
        if self.marker_side > 0.95 * self.square:
            faults.append(
                f"marker ({self.marker_side:g} mm) must be at most 0.95 of square "
                f"({self.square:g} mm), or no white is left around it; make it smaller"
            )
        if self.kind == "apriltag" and not self.family.startswith("apriltag"):
            faults.append(f"dictionary '{self.family}' has no AprilTags; choose apriltag-36h11")
        there, last = markers_in(self.family), self.first_marker + self.marker_count - 1
        if last >= there:
            faults.append(
                f"markers {self.first_marker} to {last} are needed, and dictionary "
                f"'{self.family}' ends at {there - 1}; choose a larger one, or fewer columns"
            )
        if faults:
            raise ValueError("; ".join(faults))
        return self

    @property
    def marker_side(self) -> float:
        """Side of a marker, mm."""
        return DEFAULT_SHARE * self.square if self.marker is None else self.marker

    @property
    def family(self) -> Dictionary:
        """The dictionary of its markers."""
        return self.dictionary or DEFAULT_DICTIONARIES[self.kind]

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the chessboard, or from the first to the last tag, mm."""
        if self.kind == "charuco":
            return self.columns * self.square, self.rows * self.square
        gap = self.square - self.marker_side
        return self.columns * self.square - gap, self.rows * self.square - gap

    @property
    def marker_count(self) -> int:
        """How many markers it has."""
        cells = self.columns * self.rows
        return cells // 2 if self.kind == "charuco" else cells

    @property
    def marker_corners(self) -> Float[np.ndarray, "markers 4 2"]:
        """Corners of the markers from `first_marker` on, row by row, mm.

        Each marker's are in turn upper left, upper right, lower right and lower left.
        """
        row, column = (part.ravel() for part in np.indices((self.rows, self.columns)))
        starts = self.square * np.stack([column, row], axis=-1)
        if self.kind == "charuco":  # OpenCV has the black squares where this sum is even
            starts = starts[(row + column) % 2 == 1] + (self.square - self.marker_side) / 2
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        return starts[:, None] + self.marker_side * corners

    @property
    def points(self) -> Float[np.ndarray, "points 2"]:
        """What is found in pictures, mm, in the order of their numbers.

        Of a chessboard its inner corners row by row; of tags the `marker_corners`.

        Example:
            >>> board = Board(columns=4, rows=3, square=10.0)
            >>> board.points[:4].tolist()
            [[10.0, 10.0], [20.0, 10.0], [30.0, 10.0], [10.0, 20.0]]
        """
        if self.kind == "apriltag":
            return self.marker_corners.reshape(-1, 2)
        row, column = np.indices((self.rows - 1, self.columns - 1)) + 1
        return self.square * np.stack([column, row], axis=-1).reshape(-1, 2)


class BoardFile(Spec):
    """The whole file."""

    board: Board
    """The board."""


def markers_in(dictionary: Dictionary) -> int:
    """How many markers a dictionary has."""
    return MARKERS.get(dictionary) or int(dictionary.rpartition("-")[2])


def read_board(path: str | Path) -> Board:
    """The board that a file describes, as ``designopt new board`` writes it.

    Raises:
        UserError: the file cannot be read or describes no board; one line has all faults.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "board.toml"
        ...     _ = path.write_text("board = { columns = 5, rows = 4, square = 8 }")
        ...     read_board(path).size
        (40.0, 32.0)
    """
    return validated(BoardFile, read_tables(path, "board", "board"), str(path)).board
