"""Files a person names on the command line: read with care, checked, written whole."""

from __future__ import annotations

import os
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from designopt.errors import UserError
from designopt.io.staging import sync

FIGURE_ENDINGS = (".png", ".svg", ".pdf")

DEEPEST = 32
"""Tables and lists in each other. No file needs more, and Python's recursion has an end."""


def printable(text: str) -> str:
    """A text with spaces for what cannot be printed; no file format can hold, say, a bell."""
    return "".join(char if char.isprintable() else " " for char in text)


def is_too_deep(value: object) -> bool:
    """Whether tables and lists lie in each other more than `DEEPEST` times."""
    level = [value]
    for _ in range(DEEPEST + 1):
        level = [
            part
            for one in level
            if isinstance(one, (dict, list))
            for part in (one.values() if isinstance(one, dict) else one)
        ]
    return bool(level)


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """The tables of a TOML file.

    Args:
        path: the file.
        what: what it describes, such as ``"linkage"``, for messages.

    Raises:
        UserError: it cannot be read or is no TOML.
    """
    try:
        # Some editors mark UTF-8 by a first character that is not TOML.
        text = Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: cannot be read: it is not UTF-8 text") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UserError(f"{path}: cannot be read: {reason}") from error
    try:
        tables = tomllib.loads(text)
        if is_too_deep(tables):
            raise RecursionError
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{path}: not TOML: {error}; correct it there") from error
    except ValueError as error:
        raise UserError(f"{path}: it holds a number of too many digits; shorten it") from error
    except RecursionError as error:
        raise UserError(f"{path}: its tables are nested too deeply for a {what}") from error
    return tables


def check_toml(path: Path, what: str) -> None:
    """Refuse a file that `read_toml` would refuse, unless it can be read only once, as a pipe.

    Raises:
        UserError: as `read_toml`.
    """
    if os.path.isfile(path) or not os.path.lexists(path):
        read_toml(path, what)


def check_new_folder(folder: Path, *, force: bool) -> None:
    """Refuse a folder that could not be made, before anything is computed for it.

    Args:
        folder: the folder; folders above it are made as needed.
        force: whether there may be one.

    Raises:
        UserError: it exists and must not, or something else is in its place or above it.
    """
    wanted = Path(os.path.realpath(folder))
    place = next(path for path in (wanted, *wanted.parents) if os.path.lexists(path))
    if (place == wanted or os.path.islink(folder)) and not force:
        raise UserError(
            f"--out {folder}: exists already; name another folder, or replace an earlier result "
            "with --force"
        )
    if not os.path.isdir(place):
        raise UserError(
            f"--out {folder}: cannot be written ({place} is no folder); name a folder that can"
        )


def check_targets(named: Mapping[str, Path | str | None], *, force: bool) -> None:
    """Refuse files that could not be written, before anything is computed for them.

    Args:
        named: files to write, by the option that names them; ``None`` is not asked for.
        force: whether existing files may be replaced.

    Raises:
        UserError: one is a folder, is in none, is named twice, or exists and must not be replaced.
    """
    seen: dict[Path, str] = {}
    for option, target in named.items():
        if target is None:
            continue
        path = Path(target)
        try:
            path.parent.stat()
            path.is_dir()
        except OSError as error:
            if not isinstance(error, FileNotFoundError):
                raise UserError(f"{option} {path}: {error.strerror}; choose another") from error
        if str(target) == "" or path.is_dir():
            raise UserError(f"{option} {target}: that is a folder; name a file in it")
        if path.resolve() in seen:
            raise UserError(f"{option} {path}: {seen[path.resolve()]} names it too; use two files")
        seen[path.resolve()] = option
        if not path.parent.is_dir():
            raise UserError(f"{option} {path}: there is no folder {path.parent}; make it first")
        if path.exists() and not path.is_file():
            raise UserError(f"{option} {path}: that is no ordinary file; choose another")
        if path.exists() and not force:
            raise UserError(
                f"{option} {path}: exists already; choose another file, or replace it by --force"
            )


def check_figure_ending(option: str, path: Path) -> None:
    """Refuse a figure of a kind that is not drawn here.

    Raises:
        UserError: the file, named by ``option``, ends otherwise than `FIGURE_ENDINGS`.
    """
    if path.suffix.lower() not in FIGURE_ENDINGS:
        raise UserError(f"{option} {path}: a figure ends in {', '.join(FIGURE_ENDINGS)}")


@contextmanager
def replaced_when_complete(path: Path) -> Iterator[Path]:
    """A file to write beside ``path``, which takes its place if nothing goes wrong.

    It is on the disk before, so that ``path`` is whole at every moment.

    Raises:
        UserError: the folder or the file cannot be written.
    """
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
            partial = Path(folder) / path.name
            yield partial
            sync(partial)
            os.replace(partial, path)
            sync(path.parent)
    except OSError as error:
        reason = error.strerror or str(error)
        raise UserError(f"{path}: cannot be written: {reason}; choose another") from error


def remove_partials(folder: Path, names: str) -> None:
    """Remove what killed processes left of files that were to be replaced when complete.

    Args:
        folder: of these files.
        names: pattern of their names, as of `Path.glob`.
    """
    for leftover in folder.glob(f".{names}.????????"):
        with suppress(OSError):  # it is somebody else's
            name = leftover.name[1:-9]
            (leftover / name).unlink(missing_ok=True)
            leftover.rmdir()
