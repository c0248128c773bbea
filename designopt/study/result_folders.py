"""Result folders: complete or absent, and replaced without the loss of anybody's file.

``results.json`` lists every other file of a result with its size and SHA-256 (``"manifest"``), and
ends with a checksum of itself. What is not listed, or is no longer as listed, is somebody's own.
"""

from __future__ import annotations

import errno
import itertools
import json
import logging
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from designopt.errors import UserError
from designopt.io.checksums import checksum_holds, file_checksum, with_checksum
from designopt.io.files import check_new_folder
from designopt.io.staging import BusyError, recover, staging_folder

LOG = logging.getLogger(__name__)

DOCUMENT = "results.json"
MANIFEST = "manifest"

FOLDERS = ("tables", "figures", "specs")
"""Folders of a result, some of them empty. Entries of ``results.json`` so called name their files,
which is all that older versions list."""


NO_RESULT = "it does not hold an earlier result, and nothing else is replaced; name another folder"


class ForeignFileError(Exception):
    """A folder holds something that no run wrote; the text names it, with the cure."""

    @classmethod
    def other(cls, path: Path) -> ForeignFileError:
        """For a file or folder that an earlier result does not list."""
        return cls(
            f"{path} is not of the earlier result, which is therefore not replaced; move it away, "
            "or name another folder"
        )

    @classmethod
    def altered(cls, path: Path | str) -> ForeignFileError:
        """For a file of an earlier result that is no longer as it was written."""
        return cls(
            f"{path} was changed since the earlier result was written, which is therefore not "
            "replaced; move it away, or name another folder"
        )


class Listed(NamedTuple):
    """A file of a result, as it was written; of older versions only its path is known."""

    bytes: int | None
    sha256: str | None


def write_document(folder: Path, document: Mapping[str, Any]) -> None:
    """Write ``results.json``, with the manifest of all that is in the folder, and a checksum.

    Raises:
        OSError: it cannot be written.
        ValueError: a number in it is not finite.
    """
    manifest = [
        {"path": path.as_posix(), "bytes": (folder / path).stat().st_size,
         "sha256": file_checksum(folder / path)}
        for path in sorted(_files(folder))
    ]  # fmt: skip
    sealed = with_checksum({**document, MANIFEST: manifest})
    text = json.dumps(sealed, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / DOCUMENT).write_text(text + "\n", encoding="utf-8")


def recorded_spec(document: Path) -> tuple[str, dict[str, Any]]:
    """The name of the study that a ``results.json`` is of, and its settings as run.

    Raises:
        UserError: it cannot be read, or no run wrote it.
    """
    try:
        result = json.loads(document.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"{document}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError):
        result = None
    match result:
        case {"study": str(study), "spec": dict(spec)}:
            return study, spec
    raise UserError(f"{document}: no result of designopt run; name its results.json")


@contextmanager
def result_folder(out: Path, *, force: bool) -> Iterator[Path]:
    """A new folder to write into, which becomes ``out`` on leaving and vanishes on an exception.

    It is written to the disk before it takes its place in one step, so that a process killed at any
    moment leaves the earlier result, or the new one, or neither where there was none before; see
    `designopt.io.staging` for file systems without such a step.

    Args:
        out: the folder to make; folders above it are made as needed.
        force: replace an earlier result at ``out``, at the very end. Files that this one lists are
            removed, and where there is any other or altered one, nothing is.

    Raises:
        UserError: ``out`` exists and must not be replaced, or cannot be written.
    """
    with ExitStack() as stack:
        try:
            place = out.resolve()  # the folder itself, where ``out`` is a link to it
            recover_result(out)
            _refuse_existing(out, place, force=force)
            made = [parent for parent in place.parents if not parent.exists()]
            stack.callback(_remove_empty, made)
            place.parent.mkdir(parents=True, exist_ok=True)
            staging = stack.enter_context(staging_folder(place, _discard))
        except (OSError, RuntimeError) as error:  # a loop of links is a RuntimeError
            raise cannot_write(out, error) from error
        yield staging.folder
        try:
            if os.path.lexists(place):
                if not force:
                    meanwhile = "made by somebody else meanwhile"
                    raise FileExistsError(errno.EEXIST, meanwhile, str(place))
                check_replaceable(out)
            staging.publish()
        except OSError as error:
            raise cannot_write(out, error) from error


def _remove_empty(folders: Iterable[Path]) -> None:
    for folder in folders:
        with suppress(OSError):  # not empty: the result is in it, or somebody else's file
            folder.rmdir()


def cannot_write(out: Path, error: Exception) -> UserError:
    """The one line for a folder that cannot be written."""
    reason = str(error)
    if isinstance(error, OSError):
        reason = f"{error.strerror}: {error.filename}" if error.filename else str(error.strerror)
    return UserError(f"--out {out}: cannot be written ({reason}); name a folder that can")


def check_replaceable(out: Path) -> None:
    """Refuse to replace a result in which there is a file that it did not write.

    Raises:
        UserError: the folder holds no result, or more than one; the first such file is named.
    """
    try:
        own_files(out.resolve())
    except ForeignFileError as error:
        raise UserError(f"--out {out}: {error}") from error


def own_files(folder: Path) -> dict[Path, Listed]:
    """The files of a result that are there, as its run wrote them.

    Args:
        folder: of the result.

    Returns:
        Their paths from the folder, ``results.json`` the last.

    Raises:
        ForeignFileError: there is another file, or an altered one, or no result.
    """
    listed = _listed(folder)
    folders = _folders(listed)
    there = set()
    for path, entry in _entries(folder):
        is_folder = entry.is_dir(follow_symlinks=False)
        if path not in (folders if is_folder else listed):
            raise ForeignFileError.other(path)
        if is_folder:
            continue
        if not _unchanged(folder / path, listed[path]):
            raise ForeignFileError.altered(path)
        there.add(path)
    return {path: listed[path] for path in listed if path in there}


def _refuse_existing(out: Path, place: Path, *, force: bool) -> None:
    if not (place.exists() or out.is_symlink()):
        return
    check_new_folder(out, force=force)
    check_replaceable(out)


def _listed(folder: Path) -> dict[Path, Listed]:
    """What ``results.json`` lists, itself the last."""
    try:
        document = json.loads((folder / DOCUMENT).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ForeignFileError(NO_RESULT) from error
    older = {"study", "spec", "metrics"}
    if not (isinstance(document, dict) and (MANIFEST in document or older <= set(document))):
        raise ForeignFileError(NO_RESULT)
    try:
        if MANIFEST not in document:
            named = [Path(name) for key in FOLDERS for name in document.get(key, ())]
            listed = dict.fromkeys([*named, Path("report.html")], Listed(None, None))
        elif checksum_holds(document):
            listed = {
                Path(each["path"]): Listed(each["bytes"], each["sha256"])
                for each in document[MANIFEST]
            }
        else:
            raise ForeignFileError.altered(DOCUMENT)
    except (KeyError, TypeError) as error:
        raise ForeignFileError.altered(DOCUMENT) from error
    return listed | {Path(DOCUMENT): Listed(None, None)}


def _unchanged(path: Path, listed: Listed) -> bool:
    """Whether a file is the one that was written; a link in its place is not."""
    found = path.lstat()
    if not stat.S_ISREG(found.st_mode):
        return False
    if listed.sha256 is None:
        return True
    return found.st_size == listed.bytes and file_checksum(path) == listed.sha256


def _entries(folder: Path, below: Path = Path()) -> Iterator[tuple[Path, os.DirEntry[str]]]:
    """All that is in a folder, with its path from there; links are not followed."""
    with os.scandir(folder / below) as entries:
        for entry in sorted(entries, key=lambda entry: entry.name):
            path = below / entry.name
            yield path, entry
            if entry.is_dir(follow_symlinks=False):
                yield from _entries(folder, path)


def _files(folder: Path) -> list[Path]:
    return [path for path, entry in _entries(folder) if not entry.is_dir(follow_symlinks=False)]


def remove_result(folder: Path) -> None:
    """Remove a result, file by file as it lists them, and then the folders that are empty.

    Raises:
        ForeignFileError: there is another file, or an altered one; nothing is removed.
        OSError: something cannot be removed.
    """
    own = own_files(folder)
    for path in own.keys() - {Path(DOCUMENT)}:
        (folder / path).unlink()
    for below in sorted(_folders(own) - {Path()}, reverse=True):
        if (folder / below).exists():
            (folder / below).rmdir()
    # The list is needed to go on where a kill has cut this short.
    (folder / DOCUMENT).unlink()
    folder.rmdir()


def _folders(files: Iterable[Path]) -> set[Path]:
    """The folders of a result, from its own on."""
    return {parent for path in files for parent in path.parents} | set(map(Path, FOLDERS))


def recover_result(out: Path) -> None:
    """Finish what killed processes began to publish at ``out`` or beside it.

    Raises:
        UserError: another process is writing a result for the same place.
    """
    try:
        recover(out.resolve(), _discard)
    except BusyError as error:
        raise UserError(
            f"--out {out}: another run is writing its result there; wait for it, or name another "
            "folder"
        ) from error


def _discard(folder: Path, place: Path) -> None:
    """Remove a result that was replaced; set it aside where it cannot be removed whole."""
    with suppress(ForeignFileError, OSError):
        if any(folder.iterdir()):
            remove_result(folder)
        else:
            folder.rmdir()
    if folder.exists():
        names = (place.with_name(f"{place.name}-replaced-{n}") for n in itertools.count(1))
        aside = next(name for name in names if not os.path.lexists(name))
        folder.rename(aside)
        LOG.warning(
            "%s: the earlier result could not be removed (a file was put there meanwhile, or its "
            "permissions do not allow it); what is left of it is in %s",
            place,
            aside,
        )
