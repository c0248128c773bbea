"""Boards found in pictures of wide lenses, against places that are known."""

import cv2
import numpy as np
import pytest

from designopt.errors import UserError
from perception.boards import Board, BoardCorners, detect_board, detection
from perception.boards.markers import find_markers
from tests.perception.boards.pictured import CHARUCO, TAGS, Print, View, before, picture, turned
from tests.perception.boards.test_board import board_of

BORDER, SMALLEST = 12, 12
"""Points that must be found are so far from the border, and their squares so large, px."""

VIEWS = {
    "close, flat": (before(View(), CHARUCO, 0, 16, turned(5, 0, 10)), CHARUCO, {}),
    "half of it": (
        before(View("equisolid", np.radians(90)), CHARUCO, 55, 25, turned(30, 100, 200)),
        CHARUCO,
        {"blur": 1.2, "noise": 0.02, "vignetting": 0.7},
    ),
    "steep": (
        before(View("stereographic", np.radians(95)), CHARUCO, 20, 28, turned(60, 40, 100)),
        CHARUCO,
        {"gamma": 2.2, "jpeg": 70},
    ),
    "far": (
        before(View("equisolid", np.radians(60), pupil=0.2), CHARUCO, 15, 60, turned(35, 250, 0)),
        CHARUCO,
        {"noise": 0.02, "jpeg": 70},
    ),
    "tags": (
        before(View("equidistant", np.radians(75)), TAGS, 25, 24, turned(35, 60, -30)),
        TAGS,
        {"gamma": 2.2, "noise": 0.015},
    ),
}
MOST = {"charuco": (0.03, 0.25), "apriltag": (0.06, 0.5)}
"""Median and largest error, px."""


def compared(corners: BoardCorners | None, view: View, printed: Print) -> np.ndarray:
    """Distances from the truth; all points that are well in sight are found."""
    assert corners is not None
    truth = view.places(printed.points)
    sides = [
        view.places(printed.points + step) - view.places(printed.points - step)
        for step in printed.square / 2 * np.eye(2)
    ]
    sizes = np.min(np.linalg.norm(sides, axis=2), axis=0)
    well = (truth > BORDER) & (truth < np.array(view.size) - 1 - BORDER)
    wanted = np.flatnonzero(well.all(axis=1) & (sizes > SMALLEST))
    assert len(wanted) > 30
    assert np.isin(wanted, corners.numbers).mean() > 0.9
    assert np.all(np.diff(corners.numbers) > 0)
    return np.linalg.norm(corners.places - truth[corners.numbers], axis=1)


@pytest.mark.parametrize("name", VIEWS)
def test_points_are_where_they_are(name):
    view, printed, effects = VIEWS[name]
    corners = detect_board(picture(view, printed, **effects), board_of(printed))
    errors = compared(corners, view, printed)
    assert corners is not None
    median, most = MOST[printed.kind]
    assert np.median(errors) < median
    assert errors.max() < most
    assert np.all(corners.errors > 0)
    assert 0.2 < np.sqrt(np.mean(errors**2 / 2 / corners.errors**2)) < 3


@pytest.fixture(scope="module")
def shown() -> tuple[View, np.ndarray]:
    """One view with its picture."""
    view, printed, effects = VIEWS["far"]
    return view, picture(view, printed, **effects)


def test_in_colors_it_is_found_as_well(shown):
    view, gray = shown
    tinted = np.stack([gray, (0.9 * gray).astype(np.uint8), (0.7 * gray).astype(np.uint8)], -1)
    errors = compared(detect_board(tinted, board_of(CHARUCO)), view, CHARUCO)
    assert errors.max() < 0.25


def test_points_behind_something_are_left_out(shown):
    view, gray = shown
    truth = view.places(CHARUCO.points)
    low, high = truth[40:42].min(axis=0) - 14, truth[40:42].max(axis=0) + 14
    covered = gray.copy()
    cv2.rectangle(covered, low.astype(int).tolist(), high.astype(int).tolist(), 130, -1)
    corners = detect_board(covered, board_of(CHARUCO))
    assert corners is not None
    assert not np.isin([40, 41], corners.numbers).any()
    assert len(corners.numbers) > 60
    errors = np.linalg.norm(corners.places - truth[corners.numbers], axis=1)
    assert errors.max() < 0.3


def test_few_markers_are_enough(shown, monkeypatch):
    view, gray = shown
    board = board_of(CHARUCO)
    numbers, corners = find_markers(gray, board)
    few = np.argsort(numbers)[[12, 20]]
    monkeypatch.setattr(detection, "find_markers", lambda *_: (numbers[few], corners[few]))
    found = detect_board(gray, board)
    errors = compared(found, view, CHARUCO)
    assert errors.max() < 0.25


def test_misread_markers_make_no_points(shown, monkeypatch):
    view, gray = shown
    board = board_of(CHARUCO)
    numbers, corners = find_markers(gray, board)
    wrong = np.where(np.arange(len(numbers)) % 3 == 0, (numbers + 7) % 54, numbers)
    monkeypatch.setattr(detection, "find_markers", lambda *_: (wrong, corners))
    found = detect_board(gray, board)
    assert found is not None
    truth = view.places(CHARUCO.points)[found.numbers]
    assert len(found.numbers) > 40
    assert np.linalg.norm(found.places - truth, axis=1).max() < 0.3
    # All wrong in the same way: every point fits its neighbors.
    shifted = np.where(numbers % 6 < 5, numbers + 1, numbers - 5)
    monkeypatch.setattr(detection, "find_markers", lambda *_: (shifted, corners))
    assert detect_board(gray, board) is None


def test_markers_are_where_they_are(shown):
    view, gray = shown
    board = board_of(CHARUCO)
    numbers, corners = find_markers(gray, board)
    assert len(set(numbers.tolist())) > 30
    truth = view.places(board.marker_corners.reshape(-1, 2)).reshape(-1, 4, 2)
    assert np.linalg.norm(corners - truth[numbers], axis=2).max() < 3


def test_small_markers_are_found_in_a_larger_copy():
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_100)
    made = cv2.aruco.CharucoBoard((6, 5), 8.0, 6.0, words)
    fine = made.generateImage((6 * 70 + 84, 5 * 70 + 84), None, 42)
    small = cv2.resize(fine, None, fx=1 / 6, fy=1 / 6, interpolation=cv2.INTER_AREA)
    board = Board(columns=6, rows=5, square=8.0)
    numbers, corners = find_markers(small, board)
    assert len(numbers) > 4
    wanted = board.marker_corners[numbers] * 70 / 8 / 6 + 42 / 6 - 0.5
    assert np.abs(corners - wanted).max() < 1.5


@pytest.mark.parametrize("board", [board_of(CHARUCO), board_of(TAGS)])
def test_a_picture_without_a_board_has_none(shown, board):
    generator = np.random.default_rng(3)
    noise = generator.integers(0, 256, (240, 320), np.uint8)
    blocks = cv2.resize(noise[:30, :40], (320, 240), interpolation=cv2.INTER_NEAREST)
    smooth = cv2.GaussianBlur(noise, (0, 0), 3)
    images = [noise, blocks, cv2.equalizeHist(smooth), np.zeros((240, 320), np.uint8)]
    images += [generator.integers(0, 256, (200, 200, 3), np.uint8), np.full((5, 300), 9, np.uint8)]
    images += [np.full((1, 1), 255, np.uint8), noise[:3, :3], noise[:20, :20]]
    for image in images:
        assert detect_board(image, board) is None


def test_another_board_and_a_mirrored_one_are_none(shown):
    _, gray = shown
    for other in ({"first_marker": 50, "rows": 8}, {"dictionary": "aruco-5x5-100"}):
        assert detect_board(gray, board_of(CHARUCO, **other)) is None
    assert detect_board(gray[:, ::-1], board_of(CHARUCO)) is None


def test_what_is_no_picture_is_refused():
    for wrong in (None, np.zeros((9, 9)), np.zeros((4, 9, 9), np.uint8), "board.png"):
        with pytest.raises(UserError, match="a picture of a board"):
            detect_board(wrong, Board())
