"""A board's description: its points against OpenCV's boards, and what is refused."""

import cv2
import numpy as np
import pytest

from designopt.errors import UserError
from perception.boards import Board, read_board
from perception.boards.board import Dictionary, markers_in
from perception.boards.pattern import opencv_name
from tests.perception.boards.pictured import CHARUCO, TAGS, Print

PRINTS = [CHARUCO, TAGS, Print("charuco", 5, 4, 12.0, 7.0, "DICT_5X5_50", 1)]


def board_of(printed: Print, **more: object) -> Board:
    """The same board."""
    family = printed.words.removeprefix("DICT_").lower().replace("_", "-")
    dictionary = family if family.startswith("april") else f"aruco-{family}"
    plain = printed._asdict()
    known = {name: plain[name] for name in ("kind", "columns", "rows", "square", "marker")}
    return Board(**known | {"dictionary": dictionary} | more)  # type: ignore[arg-type]


@pytest.mark.parametrize("printed", PRINTS)
def test_points_and_markers_are_opencvs(printed):
    board = board_of(printed)
    np.testing.assert_allclose(board.points, printed.points, atol=1e-5)
    corners = np.array(printed.made.getObjPoints())[..., :2]
    np.testing.assert_allclose(board.marker_corners, corners, atol=1e-5)
    assert board.marker_count == len(printed.made.getIds())
    np.testing.assert_allclose(board.size, printed.size)


@pytest.mark.parametrize("name", Dictionary.__args__)
def test_dictionaries_are_opencvs(name):
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(name)))
    assert markers_in(name) == len(words.bytesList)


def test_what_is_left_out_follows_from_the_rest():
    assert Board().marker_side == 3.75
    assert Board(square=8.0).marker_side == 6.0
    assert Board(marker=2.0).marker_side == 2.0
    assert (Board().family, Board(kind="apriltag").family) == ("aruco-4x4-100", "apriltag-36h11")


def written(folder, text: str):
    path = folder / "board.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_is_read(tmp_path):
    text = '[board]\nkind = "apriltag"\ncolumns = 4\nrows = 3\nsquare = 20\nfirst_marker = 7\n'
    wanted = Board(kind="apriltag", columns=4, rows=3, square=20.0, first_marker=7)
    assert read_board(written(tmp_path, text)) == wanted
    assert read_board(written(tmp_path, "[board]\n")) == Board()


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("rws = 3", ["board.rws: no such key; did you mean 'rows'?"]),
        ("rows = 2", ["columns and rows must be at least 3 of charuco"]),
        ("rows = 0\ncolumns = 101", ["board.rows: ", "board.columns: "]),
        ("rows = 3.5", ["board.rows: "]),
        ("square = '5'", ["board.square: write a finite number, without quotes"]),
        ("marker = 4.8", ["marker (4.8 mm) must be at most 0.95 of square (5 mm)"]),
        ("dictionary = 'aruco-4x4'", ["board.dictionary: "]),
        (
            "kind = 'apriltag'\ndictionary = 'aruco-4x4-50'",
            ["dictionary 'aruco-4x4-50' has no AprilTags; choose apriltag-36h11"],
        ),
        ("rows = 20", ["markers 0 to 119 are needed", "'aruco-4x4-100' ends at 99"]),
        (
            "columns = 2\nmarker = 5\nfirst_marker = 97",
            ["must be at least 3 of charuco", "marker (5 mm)", "markers 97 to 105"],
        ),
        ("first_marker = 47", ["markers 47 to 100 are needed", "'aruco-4x4-100' ends at 99"]),
    ],
)
def test_a_faulty_file_is_refused_in_one_line(tmp_path, keys, words):
    path = written(tmp_path, f"[board]\n{keys}\n")
    with pytest.raises(UserError) as caught:
        read_board(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: board")
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "board: missing; add it"),
        ("[board]\n[lens]\n", "lens: no such key"),
        ("[chamber]\n", "it describes a chamber and no board"),
    ],
)
def test_another_file_is_refused(tmp_path, text, words):
    with pytest.raises(UserError, match=words):
        read_board(written(tmp_path, text))
