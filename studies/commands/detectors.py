"""Processes that find views: most of that is Python, of which threads run one at a time.

Images lie in memory that they share: sending one through a pipe takes a third of the time that
finding its views takes.
"""

from __future__ import annotations

import ctypes
import functools
import math
import multiprocessing
import os
import pickle
import queue
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from designopt.compilation_cache import keep_programs
from designopt.cores import usable_cores
from designopt.sweep.evaluating import ONE_THREAD
from designopt.sweep.workers import end_with_parent

if TYPE_CHECKING:
    from multiprocessing.synchronize import Barrier

    import numpy as np

    from perception import Sighting
    from studies.models.sensor.finger_sensor import FingerSensor

    Slot = ctypes.Array[ctypes.c_ubyte]

MOST = 4
"""Processes: they are given images by one."""

_detect: Any = None
"""In such a process: from an image to its sighting."""

_slots: Sequence[Slot] = ()
"""In such a process: where images are, whose shape its lens has."""


class Detectors:
    """Processes at work.

    Attributes:
        count: how many.
    """

    def __init__(
        self,
        pool: ProcessPoolExecutor,
        count: int,
        slots: Sequence[Slot],
        begun: Sequence[Future[None]],
    ) -> None:
        self._pool, self.count, self._slots, self._begun = pool, count, slots, begun
        self._free = queue.SimpleQueue[int]()
        for number in range(len(slots)):
            self._free.put(number)

    def wait(self) -> None:
        """Until all of them have loaded what they need."""
        for one in self._begun:
            one.result()

    def start(self, image: np.ndarray) -> Future[Sighting]:
        """Begin with an image of the lens; what is returned has its sighting when that is found.

        It waits while as many images are looked at as there is room for.
        """
        number = self._free.get()
        _image_at(self._slots[number], image.shape)[:] = image
        found = self._pool.submit(_found, number)
        found.add_done_callback(lambda _: self._free.put(number))
        return found


@contextmanager
def detectors(finger: FingerSensor) -> Iterator[Detectors]:
    """As many processes as there are cores, ended on leaving."""
    count, context = min(usable_cores(), MOST), multiprocessing.get_context("spawn")
    size = 3 * math.prod(finger.lens.shape)
    slots = [context.RawArray(ctypes.c_ubyte, size) for _ in range(count + 1)]
    about = pickle.dumps((finger.imaging, finger.lens.response, finger.catalog))
    pool = ProcessPoolExecutor(
        count,
        context,
        _begin,
        (about, slots, context.Barrier(count), os.environ | ONE_THREAD),
    )
    # A blocked signal stays blocked in the processes that are started: Ctrl-C is for this one.
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        begun = [pool.submit(_nothing) for _ in range(count)]
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    try:
        yield Detectors(pool, count, slots, begun)
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(
    about: bytes, slots: Sequence[Slot], all_begun: Barrier, environment: dict[str, str]
) -> None:
    """A process, which has loaded nothing yet that reads its environment."""
    global _detect, _slots
    _slots = slots
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

    _detect = functools.partial(detect_views, lens=lens, catalog=catalog)
    all_begun.wait()


def _found(number: int) -> Sighting:
    return _detect(_image_at(_slots[number], (*_detect.keywords["lens"].shape, 3)))


def _image_at(slot: Slot, shape: tuple[int, ...]) -> np.ndarray:
    import numpy as np

    return np.frombuffer(memoryview(slot), np.uint8).reshape(shape)


def _nothing() -> None:
    """Have a process started."""
