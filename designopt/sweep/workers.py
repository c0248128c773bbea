"""Workers that are processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from designopt.compilation_cache import keep_programs
from designopt.errors import UserError
from designopt.sweep.evaluating import ONE_THREAD, Task, evaluate
from designopt.sweep.outcomes import Outcome

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

    Raises:
        UserError: a process cannot be started, or does not find the study.
    """
    waiting, losses = deque(range(len(tasks))), Counter[int]()
    workers = [_Worker() for _ in range(min(count, len(tasks)))]
    idle, running = list(workers), dict[Connection, tuple[_Worker, int]]()
    finished: list[tuple[int, list[Outcome] | None]] = []
    try:
        while waiting or running:
            while idle and waiting:
                worker, index = idle.pop(), waiting.popleft()
                running[worker.give(tasks[index])] = worker, index
            yield from finished  # whoever keeps them does so while the workers go on
            finished.clear()
            ready = wait(list(running))
            for pipe in [one for one in running if one in ready]:
                worker, index = running.pop(pipe)
                idle.append(worker)
                answer = worker.answer()
                if answer is None:
                    losses[index] += 1
                    if losses[index] < MOST_LOSSES:
                        waiting.appendleft(index)
                        continue
                finished.append((index, answer))
        yield from finished
    finally:
        for worker in workers:
            worker.kill()
        for worker in workers:
            worker.end()


class _Worker:
    """One process, started when it is first needed, and again when it was lost."""

    def __init__(self) -> None:
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None

    def give(self, task: Task) -> Connection:
        """Hand it a task; what is returned is ready as soon as there is an `answer`."""
        if self._pipe is not None:
            try:
                self._pipe.send(task)
                return self._pipe
            except OSError:  # it was lost while it had nothing to do
                self.end()
        pipe = self._start()
        with suppress(OSError):  # lost already: its answer will be that there is none
            pipe.send(task)
        return pipe

    def answer(self) -> list[Outcome] | None:
        """What became of the task; ``None`` if the worker was lost."""
        assert self._pipe is not None
        try:
            found = self._pipe.recv()
        except (EOFError, OSError):
            self.end()
            return None
        if isinstance(found, UserError):
            raise found
        return found

    def kill(self) -> None:
        """End the process at once, without waiting until it is gone."""
        if self._process is not None and self._process.pid is not None:
            self._process.kill()

    def end(self) -> None:
        """End the process at once."""
        self.kill()
        if self._process is not None and self._process.pid is not None:
            self._process.join()
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None

    def _start(self) -> Connection:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs, os.environ | ONE_THREAD))
        self._process = process
        # A blocked signal stays blocked in the process that is started: Ctrl-C, which a terminal
        # sends to both, ends a worker by `end` alone.
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            process.start()
        except OSError as error:
            raise UserError(
                f"--workers: no other process can be started ({error.strerror}); ask for fewer"
            ) from error
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
        theirs.close()  # so that this end is closed when the worker's is gone
        return self._pipe


def _work(pipe: Connection, environment: Mapping[str, str]) -> None:
    """A worker, which has loaded nothing yet that reads its environment."""
    os.environ.update(environment)
    threading.Thread(target=end_with_parent, daemon=True).start()
    keep_programs()
    while True:
        try:
            task = pipe.recv()
        except EOFError:  # whoever gave the tasks is gone
            return
        try:
            answer = evaluate(task)
        except UserError as error:
            answer = error
        pipe.send(answer)


def end_with_parent() -> None:
    """End this process as soon as the one that started it has ended, however that did."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
