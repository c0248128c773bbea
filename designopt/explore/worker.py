"""A thread that computes while the server goes on answering."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from contextlib import suppress
from typing import Any

Job = Callable[[], Any]
Done = Callable[[Future], None]
_Jobs = dict[Hashable, tuple[Job, Done]]


class Worker:
    """A thread that computes one job after another, with JAX in float64.

    A job takes the place of one that still waits under the same name. One without a name is
    computed in any case.
    """

    def __init__(self) -> None:
        self._jobs: _Jobs = {}
        self._changed, self._now = threading.Condition(), None
        self._ended = False
        self._loop = asyncio.get_running_loop()
        # A daemon: an interrupt must not wait for what XLA compiles.
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def submit(self, name: str | None, job: Job, done: Done, *, first: bool = False) -> None:
        """Compute a job; its result, or what it raised, goes to ``done`` in the event loop.

        It is computed after those that wait, or before them if it is to be ``first``.
        """
        with self._changed:
            self._jobs.pop(name, None)
            new: _Jobs = {object() if name is None else name: (job, done)}
            self._jobs = new | self._jobs if first else self._jobs | new
            self._changed.notify()

    def end(self) -> None:
        """Begin no further job that has a name."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    @property
    def owes(self) -> bool:
        """Whether a job without a name is under way or waits."""
        with self._changed:
            return any(not isinstance(one, str | None) for one in (self._now, *self._jobs))

    def join(self) -> None:
        """Wait for the last job."""
        self._thread.join()

    def _run(self) -> None:
        import jax

        with jax.enable_x64(True):  # which holds for one thread
            while (found := self._next()) is not None:
                job, done = found
                future: Future[Any] = Future()
                try:
                    future.set_result(job())
                except Exception as error:
                    future.set_exception(error)
                with suppress(RuntimeError):  # the loop may have ended meanwhile
                    self._loop.call_soon_threadsafe(done, future)

    def _next(self) -> tuple[Job, Done] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._jobs or self._ended)
            waiting = [one for one in self._jobs if not (self._ended and isinstance(one, str))]
            self._now = waiting[0] if waiting else None
            return self._jobs.pop(waiting[0]) if waiting else None
