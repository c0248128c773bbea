"""Folders that take their place whole: written beside it, synced, exchanged in one step.

A staging folder stands beside the place: ``.partial-…`` with the folder itself in ``new`` and a
file ``lock``, which the process at work holds locked and in which the place is named. The system
lets go of the lock however that process ends, so what a killed one left behind is known, and
removed by the next. Its name holds a checksum of itself, as no other program's folder does.

Where the system can exchange two folders in one step (Linux, on most file systems), there is the
old folder or the new one under its name at every moment. Elsewhere the old one is moved into
``old`` and the new one into its place; where that is cut short in between, `recover` moves the old
one back.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import hashlib
import os
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PREFIX = ".partial-"
NEW, OLD, LOCK = "new", "old", "lock"

BEGUN = b"/replaced"
"""Follows the place's name, which has no such character, where replacing it has begun."""

ATTEMPTS = 16
"""A folder just made may be taken for one left behind before it is locked; then another is made."""

_UNSUPPORTED = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP}

Discard = Callable[[Path, Path], None]
"""Takes away a folder that another one has replaced; the second path is its former place."""


class BusyError(Exception):
    """Another process is about to publish a folder in the same place."""


class Staging:
    """A staging folder beside a place.

    Attributes:
        folder: to be written, and published.
    """

    def __init__(self, place: Path) -> None:
        """A new staging folder for a place; its lock is held until it is closed."""
        self._place = place
        self._path, self._lock = _locked(place)
        self.folder = self._path / NEW
        self.folder.mkdir()

    def publish(self) -> None:
        """Put the folder in its place, or in the place of the one that is there.

        Raises:
            OSError: it cannot be done; what was there is there again once this is closed.
        """
        place = self._place
        sync_tree(self.folder)
        if os.path.lexists(place):
            # From here on, ``new`` may be what is replaced.
            os.write(self._lock, BEGUN)
            os.fsync(self._lock)
            sync(self._path)
            try:
                _exchange(self.folder, place)
            except OSError:  # they cannot be exchanged here, or not be moved at all
                place.rename(self._path / OLD)
                self.folder.rename(place)
        else:
            self.folder.rename(place)
        sync(place.parent)

    def close(self, discard: Discard) -> None:
        """Remove it, with what was replaced; what cannot be removed is left to the next one."""
        try:
            with suppress(OSError):
                _clear(self._path, self._lock, discard)
        finally:
            os.close(self._lock)


@contextmanager
def staging_folder(place: Path, discard: Discard) -> Iterator[Staging]:
    """A staging folder for a place.

    Args:
        place: where the folder is to be published.
        discard: takes away folders that were replaced.

    Raises:
        OSError: it cannot be made.
    """
    staging = Staging(place)
    try:
        yield staging
    finally:
        staging.close(discard)


def recover(place: Path, discard: Discard) -> None:
    """Put back what killed processes moved away beside a place, and remove their staging folders.

    Those of other users are left to them: what is written there is not to be relied on.

    Raises:
        BusyError: another process is about to publish a folder in this place.
    """
    for path in sorted(place.parent.glob(f"{PREFIX}*")):
        with suppress(OSError):  # it cannot be removed, or another process has just done so
            found = path.lstat()
            own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid()
            if own and path.name == _name(path.name):
                _recover(path, place, discard)


def _recover(path: Path, place: Path, discard: Discard) -> None:
    try:
        lock = os.open(path / LOCK, os.O_RDWR | os.O_NOFOLLOW)
    except FileNotFoundError:
        path.rmdir()  # killed before it was locked
        return
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if _journal(path, lock)[0] == place:
                raise BusyError from None
            return
        _clear(path, lock, discard)
    finally:
        os.close(lock)


def _journal(path: Path, lock: int) -> tuple[Path, bool]:
    """The place for which a staging folder is, and whether replacing what is there has begun."""
    text = os.pread(lock, 4096, 0)
    return path.parent / os.fsdecode(text.removesuffix(BEGUN)), text.endswith(BEGUN)


def _locked(place: Path) -> tuple[Path, int]:
    """A new folder beside a place, and its lock file, open and locked."""
    for _ in range(ATTEMPTS):
        path = place.with_name(_name(PREFIX + secrets.token_hex(4)))
        path.mkdir(0o700)
        try:
            lock = os.open(path / LOCK, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        except FileNotFoundError:
            continue
        with suppress(OSError):  # not every file system has locks; nothing is cleared there
            fcntl.flock(lock, fcntl.LOCK_EX)
        if (path / LOCK).exists():
            os.write(lock, os.fsencode(place.name))
            return path, lock
        os.close(lock)
    raise OSError(errno.EBUSY, "folders beside it vanish as soon as they are made", str(place))


def _name(text: str) -> str:
    """The name of a staging folder that begins as a text does: 8 digits and their checksum."""
    begin = text[: len(PREFIX) + 8]
    return f"{begin}-{hashlib.sha256(f'designopt {begin}'.encode()).hexdigest()[:8]}"


def _clear(path: Path, lock: int, discard: Discard) -> None:
    """Remove a staging folder and all that is in it, but what is missing in its place."""
    place, begun = _journal(path, lock)
    if (path / OLD).exists() and not os.path.lexists(place):
        (path / OLD).rename(place)
        sync(place.parent)
    for part in (path / OLD, path / NEW):
        if not begun:
            shutil.rmtree(part, ignore_errors=True)
        elif part.exists():
            discard(part, place)
    (path / LOCK).unlink(missing_ok=True)
    path.rmdir()


def _exchange(one: Path, other: Path) -> None:
    """Let two folders have each other's name, in one step.

    Raises:
        OSError: they cannot, or the system or the file system lacks it.
    """
    try:
        renameat2 = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError) as error:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS)) from error
    here, exchange = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of Linux
    if renameat2(here, os.fsencode(one), here, os.fsencode(other), exchange) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), str(other))


def sync(path: Path) -> None:
    """Have the system write a file or a folder's entries to the disk.

    Raises:
        OSError: it cannot; where a file system lacks that, as some do for folders, nothing is done.
    """
    place = os.open(path, os.O_RDONLY)
    try:
        os.fsync(place)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise
    finally:
        os.close(place)


def sync_tree(folder: Path) -> None:
    """The same of all that is in a folder, and of the folder itself."""
    for place, _, names in os.walk(folder, topdown=False):
        for name in names:
            sync(Path(place, name))
        sync(Path(place))
