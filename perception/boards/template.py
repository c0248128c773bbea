"""What ``designopt new board`` writes: a board's description, and its print beside it."""

from __future__ import annotations

from designopt.file_template import FileTemplate
from designopt.study.settings_file import format_spec
from designopt.study.study import lazily
from perception.boards.board import Board, BoardFile

HEAD = """\
A board for calibrating a camera.

Its print stands beside this file, as PDF and as SVG. Print it at 100 %, measure its two lines,
and glue it on something plane, such as glass. A key that is changed here changes no print: make
file and print anew with

    designopt new board FILE --set KEY=VALUE --force

What is behind a # has its default."""


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
    ".pdf": lazily("perception.boards.drawing:print_pdf"),
    ".svg": lazily("perception.boards.drawing:print_svg"),
}

TEMPLATES = (
    FileTemplate(
        "board",
        "board: for calibrating a camera, with its print as PDF and SVG",
        "designopt calibrate lens pictures --board",
        format_board,
        Board,
        PRINTS,
    ),
)
