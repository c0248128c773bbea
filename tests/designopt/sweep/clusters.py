"""A real dask cluster on this machine, and a way to hurt it."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from distributed import Client, LocalCluster


@contextmanager
def two_workers() -> Iterator[Any]:
    """A cluster of two processes with one thread each."""
    # Without a dashboard there is a page nevertheless: at any free port.
    options: dict[str, Any] = {
        "dashboard_address": "127.0.0.1:0",
        "scheduler_kwargs": {"dashboard": False},
    }
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, **options) as cluster:
        yield cluster


def kill_a_worker(address: str) -> None:
    """Kill the process of a worker, as the system does when memory runs out."""
    client: Any = Client(address, set_as_default=False)
    with client:
        os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)
