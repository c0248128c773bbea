"""The folder of a sweep: what was asked for, and every finished point in a file of its own."""

from __future__ import annotations

import fcntl
import itertools
import json
import logging
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from designopt.errors import UserError
from designopt.io.checksums import checksum_holds, with_checksum
from designopt.io.files import remove_partials, replaced_when_complete
from designopt.study.result_folders import cannot_write, check_replaceable, recover_result
from designopt.sweep.outcomes import Outcome, from_json, to_json

LOG = logging.getLogger(__name__)

DEFINITION = "sweep.json"
POINTS = "points"
RESULT = "result"

NAMED = re.compile(r"[0-9]{6,}\.json")
"""Names of the points' files."""


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
        raise cannot_write(path, error) from error
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
            remove_partials(path, DEFINITION)
            if begun:
                recover_result(path / RESULT)
                remove_partials(path / POINTS, "[0-9]*.json")
            names = {entry.name for entry in path.iterdir()}
            if names and not begun:
                raise UserError(f"--out {path}: it holds no sweep; name a new folder")
            if begun:
                if (path / RESULT).exists():
                    check_replaceable(path / RESULT)
                if not force:
                    self._compare(definition)
                    return
                self._forget(names)
            _write(path / DEFINITION, with_checksum(definition))
        except OSError as error:
            raise cannot_write(path, error) from error

    def _forget(self, names: set[str]) -> None:
        """Remove another sweep's points, unless there is a file that it did not write.

        Its result stays until the new one takes its place.
        """
        strangers = sorted(names - {DEFINITION, POINTS, RESULT})
        if not checksum_holds(_read(self.path / DEFINITION), required=False):
            strangers.append(DEFINITION)
        points = sorted((self.path / POINTS).glob("*"))
        if (self.path / POINTS).is_symlink():
            strangers.append(POINTS)
        strangers += [f"{POINTS}/{path.name}" for path in points if _own_point(path) is None]
        if strangers:
            raise UserError(
                f"--out {self.path}: {strangers[0]} is not of the earlier sweep as it was written, "
                "so --force does not replace it; move it away, or name another folder"
            )
        for path in points:
            path.unlink()

    def _compare(self, definition: Mapping[str, Any]) -> None:
        kept = _read(self.path / DEFINITION)
        wanted = json.loads(json.dumps(definition))
        other = [key for key in wanted if kept.get(key) != wanted[key]]
        if not other:
            return
        if other == ["versions"]:
            before, now = kept.get("versions") or {}, wanted["versions"]
            package = next(name for name in now if now[name] != before.get(name))
            raise UserError(
                f"--out {self.path}: its points were made with {package} {before.get(package)}, "
                f"and this is {now[package]}: they would not fit together; name another folder, or "
                "begin anew with --force"
            )
        raise UserError(
            f"--out {self.path}: it holds another sweep (other {' and '.join(other)}); name "
            "another folder, or replace it with --force"
        )

    def outcomes(self, asked: Sequence[Mapping[str, Any]]) -> dict[int, Outcome]:
        """The kept points by their number.

        A file that is not the point of its number with the settings that are asked for, or is no
        longer as it was written, is named in a warning and is no outcome; one that no sweep
        wrote is renamed, for the point's own.

        Args:
            asked: the settings of every point of the sweep.
        """
        found, others = {}, []
        for path in kept_in(self.path):
            index, document = int(path.stem), _own_point(path)
            wanted = dict(asked[index]) if index < len(asked) else None
            if document is None:
                _set_aside(path)
                others.append(path.name)
            elif not (checksum_holds(document) and document["point"] == index
                      and document["settings"] == wanted):  # fmt: skip
                others.append(path.name)
            else:
                found[index] = from_json(document)
        if others:
            more = f" and {len(others) - 1} more" if len(others) > 1 else ""
            LOG.warning(
                "%s%s: not a point of this sweep as it was written; evaluated anew",
                self.path / POINTS / others[0],
                more,
            )
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
        document = {"point": index, "settings": dict(settings)} | to_json(outcome)
        _write(path, with_checksum(document))


def kept_in(path: Path) -> list[Path]:
    """The files of the points that are kept in a sweep's folder, in their order."""
    return sorted(each for each in (path / POINTS).glob("*") if NAMED.fullmatch(each.name))


def _own_point(path: Path) -> dict[str, Any] | None:
    """What a point's file holds; ``None`` if no sweep wrote it so. Older ones have no checksum."""
    try:
        if path.is_symlink() or not path.is_file():
            return None
        document = json.loads(path.read_text(encoding="utf-8"))
        from_json(document)
        whole = checksum_holds(document, required=False)
        ours = whole and document["point"] >= 0 and document["settings"] is not None
        return document if ours else None
    except (OSError, KeyError, TypeError, ValueError, AttributeError, RecursionError):
        return None


def _set_aside(path: Path) -> None:
    names = (path.with_name(f"{path.name}.other-{n}") for n in itertools.count(1))
    path.rename(next(name for name in names if not os.path.lexists(name)))


def _read(path: Path) -> dict[str, Any]:
    try:
        with suppress(ValueError):
            document = json.loads(path.read_text(encoding="utf-8"))
            if isinstance(document, dict):
                return document
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from error
    raise UserError(f"{path}: it is damaged; delete it, or begin anew with --force")


def _write(path: Path, document: Mapping[str, Any]) -> None:
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    with replaced_when_complete(path) as partial:
        partial.write_text(text + "\n", encoding="utf-8")
