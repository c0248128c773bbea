"""OpenCV on one core, and run times that can be compared."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import cv2

Taken = TypeVar("Taken")


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV on one core while the context lasts."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def median_seconds(call: Callable[[Taken], object], arguments: Iterable[Taken]) -> float:
    """Median run time of a function, from its arguments one after the other."""
    seconds = []
    for argument in arguments:
        start = time.perf_counter()
        call(argument)
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)
