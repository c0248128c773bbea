"""All threads of this process on one core, for the time of a measurement."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

THREADS = Path("/proc/self/task")


@contextmanager
def one_core() -> Iterator[bool]:
    """Keep every thread of the process on one core while the context lasts.

    XLA and BLAS have started their threads long before, and a thread's core is its own affair:
    each is pinned by its id. Threads and processes started inside inherit the core.

    Yields:
        Whether that was done; false where the system cannot do it.
    """
    if not (hasattr(os, "sched_setaffinity") and THREADS.is_dir()):
        yield False
        return
    allowed = os.sched_getaffinity(0)
    before = {}
    for thread in _threads():
        with suppress(OSError):  # it has ended meanwhile
            before[thread] = os.sched_getaffinity(thread)
            os.sched_setaffinity(thread, {max(allowed)})
    try:
        yield True
    finally:
        for thread in _threads():
            with suppress(OSError):
                os.sched_setaffinity(thread, before.get(thread, allowed))


def _threads() -> list[int]:
    return [int(entry.name) for entry in THREADS.iterdir()]
