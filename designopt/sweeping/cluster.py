"""Workers of a dask.distributed cluster."""

from __future__ import annotations

import logging
import sys
from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, as_completed

from designopt.errors import UserError
from designopt.sweeping.evaluating import Task, evaluate
from designopt.sweeping.outcomes import Outcome

PATIENCE = 10.0
"""Seconds given to the scheduler to answer."""


def run_on_cluster(
    tasks: Sequence[Task], address: str
) -> Generator[tuple[int, list[Outcome] | None]]:
    """Every task's index with what became of its points, as they finish.

    A task that loses its worker goes to another one by itself. Closing the iterator cancels what
    is not finished.

    Args:
        tasks: what is to be done.
        address: of the scheduler, such as ``tcp://node:8786``.

    Yields:
        ``None`` in place of outcomes for a task that has lost its worker more often than the
        cluster allows (dask's ``distributed.scheduler.allowed-failures``).

    Raises:
        UserError: dask is not installed, the scheduler does not answer or is lost, or its workers
            cannot run the task.
    """
    place = f"--scheduler {address}"
    try:
        from distributed import Client
    except ImportError as error:
        raise UserError(
            f"{place}: clusters need the extra 'cluster'; install it: pip install "
            "'designopt[cluster]'"
        ) from error
    # What it logs of a lost scheduler is told below, in one line.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, ImportError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(
            f"{place}: no scheduler answers there ({reason}); start one with 'dask scheduler', or "
            "correct the address"
        ) from error
    if not client.nthreads():
        print(f"{place}: it has no workers yet; waiting for some", file=sys.stderr)
    executor = client.get_executor(pure=False)
    try:
        suspects = []
        for index, answer in _answers(executor, tasks, range(len(tasks)), place):
            if answer is None:
                suspects.append(index)
            else:
                yield index, answer
        # A lost worker is held against all tasks that were assigned to it: alone, each tells.
        for index in suspects:
            yield from _answers(executor, tasks, [index], place)
    finally:
        executor.shutdown(wait=False)
        client.close(timeout=PATIENCE)


def _answers(
    executor: Executor, tasks: Sequence[Task], indices: Iterable[int], place: str
) -> Iterator[tuple[int, list[Outcome] | None]]:
    from distributed import KilledWorker

    futures = {executor.submit(evaluate, tasks[index]): index for index in indices}
    for future in as_completed(futures):
        try:
            answer = future.result()
        except KilledWorker:
            answer = None
        except CancelledError as error:
            raise UserError(f"{place}: the scheduler was lost; start it again") from error
        except UserError as error:
            raise UserError(f"{place}: {error}") from error
        except Exception as error:  # whatever keeps a worker from running it at all
            raise UserError(
                f"{place}: a worker cannot run points ({type(error).__name__}: {error}); "
                "install the same packages there"
            ) from error
        yield futures[future], answer
