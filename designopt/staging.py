"""Folders that take their place whole: written beside it, synced, exchanged in one step.

A staging folder stands beside the place: ``.partial-…`` with the folder itself in ``new`` and a
file ``lock``, which the process at work holds locked. The system lets go of the lock however that
process ends, so what a killed one left behind is known, and removed by the next.

Where the system can exchange two folders in one step (Linux, on most file systems), there is the
old folder or the new one under its name at every moment. Elsewhere the old one is moved away and
the new one moved in; killed in between, there is none until the next `staging_folder` beside it,
which reads in ``lock`` what was to be done, and does it.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PREFIX = ".partial-"
_OURS = re.compile(r"\.partial-[a-z0-9_]{8}")

NEW, OLD, LOCK = "new", "old", "lock"

ATTEMPTS = 16
"""A folder just made may be taken for one left behind before it is locked; then another is made."""

_WITHOUT_EXCHANGE = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP}

Discard = Callable[[Path, Path], None]
"""Takes away a folder that another one has replaced; the second path is its former place."""


class Staging:
    """A staging folder beside a place.

    Attributes:
        folder: to be written, and published.
    """

    def __init__(self, path: Path, lock: int) -> None:
        """A staging folder at ``path``, whose lock file is open as ``lock``."""
        self._path, self._lock = path, lock
        self.folder = path / NEW
        self.folder.mkdir()

    def publish(self, place: Path) -> None:
        """Put the folder in its place, or in the place of the one that is there.

        Raises:
            OSError: it cannot be done; what was there is still there.
        """
        sync_tree(self.folder)
        if os.path.lexists(place):
            # From here on, ``new`` may be what is replaced.
            os.write(self._lock, os.fsencode(place.name))
            os.fsync(self._lock)
            sync(self._path)
            try:
                _exchange(self.folder, place)
            except OSError as error:
                if error.errno not in _WITHOUT_EXCHANGE:
                    raise
                self._rename_twice(place)
        else:
            self.folder.rename(place)
        sync(place.parent)

    def _rename_twice(self, place: Path) -> None:
        old = self._path / OLD
        place.rename(old)
        try:
            self.folder.rename(place)
        except BaseException:
            old.rename(place)
            raise

    def close(self, discard: Discard) -> None:
        """Remove it, with what was replaced; what cannot be removed is left to the next one."""
        try:
            with suppress(OSError):
                _clear(self._path, self._lock, discard)
        finally:
            os.close(self._lock)


@contextmanager
def staging_folder(parent: Path, discard: Discard) -> Iterator[Staging]:
    """A staging folder in ``parent``, after those that killed processes left there are cleared.

    Args:
        parent: the folder in which the place is.
        discard: takes away folders that were replaced.

    Raises:
        OSError: it cannot be made.
    """
    recover(parent, discard)
    staging = Staging(*_locked(parent))
    try:
        yield staging
    finally:
        staging.close(discard)


def recover(parent: Path, discard: Discard) -> None:
    """Finish what killed processes began in staging folders, and remove these."""
    for path in sorted(parent.glob(f"{PREFIX}*")):
        if _OURS.fullmatch(path.name) and path.is_dir() and not path.is_symlink():
            with suppress(OSError):  # another process is at work there, or it is somebody else's
                _recover(path, discard)


def _recover(path: Path, discard: Discard) -> None:
    try:
        lock = os.open(path / LOCK, os.O_RDWR | os.O_NOFOLLOW)
    except FileNotFoundError:
        path.rmdir()  # killed before it was locked; anything else is not empty, and stays
        return
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        place = _replaced(path, lock)
        if place is not None and not os.path.lexists(place) and (path / OLD).exists():
            (path / NEW).rename(place)
            sync(path.parent)
        _clear(path, lock, discard)
    finally:
        os.close(lock)


def _replaced(path: Path, lock: int) -> Path | None:
    """The place in which a folder was to be replaced, if that was begun."""
    name = os.fsdecode(os.pread(lock, 4096, 0))
    return path.parent / name if name else None


def _locked(parent: Path) -> tuple[Path, int]:
    """A new folder in ``parent``, and its lock file, open and locked."""
    for _ in range(ATTEMPTS):
        path = Path(tempfile.mkdtemp(prefix=PREFIX, dir=parent))
        try:
            lock = os.open(path / LOCK, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        except FileNotFoundError:
            continue
        with suppress(OSError):  # not every file system has locks; nothing is cleared there
            fcntl.flock(lock, fcntl.LOCK_EX)
        if (path / LOCK).exists():
            return path, lock
        os.close(lock)
    raise OSError(errno.EBUSY, "folders beside it vanish as soon as they are made", str(parent))


def _clear(path: Path, lock: int, discard: Discard) -> None:
    """Remove a staging folder and all that is in it."""
    place = _replaced(path, lock)
    for part in (path / OLD, path / NEW):
        if place is None:
            shutil.rmtree(part, ignore_errors=True)
        elif part.exists():
            discard(part, place)
    (path / LOCK).unlink(missing_ok=True)
    path.rmdir()


def _exchange(one: Path, other: Path) -> None:
    """Let two folders have each other's name, in one step.

    Raises:
        OSError: they cannot; ``ENOSYS`` or ``EINVAL`` where systems or file systems lack it.
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
        OSError: it cannot.
    """
    place = os.open(path, os.O_RDONLY)
    try:
        os.fsync(place)
    finally:
        os.close(place)


def sync_tree(folder: Path) -> None:
    """The same of all that is in a folder, and of the folder itself."""
    for place, _, names in os.walk(folder, topdown=False):
        for name in names:
            sync(Path(place, name))
        sync(Path(place))
