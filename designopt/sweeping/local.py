"""Workers that are processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for
from multiprocessing.process import BaseProcess

from designopt.sweeping.evaluating import ONE_THREAD, Task, evaluate
from designopt.sweeping.outcomes import Outcome

MOST_LOSSES = 3
"""A task that has lost its worker so often is given up."""


def run_locally(tasks: Sequence[Task], count: int) -> Generator[tuple[int, list[Outcome] | None]]:
    """Every task's index with what became of its points, as they finish.

    Closing the iterator ends the workers at once.

    Args:
        tasks: what is to be done.
        count: processes.

    Yields:
        ``None`` in place of outcomes for a task that has lost its worker `MOST_LOSSES` times.
    """
    waiting, losses = deque(enumerate(tasks)), Counter[int]()
    idle = [_Worker() for _ in range(min(count, len(tasks)))]
    running: dict[Future[list[Outcome]], tuple[_Worker, int, Task]] = {}
    finished: list[tuple[int, list[Outcome] | None]] = []
    try:
        while waiting or running:
            while idle and waiting:
                worker = idle.pop()
                index, task = waiting.popleft()
                running[worker.submit(task)] = worker, index, task
            yield from finished  # whoever keeps them does so while the workers go on
            finished.clear()
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                worker, index, task = running.pop(future)
                idle.append(worker)
                try:
                    finished.append((index, future.result()))
                except BrokenProcessPool:
                    losses[index] += 1
                    worker.end()
                    if losses[index] < MOST_LOSSES:
                        waiting.appendleft((index, task))
                    else:
                        finished.append((index, None))
        yield from finished
    finally:
        for worker in [*idle, *(worker for worker, _, _ in running.values())]:
            worker.end()


class _Worker:
    """One process, started when it is first needed: a pool of one, so that a loss has one task."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._process: BaseProcess | None = None

    def submit(self, task: Task) -> Future[list[Outcome]]:
        if self._pool is not None:
            try:
                return self._pool.submit(evaluate, task)
            except BrokenProcessPool:  # it was lost while it had nothing to do
                self.end()
        before = set(multiprocessing.active_children())
        self._pool = ProcessPoolExecutor(
            1, multiprocessing.get_context("spawn"), _begin, (os.environ | ONE_THREAD,)
        )
        # A blocked signal stays blocked in the process that is started, and is kept for this one:
        # Ctrl-C, which a terminal sends to both, ends a worker by `end` alone.
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            future = self._pool.submit(evaluate, task)
            (self._process,) = set(multiprocessing.active_children()) - before
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
        return future

    def end(self) -> None:
        """End the process at once."""
        if self._process is not None:
            self._process.kill()
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
        self._pool = self._process = None


def _begin(environment: dict[str, str]) -> None:
    """Prepare a worker, which has loaded nothing yet that reads its environment."""
    os.environ.update(environment)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait_for([parent.sentinel])
    os._exit(1)
