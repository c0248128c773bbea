"""Workers of a dask.distributed cluster."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from designopt.errors import UserError
from designopt.sweep.evaluating import Task, evaluate
from designopt.sweep.outcomes import Outcome

if TYPE_CHECKING:
    from distributed import Client

LOG = logging.getLogger(__name__)

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
    # What it logs of lost workers and schedulers is replaced by one line below.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        # A client of an address that is none would end with the process, and with a traceback.
        asyncio.run(_connect(address))
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except Exception as error:  # what an address can be faulty in is the transport's to say
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(
            f"{place}: no scheduler answers there ({reason}); start one with 'dask scheduler', or "
            "correct the address"
        ) from error
    try:
        # A worker without this package ends when it reads a task, which then waits for another
        # worker; this it can read.
        list(_answers(client, version, {0: "designopt"}, place))
        suspects = {}
        for index, answer in _answers(client, evaluate, dict(enumerate(tasks)), place):
            if answer is None:
                suspects[index] = tasks[index]
            else:
                yield index, answer
        # A lost worker is held against all tasks that were assigned to it: evaluated alone,
        # each has its own result.
        for index, task in suspects.items():
            yield from _answers(client, evaluate, {index: task}, place)
    finally:
        client.close(timeout=PATIENCE)  # whereupon the cluster forgets what is not finished


async def _connect(address: str) -> None:
    """Connect to a scheduler and leave it again."""
    from distributed.comm.core import connect
    from distributed.security import Security

    options = Security().get_connection_args("client")
    # Another kind of server may take the connection and never answer.
    async with asyncio.timeout(2 * PATIENCE):
        connection = await connect(address, timeout=PATIENCE, **options)
    await connection.close()


def _answers(
    client: Client, function: Callable[[Any], Any], asked: Mapping[int, Any], place: str
) -> Iterator[tuple[int, Any]]:
    """What the function answers, by the number of what is asked; ``None`` for a lost worker."""
    from distributed import KilledWorker, as_completed

    if not client.nthreads():
        LOG.warning("%s: it has no workers; waiting for some", place)
    futures = {client.submit(function, one, pure=False): index for index, one in asked.items()}
    for future in as_completed([*futures], loop=client.loop):
        # An answer that nobody holds is not computed again when its worker is lost.
        index = futures.pop(future)
        try:
            answer = future.result()
        except KilledWorker:
            answer = None
        except (CancelledError, OSError) as error:
            raise UserError(f"{place}: the scheduler was lost; start it again") from error
        except UserError as error:
            raise UserError(f"{place}: {error}") from error
        except Exception as error:  # whatever keeps a worker from running it at all
            raise UserError(
                f"{place}: a worker cannot run points ({type(error).__name__}: {error}); "
                "install the same packages there"
            ) from error
        del future
        yield index, answer
