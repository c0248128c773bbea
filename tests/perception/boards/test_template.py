"""What ``designopt new board`` writes: a description that is read, and prints of that board."""

import tomllib
from importlib.metadata import EntryPoint

import pytest

from designopt import cli, file_template
from designopt.file_template import TEMPLATE_GROUP
from perception.boards import Board, read_board
from perception.boards.drawing import print_pdf, print_svg
from perception.boards.template import TEMPLATES, format_board
from tests.commands import check_command_refused

TAGS = Board(kind="apriltag", columns=5, rows=4, square=20.0, marker=16.0, first_marker=3)


@pytest.fixture(autouse=True)
def _installed(monkeypatch, tmp_path):
    point = EntryPoint("board", "perception.boards.template:TEMPLATES", TEMPLATE_GROUP)
    monkeypatch.setattr(file_template, "entry_points", lambda group: [point])
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("board", [Board(), TAGS])
def test_a_written_board_is_read_and_has_every_key_with_its_meaning(tmp_path, board):
    text = format_board(board)
    (tmp_path / "board.toml").write_text(text, encoding="utf-8")
    assert read_board(tmp_path / "board.toml") == board
    lines = text.splitlines()
    given = tomllib.loads(text)["board"]
    for name, field in Board.model_fields.items():
        assert any(line.startswith((f"{name} =", f"# {name} =")) for line in lines)
        assert (name in given) == (getattr(board, name) is not None)
        assert field.description
        assert field.description.split(";")[0][:40] in text.replace("\n# ", " ")
    assert max(map(len, lines)) <= 98


def test_new_board_writes_file_and_prints(tmp_path, capsys):
    assert cli.run(["new", "board"]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert shown.out.splitlines() == [
        "board.toml",
        "board.pdf",
        "board.svg",
        "next: designopt calibrate lens pictures --board board.toml",
    ]
    assert read_board("board.toml") == Board()
    assert (tmp_path / "board.pdf").read_bytes() == print_pdf(Board())
    assert (tmp_path / "board.svg").read_bytes() == print_svg(Board())


def test_settings_change_file_and_prints(tmp_path):
    settings = ["kind=apriltag", "columns=5", "rows=4", "square=20", "marker=16", "first_marker=3"]
    assigned = [word for text in settings for word in ("--set", text)]
    assert cli.run(["new", "board", "tags.toml", *assigned]) == 0
    assert read_board("tags.toml") == TAGS
    assert (tmp_path / "tags.svg").read_bytes() == print_svg(TAGS)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("new board --set colums=3", ["--set colums: unknown key; did you mean 'columns'?"]),
        (
            "new board --set rows=2",
            ["columns and rows must be at least 3", "designopt new board -"],
        ),
        ("new board --set square=x", ["--set square=x: input should be a valid number"]),
        ("new board --set dictionary=aruco", ["--set dictionary=aruco: input should be 'aruco-"]),
    ],
)
def test_faults_leave_no_file(tmp_path, capsys, line, words):
    check_command_refused(capsys, line, words)
    assert list(tmp_path.iterdir()) == []


def test_listing_needs_no_drawing():
    [template] = TEMPLATES
    assert 20 < len(f"{template.name}{template.purpose}") < 140
    assert template.content() == format_board(Board())
