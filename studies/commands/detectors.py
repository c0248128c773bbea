"""Processes that find views: most of that is Python, of which threads run one at a time."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from designopt.compilation_cache import keep_programs
from designopt.cores import usable_cores
from designopt.sweep.evaluating import ONE_THREAD
from designopt.sweep.workers import end_with_parent

if TYPE_CHECKING:
    import numpy as np

    from perception import Sighting
    from studies.models.sensor.finger_sensor import FingerSensor

MOST = 4
"""Processes: they are given images by one."""

_detect: Any = None
"""In such a process: from an image to its sighting."""


class Detectors:
    """Processes at work.

    Attributes:
        count: how many.
    """

    def __init__(self, pool: ProcessPoolExecutor, count: int) -> None:
        self._pool, self.count = pool, count

    def start(self, image: np.ndarray) -> Future[Sighting]:
        """Begin with an image; what is returned has its sighting when that is found."""
        return self._pool.submit(_found, image)


@contextmanager
def detectors(finger: FingerSensor) -> Iterator[Detectors]:
    """As many processes as there are cores, ended on leaving."""
    count = min(usable_cores(), MOST)
    about = pickle.dumps((finger.imaging, finger.lens.response, finger.catalog))
    pool = ProcessPoolExecutor(
        count,
        multiprocessing.get_context("spawn"),
        _begin,
        (about, os.environ | ONE_THREAD),
    )
    # A blocked signal stays blocked in the processes that are started: Ctrl-C is for this one.
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        pool.submit(_nothing)
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    try:
        yield Detectors(pool, count)
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(about: bytes, environment: dict[str, str]) -> None:
    """A process, which has loaded nothing yet that reads its environment."""
    global _detect
    os.environ.update(environment)
    threading.Thread(target=end_with_parent, daemon=True).start()
    keep_programs()
    from dataclasses import replace

    import cv2
    import jax

    from perception import detect_views
    from studies.models.sensor.estimators import lens_of

    cv2.setNumThreads(1)
    with jax.enable_x64(True):
        imaging, response, catalog = pickle.loads(about)
        lens = replace(lens_of(imaging), response=response)

    def detect(image: np.ndarray) -> Sighting:
        with jax.enable_x64(True):
            return detect_views(image, lens, catalog)

    _detect = detect


def _found(image: np.ndarray) -> Sighting:
    return _detect(image)


def _nothing() -> None:
    """Have the processes started."""
