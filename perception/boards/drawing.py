"""A board as it is printed: to scale, with a check of the scale and a description."""

from __future__ import annotations

import io
import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from designopt.plot.figures import style
from perception.boards.board import Board
from perception.boards.pattern import dark_rectangles

PAPERS = ((210.0, 297.0), (297.0, 210.0), (297.0, 420.0), (420.0, 297.0))
"""A4 and A3, upright and across, mm (ISO 216); a larger board has paper of its own."""

EDGE = 10.0
"""From the paper's edge on, a printer may leave so much empty, mm."""

CHECK, FOOT = 50.0, 65.0
"""Length of the two lines that check the scale, and the room for them and the words, mm."""

INCH, POINT = 25.4, 25.4 / 72
"""In mm."""


def draw_board(board: Board) -> Figure:
    """The board on paper, to scale.

    White is left around it by half a square. Below stand two lines of 50 mm, which show whether it
    was printed to scale along both axes, and what the board is.

    Example:
        >>> (draw_board(Board()).get_size_inches() * 25.4).round().tolist()
        [210.0, 297.0]
    """
    width, height = size = paper_size(board)
    figure = Figure(figsize=(width / INCH, height / INCH))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(height, 0))
    axes.set_axis_off()
    left, top = board_corner(board, size)
    rectangles = dark_rectangles(board) + np.array([left, top, left, top])
    corners = rectangles[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 4, 2)
    # Black that adjoins is one area, or printers and screens would leave hairlines between.
    whole = Path.make_compound_path(*(Path(one, closed=True) for one in _closed(corners)))
    axes.add_patch(PathPatch(whole, facecolor="black", linewidth=0))
    x, y = EDGE, height - EDGE
    line = {"color": "black", "linewidth": 0.2 / POINT, "solid_capstyle": "butt"}
    ticks = [(x + CHECK, y - 1.5), (x + CHECK, y), (x, y), (x, y - CHECK), (x + 1.5, y - CHECK)]
    axes.plot(*zip(*ticks, strict=True), **line)
    words = {"fontsize": 2.8 / POINT, "va": "bottom"}
    axes.text(x + CHECK / 2, y - 1, f"{CHECK:g} mm", ha="center", **words)
    axes.text(x + 1, y - CHECK / 2, f"{CHECK:g} mm", **words)
    axes.text(x + 12, y - 10, "\n".join(describe(board)), linespacing=1.5, **words)
    return figure


def describe(board: Board) -> list[str]:
    """What a board is, and how it is printed, in lines.

    Example:
        >>> describe(Board())[0]
        'charuco: 12 x 9 squares of 5 mm'
    """
    what = "squares of" if board.kind == "charuco" else "tags, one every"
    last = board.first_marker + board.marker_count - 1
    return [
        f"{board.kind}: {board.columns} x {board.rows} {what} {board.square:g} mm",
        f"markers {board.first_marker} to {last} of {board.family}, {board.marker_side:g} mm",
        f"print at 100 %, and measure: both lines are {CHECK:g} mm long",
    ]


def print_pdf(board: Board) -> bytes:
    """The print as PDF."""
    undated = {"CreationDate": None, "Title": describe(board)[0]}
    return _saved(board, format="pdf", metadata=undated)


def print_svg(board: Board) -> bytes:
    """The print as SVG."""
    return _saved(board, format="svg", metadata={"Date": None, "Title": describe(board)[0]})


def paper_size(board: Board) -> tuple[float, float]:
    """Width and height of the paper, mm."""
    width, height = (side + board.square + 2 * EDGE for side in board.size)
    needed = width, height + FOOT
    fitting = (paper for paper in PAPERS if paper[0] >= needed[0] and paper[1] >= needed[1])
    return next(fitting, (max(math.ceil(needed[0]), PAPERS[0][0]), math.ceil(needed[1])))


def board_corner(board: Board, paper: tuple[float, float]) -> tuple[float, float]:
    """Where the board's upper left corner is, from the paper's, mm."""
    return (paper[0] - board.size[0]) / 2, EDGE + board.square / 2


def _closed(corners: np.ndarray) -> np.ndarray:
    """Polygons with their first corner at their end again."""
    return np.concatenate([corners, corners[:, :1]], axis=1)


def _saved(board: Board, **how: object) -> bytes:
    stream = io.BytesIO()
    with style():
        draw_board(board).savefig(stream, **how)  # type: ignore[arg-type]
    return stream.getvalue()
