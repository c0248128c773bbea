"""The print of a board: its rectangles in the files, its scale, its paper, and that it is found."""

import re
import xml.etree.ElementTree as ElementTree
import zlib

import cv2
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from perception.boards import Board, detect_board, draw_board
from perception.boards.drawing import board_corner, paper_size, print_pdf, print_svg
from perception.boards.pattern import dark_rectangles
from tests.perception.boards.pictured import CHARUCO, TAGS
from tests.perception.boards.test_board import board_of
from tests.readable import assert_readable

PRINTS = [CHARUCO, TAGS]
POINT = 25.4 / 72
ROUNDED = 1e-6
"""mm: files have six decimals of a point."""


def svg_rectangles(data: bytes) -> np.ndarray:
    """Rectangles of the largest path of an SVG, mm."""
    root = ElementTree.fromstring(data)
    paths = [part.get("d", "") for part in root.iter("{http://www.w3.org/2000/svg}path")]
    numbers = re.findall(r"-?\d+(?:\.\d+)?", max(paths, key=lambda path: path.count("M")))
    return boxes(np.array(numbers, float).reshape(-1, 4, 2))


def pdf_rectangles(data: bytes) -> np.ndarray:
    """The same of a PDF, whose y axis points up."""
    [[height]] = [
        np.array(box.split(b" ")[3:], float)
        for box in re.findall(rb"/MediaBox \[ ?([^]]*?) ?\]", data)
    ]
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", data, re.DOTALL)
    texts = [zlib.decompress(one) for one in streams if one[:1] == b"x"]
    text = max(texts, key=lambda text: text.count(b" m\n"))
    corners = rb"([-\d.]+) ([-\d.]+) m\n" + 3 * rb"([-\d.]+) ([-\d.]+) l\n"
    found = np.array(re.findall(corners, text), float).reshape(-1, 4, 2)
    return boxes(found * [1, -1] + [0, height])


def boxes(corners: np.ndarray) -> np.ndarray:
    """Left, top, right and bottom of polygons in points, as mm."""
    return np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1) * POINT


def in_order(rectangles: np.ndarray) -> np.ndarray:
    return rectangles[np.lexsort(rectangles.round(3).T)]


@pytest.mark.parametrize("printed", PRINTS)
@pytest.mark.parametrize(
    ("made", "read"), [(print_svg, svg_rectangles), (print_pdf, pdf_rectangles)]
)
def test_the_files_have_every_rectangle_to_scale(printed, made, read):
    board = board_of(printed)
    left, top = board_corner(board, paper_size(board))
    wanted = dark_rectangles(board) + np.array([left, top, left, top])
    found = read(made(board))
    found = found[np.all(found[:, 2:] - found[:, :2] < 40, axis=1)]  # neither paper nor lines
    np.testing.assert_allclose(in_order(found), in_order(wanted), atol=ROUNDED)
    assert made(board) == made(board)  # no date, no random names


@pytest.mark.parametrize("printed", PRINTS)
def test_on_screen_it_is_opencvs_board_and_is_found(printed):
    board, density = board_of(printed), 10
    figure = draw_board(board)
    figure.set_dpi(25.4 * density)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[..., 0]
    left, top = np.rint(np.array(board_corner(board, paper_size(board))) * density).astype(int)
    wanted = cv2.resize(
        printed.drawn(printed.density),
        np.rint(printed.size * density).astype(int).tolist(),
        interpolation=cv2.INTER_AREA,
    )
    rows, columns = wanted.shape
    shown = image[top : top + rows, left : left + columns]
    edges = cv2.dilate(cv2.Canny(wanted, 50, 150), np.ones((3, 3))) > 0
    assert np.count_nonzero(~edges) > 0.5 * edges.size
    assert np.array_equal(shown[~edges] > 127, wanted[~edges] > 127)
    small = cv2.resize(np.ascontiguousarray(image), None, fx=0.5, fy=0.5, interpolation=3)
    corners = detect_board(small, board)
    assert corners is not None
    assert corners.numbers.tolist() == list(range(len(board.points)))
    places = (corners.places + 0.5) / (density / 2) - board_corner(board, paper_size(board))
    np.testing.assert_allclose(places, board.points, atol=0.02)


@pytest.mark.parametrize(
    ("board", "paper"),
    [
        (Board(), (210, 297)),
        (Board(columns=14, rows=9, square=18.0), (297, 420)),
        (Board(columns=17, rows=9, square=15.0), (297, 420)),
        (Board(columns=20, rows=9, square=12.0), (297, 210)),
        (Board(columns=12, rows=9, square=50.0), (670, 585)),
    ],
)
def test_the_paper_has_room_for_board_margin_and_words(board, paper):
    assert paper_size(board) == paper
    np.testing.assert_allclose(draw_board(board).get_size_inches() * 25.4, paper)
    left, top = board_corner(board, paper)
    assert min(left, top) >= 10 + board.square / 2
    assert top + board.size[1] + board.square / 2 <= paper[1] - 65


@pytest.mark.parametrize("board", [Board(), Board(kind="apriltag", columns=3, rows=2)])
def test_lines_of_50_mm_and_the_description_stand_below(board):
    figure = draw_board(board)
    assert_readable(figure)
    [axes] = figure.axes
    [line] = axes.lines
    to_mm = axes.transData + figure.dpi_scale_trans.inverted()
    places = to_mm.transform(line.get_xydata()) * 25.4
    assert np.linalg.norm(places[1] - places[2]) == pytest.approx(50)
    assert np.linalg.norm(places[2] - places[3]) == pytest.approx(50)
    words = "\n".join(text.get_text() for text in axes.texts)
    for part in (f"{board.columns} x {board.rows}", "5 mm", "3.75 mm", board.family, "100 %"):
        assert part in words
    assert words.count("50 mm") == 3
    assert np.allclose(to_mm.transform([0, 0]) * 25.4, [0, paper_size(board)[1]])
