"""Interrupts that cannot get lost, and a polite end on SIGTERM."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interruptible() -> Iterator[Callable[[], None]]:
    """Ctrl-C and SIGTERM raise `KeyboardInterrupt`; the function yielded raises it once more.

    An exception raised while a destructor, a callback or a compiled module's first lines run is
    swallowed by Python, or comes out as another one: whoever publishes a result, or reports an
    exception, calls that function first. A signal that the process was started to ignore (as a
    shell's background jobs ignore Ctrl-C) stays ignored. Outside the main thread, where Python
    allows no signal handlers, nothing changes.
    """
    interrupted = threading.Event()

    def handle(number: int, frame: FrameType | None) -> None:
        interrupted.set()
        outer = previous.get(signal.Signals(number))
        if callable(outer):
            outer(number, frame)
        raise KeyboardInterrupt

    def check() -> None:
        if interrupted.is_set():
            raise KeyboardInterrupt

    previous = {}
    if threading.current_thread() is threading.main_thread():
        handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        previous = {n: handler for n, handler in handlers.items() if handler != signal.SIG_IGN}
    try:
        for number in previous:
            signal.signal(number, handle)
        yield check
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
