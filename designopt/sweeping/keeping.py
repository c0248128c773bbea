"""The folder of a sweep: what was asked for, and every finished point in a file of its own."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from designopt.errors import UserError
from designopt.files import replaced_when_complete
from designopt.sweeping.outcomes import Outcome, from_tables, to_tables

DEFINITION = "sweep.json"
POINTS = "points"
RESULT = "result"


@contextmanager
def only_one(path: Path) -> Iterator[None]:
    """Keep other sweeps out of a folder, which is made as needed, while the context lasts.

    Where its file system cannot lock folders, nothing keeps them out; they would then compute the
    same points twice.

    Raises:
        UserError: another sweep is at work there, or it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        place = os.open(path, os.O_RDONLY)
    except OSError as error:
        raise _cannot_write(path, error) from error
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise UserError(
                f"--out {path}: another sweep is at work there; wait for it, or name another folder"
            ) from error
        except OSError:  # not on every file system
            pass
        yield
    finally:
        os.close(place)


class Folder:
    """A sweep's folder.

    Attributes:
        path: where it is.
    """

    def __init__(self, path: Path, definition: Mapping[str, Any], *, force: bool) -> None:
        """Begin a sweep in an empty folder, or go on with one of the same definition.

        Args:
            path: the folder; see `only_one`.
            definition: what decides every point's numbers, as plain data with ``"versions"``.
            force: forget another sweep that is kept there.

        Raises:
            UserError: it holds another sweep, one of other versions, or anything else; or it
                cannot be written.
        """
        self.path = path
        try:
            begun = (path / DEFINITION).exists()
            # What a command that was killed while it wrote has left behind.
            for pattern in (f".{DEFINITION}.*", *([f"{POINTS}/.*", ".partial-*"] if begun else [])):
                for leftover in path.glob(pattern):
                    shutil.rmtree(leftover, ignore_errors=True)
            names = {entry.name for entry in path.iterdir()}
            if names and not begun:
                raise UserError(f"--out {path}: it holds no sweep; name a new folder")
            if begun:
                if not force:
                    self._compare(definition)
                    return
                strangers = sorted(names - {DEFINITION, POINTS, RESULT})
                if strangers:
                    raise UserError(
                        f"--out {path}: it holds more than a sweep ({strangers[0]}), so --force "
                        "does not replace it; name another folder"
                    )
                for name in (RESULT, POINTS):
                    if (path / name).exists():
                        shutil.rmtree(path / name)
            _write(path / DEFINITION, definition)
        except OSError as error:
            raise _cannot_write(path, error) from error

    def _compare(self, definition: Mapping[str, Any]) -> None:
        kept = _read(self.path / DEFINITION)
        wanted = json.loads(json.dumps(definition))
        other = [key for key in wanted if kept.get(key) != wanted[key]]
        if not other:
            return
        if other == ["versions"]:
            versions = kept.get("versions") or {}
            package = next(
                name
                for name in wanted["versions"]
                if wanted["versions"][name] != versions.get(name)
            )
            raise UserError(
                f"--out {self.path}: its points were made with {package} "
                f"{versions.get(package)}, and this is {wanted['versions'][package]}: they would "
                "not fit together; name another folder, or begin anew with --force"
            )
        raise UserError(
            f"--out {self.path}: it holds another sweep (other {' and '.join(other)}); name "
            "another folder, or replace it with --force"
        )

    def outcomes(self) -> dict[int, Outcome]:
        """The kept points by their number.

        Raises:
            UserError: a file is damaged.
        """
        found = {}
        for path in kept_in(self.path):
            try:
                found[int(path.stem)] = from_tables(_read(path))
            except (KeyError, TypeError, ValueError) as error:
                raise UserError(f"{path}: it is no point of a sweep; delete it") from error
        return found

    def keep(self, index: int, settings: Mapping[str, Any], outcome: Outcome) -> None:
        """Write a finished point, whole or not at all.

        Raises:
            UserError: it cannot be written.
        """
        path = self.path / POINTS / f"{index:06d}.json"
        try:
            path.parent.mkdir(exist_ok=True)
        except OSError as error:
            raise UserError(f"{path.parent}: cannot be written: {error.strerror}") from error
        _write(path, {"point": index, "settings": dict(settings)} | to_tables(outcome))


def kept_in(path: Path) -> list[Path]:
    """The files of the points that are kept in a sweep's folder, in their order."""
    return sorted((path / POINTS).glob("[0-9]*.json"))


def _cannot_write(path: Path, error: OSError) -> UserError:
    return UserError(f"--out {path}: cannot be written ({error.strerror}); name a folder that can")


def _read(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise UserError(f"{path}: it is damaged; delete it, or begin anew with --force") from error
    if not isinstance(document, dict):
        raise UserError(f"{path}: it is damaged; delete it, or begin anew with --force")
    return document


def _write(path: Path, document: Mapping[str, Any]) -> None:
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    with replaced_when_complete(path) as partial:
        partial.write_text(text + "\n", encoding="utf-8")
