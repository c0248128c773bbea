"""Programs that XLA has compiled, kept between commands in a folder of the user's.

JAX keeps programs between processes, too. But of files that were swapped it runs the wrong program,
one that was cut short it can neither use nor replace, and its bound on the size needs a lock, at
which processes wait for each other. So a store takes the place of its files. JAX still makes the
keys, of the program, jaxlib's version, XLA's flags and the processor's instructions.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import re
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated

import typer

from designopt.user_folders import user_folder

LOG = logging.getLogger(__name__)

VARIABLE = "DESIGNOPT_CACHE"
"""Of the environment: a folder to keep programs in, or `OFF`."""
OFF = "off"
LIMIT = 256 * 2**20
"""Bytes of a folder, beyond which the programs that were not used for longest go."""
PROGRAM, PARTIAL = ".xla-program", ".xla-partial"
NAMED = re.compile(rf"[0-9a-f]{{64}}{PROGRAM}|tmp\w{{8}}{PARTIAL}")
"""Names of a store's files; any other in its folder is somebody else's."""
MAPPINGS, MOST_MAPPINGS = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
"""Of this process, one a line, and how many it may have."""
FULL = 0.4
"""Part of the mappings from which on programs are forgotten: a finger's design takes 30,000 of
Linux' usual 65,530."""
ABANDONED = 3600.0
"""Seconds after which a file that is still being written belongs to no process any more."""
COMPILED = "/jax/core/compile/backend_compile_duration"
"""JAX's event of a program that XLA has compiled, or that was read from where it is kept."""
HIT = "/jax/compilation_cache/cache_hits"
"""JAX's event of a program that was read."""
_ANEW: ContextVar[bool] = ContextVar("anew", default=False)
STORES: list[Store] = []
"""Where values are kept, if anywhere."""
_FORGETTING: list[Callable[[], object]] = []
"""What lets go of programs that JAX does not keep itself; see `forget_with_programs`."""


def _switch_off(wanted: bool) -> bool:
    if wanted:
        os.environ[VARIABLE] = OFF  # for the processes of a sweep, too
    return wanted


NoCache = Annotated[
    bool,
    typer.Option("--no-cache", help="Keep and use no compiled programs.", callback=_switch_off),
]
"""An option of commands that compile; they call `keep_programs` before anything is compiled."""


def keep_values() -> None:
    """Let `kept.kept_value` keep values from now on, unless the user has it otherwise."""
    folder = program_folder()
    if not STORES and folder is not None and is_usable(folder):
        STORES.append(Store(folder))


def current_store() -> Store | None:
    """Where values are kept; ``None`` if no command has asked for it, or the user has it off."""
    return STORES[0] if STORES else None


def keep_programs() -> None:
    """Load JAX, and let it keep what is compiled from now on, unless the user has it otherwise.

    Values are kept, too.

    A folder that cannot be used is passed over, with a warning where the user named it. What is
    compiled is logged at level DEBUG.
    """
    if LOG.isEnabledFor(logging.DEBUG):
        _log_compiling()
    keep_values()
    folder = program_folder()
    if folder is None:
        return
    import jax
    from jax._src import compilation_cache

    # Without this function, whose place ours takes, JAX would keep files as it sees fit.
    if getattr(jax.config, "jax_compilation_cache_dir", None) is not None or not hasattr(
        compilation_cache, "get_file_cache"
    ):
        return
    if folder_fault(folder):
        return
    compilation_cache.get_file_cache = lambda path: (_StoreOfJax(Path(path)), path)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    LOG.info("compiled programs are kept in %s", folder)
    # Hundreds of programs take less than JAX's second each, and together most of the time.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache entry")


@functools.cache  # JAX takes no listener back
def _log_compiling() -> None:
    """Log every program that is compiled, or read where it is kept, from now on."""
    from jax import monitoring

    def listen(event: str, duration_secs: float, **about: object) -> None:
        if event == COMPILED:
            LOG.debug("compiled %s: %.2f s", about.get("fun_name", "a program"), duration_secs)

    monitoring.register_event_duration_secs_listener(listen)


def forget_programs_if_many() -> None:
    """Let JAX forget what it has compiled, where that fills much of what a process may map.

    Each program maps memory several times. Beyond Linux' bound on mappings nothing can be compiled
    any more, and the process ends with "Cannot allocate memory". Between tasks that compile
    programs of their own this leaves most of the bound to the next one. What is forgotten is
    traced again, and loaded where programs are kept.
    """
    try:
        bound = int(MOST_MAPPINGS.read_text())
        with MAPPINGS.open("rb") as lines:  # names of files may be of any bytes
            count = sum(1 for _ in lines)
    except OSError:
        return  # another system, which has no such bound
    if count > FULL * bound:
        import jax

        for forget in _FORGETTING:
            forget()
        jax.clear_caches()


def forget_with_programs(forget: Callable[[], object]) -> None:
    """Have a function called wherever `forget_programs_if_many` forgets.

    Args:
        forget: lets go of programs that were compiled ahead, which are JAX's no more.
    """
    _FORGETTING.append(forget)


def program_folder() -> Path | None:
    """Where compiled programs are kept; ``None`` if that is switched off, or without a home."""
    named = os.environ.get(VARIABLE)
    if named:
        return None if named == OFF else Path(named).absolute()
    usual = "Library/Caches" if sys.platform == "darwin" else ".cache"
    with suppress(RuntimeError):
        return user_folder("XDG_CACHE_HOME", usual) / "programs"
    return None


def is_usable(folder: Path) -> bool:
    """Whether programs can be kept in a folder; a warning if not, where the user named it."""
    reason = folder_fault(folder)
    if reason and (named := os.environ.get(VARIABLE)):
        LOG.warning("%s=%s: not used: %s", VARIABLE, named, reason)
    return not reason


def folder_fault(folder: Path) -> str:
    """What is wrong with a folder, which is made where there is none; empty if nothing is."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
    except OSError as error:
        return error.strerror or str(error)
    # Whoever writes into it has their code run by whoever reads.
    if found.st_uid != os.geteuid() or found.st_mode & 0o022:
        return "others can write into it"
    return ""


class Store:
    """Values by their keys, as files of a folder.

    Every file begins with the SHA-256 of its name and its value: what was cut short, altered or
    swapped is no value, and is removed. Files appear whole, so that no process waits for another.
    Nothing raises: what cannot be read is not there, and after something could not be written
    nothing more is.
    """

    def __init__(self, folder: Path, limit: int = LIMIT) -> None:
        """A store in a folder that is there.

        Args:
            folder: it.
            limit: bytes of all files, which one process may exceed by a sixteenth.
        """
        self._path = folder  # so JAX names it
        self._limit = limit
        self._to_write = 0
        """Bytes until the folder is measured again."""

    def get(self, key: str) -> bytes | None:
        """The value of a key."""
        path = self._file(key)
        try:
            content = path.read_bytes()
        except OSError:
            return None
        value = content[hashlib.sha256().digest_size :]
        whole = content == _sealed(path.name, value)
        with suppress(OSError):  # as where the folder can only be read
            if whole:
                os.utime(path)  # used just now
            else:
                path.unlink()
        return value if whole else None

    def put(self, key: str, value: bytes) -> None:
        """Keep the value of a key."""
        path = self._file(key)
        if self._limit <= len(value):
            return
        try:
            if self._to_write < len(value):
                self._remove_oldest()
            self._to_write -= len(value)
            handle, partial = tempfile.mkstemp(PARTIAL, dir=self._path)
            try:
                with open(handle, "wb") as file:
                    file.write(_sealed(path.name, value))
                os.replace(partial, path)
            except BaseException:
                with suppress(OSError):  # it has its name already
                    os.unlink(partial)
                raise
        except OSError:
            self._limit = 0

    def _file(self, key: str) -> Path:
        # XLA divides loops among the threads it finds when it compiles, and rounds accordingly.
        name = hashlib.sha256(f"{_threads()} {key}".encode()).hexdigest()
        return self._path / f"{name}{PROGRAM}"

    def _remove_oldest(self) -> None:
        """Make room for a sixteenth of the limit."""
        self._to_write = self._limit // 16
        now, files = time.time(), []
        for entry in os.scandir(self._path):
            if not NAMED.fullmatch(entry.name):
                continue
            with suppress(OSError):  # another process has removed it
                found = entry.stat()
                age = now - found.st_mtime
                if entry.name.endswith(PROGRAM):
                    files.append((age, found.st_size, entry.path))
                elif age > ABANDONED:
                    os.unlink(entry.path)
        room = self._limit - self._to_write - sum(size for _, size, _ in files)
        for _, size, path in sorted(files, reverse=True):
            if room >= 0:
                break
            room += size
            with suppress(OSError):
                os.unlink(path)


class _StoreOfJax(Store):
    """What JAX keeps, as it has it."""

    def get(self, key: str) -> bytes | None:
        """As that of a store; nothing of what is compiled anew."""
        return None if _ANEW.get() else super().get(key)

    def put(self, key: str, value: bytes) -> None:
        """As that of a store."""
        if not _ANEW.get():
            super().put(key, value)


@contextmanager
def compiling_anew() -> Iterator[Callable[[], bool]]:
    """Within it, and in its thread, what is kept of single programs is not used.

    XLA cannot write again what it has read: such a program fails when it is run.

    Returns:
        A function that returns whether all has been compiled: JAX may have a folder of its own.
    """
    from jax import monitoring

    hits: list[str] = []
    own = threading.get_ident()

    def listen(event: str, **_: object) -> None:
        if event == HIT and threading.get_ident() == own:
            hits.append(event)

    monitoring.register_event_listener(listen)
    token = _ANEW.set(True)
    try:
        yield lambda: not hits
    finally:
        _ANEW.reset(token)
        monitoring.unregister_event_listener(listen)


def _sealed(name: str, value: bytes) -> bytes:
    return hashlib.sha256(name.encode() + value).digest() + value


def _threads() -> str:
    """What XLA takes the number of its threads from."""
    cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else ()
    return f"{os.environ.get('NPROC')} {len(cores)} {os.cpu_count()}"
