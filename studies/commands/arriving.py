"""Items of a source as they come, and views that are found in frames meanwhile, in their order."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import Future
from typing import NamedTuple

import numpy as np

from perception import Sighting
from perception.sources import Frame, Item, Source


class Arrival(NamedTuple):
    """An item of a source.

    Attributes:
        item: it.
        time: of its arrival, s of the monotonic clock.
        sighting: of a frame, once it is found.
    """

    item: Item
    time: float
    sighting: Future[Sighting] | None


def arriving(
    source: Source, start: Callable[[np.ndarray], Future[Sighting]], most: int
) -> Generator[Arrival]:
    """All items of a source, in their order; closing the iterator closes the source.

    A thread asks for the next item only if fewer than ``most`` are on their way: of a live stream
    that one is then the newest.

    Args:
        source: of frames.
        start: begins to look for views in an image.
        most: items.
    """
    slots, arrivals = threading.Semaphore(most), queue.SimpleQueue[Arrival | Exception | None]()
    left = threading.Event()

    def follow() -> None:
        try:
            items = iter(source)
            while slots.acquire() and not left.is_set() and (item := next(items, None)) is not None:
                now = time.monotonic()
                found = start(item.image) if isinstance(item, Frame) else None
                arrivals.put(Arrival(item, now, found))
            arrivals.put(None)
        except Exception as error:
            arrivals.put(error)

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    try:
        while (arrival := arrivals.get()) is not None:
            if isinstance(arrival, Exception):
                raise arrival
            yield arrival
            slots.release()
    finally:
        left.set()
        source.close()
        slots.release()
        thread.join()
