"""Interrupts that cannot get lost, and a polite end on SIGTERM."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

AGAIN = 0.05
"""Seconds until an interrupt that was swallowed is raised again."""

_has_come = threading.Event()
"""An interrupt has come to this process."""


def leave(code: int) -> NoReturn:
    """End the process with an exit code.

    An interrupt ends the wait for a program that XLA compiles in another thread, and not the
    compiling, which crashes when Python is taken down around it: then the process ends at once.
    """
    if _has_come.is_set():
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)
    sys.exit(code)


@contextmanager
def interruptible() -> Iterator[Callable[[], None]]:
    """Ctrl-C and SIGTERM raise `KeyboardInterrupt`; the function yielded raises it once more.

    An exception raised while a destructor, a callback (JAX has one for garbage collection) or a
    compiled module's first lines run is swallowed by Python, or comes out as another one. It is
    raised again soon after; and whoever publishes a result, or reports an exception, calls that
    function first. A signal that the process was started to ignore (as a shell's background jobs
    ignore Ctrl-C) stays ignored. Outside the main thread, where Python allows no signal handlers,
    nothing changes.
    """
    interrupted = threading.Event()
    again = threading.Timer(AGAIN, _interrupt_main_thread)

    def handle(number: int, frame: FrameType | None) -> None:
        interrupted.set()
        outer = handlers.get(number)
        if callable(outer):
            outer(number, frame)
        raise KeyboardInterrupt

    def check() -> None:
        if interrupted.is_set():
            raise KeyboardInterrupt

    def raise_again(unraisable: sys.UnraisableHookArgs) -> None:
        nonlocal again
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            previous(unraisable)
            return
        again = threading.Timer(AGAIN, _interrupt_main_thread)
        again.daemon = True
        again.start()

    with _handled_by(handle) as handlers:
        previous, sys.unraisablehook = sys.unraisablehook, raise_again
        try:
            yield check
        finally:
            sys.unraisablehook = previous
            again.cancel()


@contextmanager
def deferred() -> Iterator[Callable[[], bool]]:
    """Ctrl-C and SIGTERM raise nothing; the function yielded returns whether one has come.

    For code that an exception at any place would break: compiled modules while they are loaded, and
    event loops that print what their callbacks raise and go on.
    """
    interrupted = threading.Event()
    with _handled_by(lambda *_: interrupted.set()):
        yield interrupted.is_set


def _interrupt_main_thread() -> None:
    # A signal also ends what that thread waits for, which Python's own `interrupt_main` does not.
    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


@contextmanager
def _handled_by(action: Callable[[int, FrameType | None], None]) -> Iterator[dict[int, Any]]:
    """Let signals do something else; yields what handled them before, by their number."""

    def handle(number: int, frame: FrameType | None) -> None:
        _has_come.set()
        action(number, frame)

    previous: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        previous = {n: handler for n, handler in handlers.items() if handler != signal.SIG_IGN}
    try:
        for number in previous:
            signal.signal(number, handle)
        yield previous
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
