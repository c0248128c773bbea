"""What ``designopt new board`` writes: a board's description, and its print beside it."""

from __future__ import annotations

from designopt.file_template import FileTemplate
from designopt.study.settings_file import format_spec
from designopt.study.study import lazily
from perception.boards.board import Board, BoardFile

HEAD = """\
A board for calibrating a camera.

Its prints stand beside this file. Print one at 100 %, measure its two lines of 50 mm, and glue it
on something plane: glass, or a plate of metal. What is behind a # has its default. With other keys,
make file and prints anew,

    designopt new board FILE --set KEY=VALUE --force

for a key that is changed here changes no print."""


def format_board(board: Board | None = None) -> str:
    """The text of a board's file.

    Args:
        board: the board; that with the default keys by default.

    Example:
        >>> lines = format_board(Board(rows=7)).splitlines()
        >>> lines[lines.index("rows = 7") - 1]
        '# squares, or tags, along y; >= 1, <= 100'
    """
    return format_spec(HEAD, BoardFile, BoardFile(board=board or Board()))


PRINTS = {
    ending: lazily(f"perception.boards.drawing:print_{ending[1:]}") for ending in (".pdf", ".svg")
}

TEMPLATES = (
    FileTemplate(
        "board",
        "board: for calibrating a camera, with its print as PDF and SVG",
        "designopt calibrate lens --board",
        format_board,
        Board,
        PRINTS,
    ),
)
