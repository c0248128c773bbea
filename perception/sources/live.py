"""Live streams: a camera of this machine, or one in the network."""

from __future__ import annotations

import re
import threading
import time
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import UInt8

from designopt.errors import UserError
from perception.sources import decoder
from perception.sources.frames import Item, Loss, LostFrame, Notice, frame_name
from perception.sources.process import Answer
from perception.sources.source import Size, Source, make_item

FIRST_WAIT, LAST_WAIT = 0.2, 5.0
"""Seconds until a stream that broke off is opened again: doubled each time, up to the last."""

HANGING = decoder.OPENING + decoder.SILENCE + 10.0
"""Seconds after which a decoder that does not answer is replaced; starting it takes some."""

STILL = 3.0
"""Seconds of pictures that are alike to the last bit after which a camera probably hangs."""

EACH = 16
"""Every so many rows are compared: a camera's noise changes them all."""


def _cure(target: str | int) -> str:
    if isinstance(target, str):
        return "look whether the camera is on and its address right"
    cameras = sorted(map(str, Path("/dev").glob("video*")))
    there = f"this machine has {', '.join(cameras) or 'no camera under /dev'}"
    return f"look whether no other program has it; {there}"


def without_password(text: str) -> str:
    """A text in which addresses have no user and no password."""
    return re.sub(r"//[^/@\s]*@", "//", text)


@final
class LiveStream(Source):
    """The newest picture of a live stream, whenever one is asked for.

    A thread of the decoder's process reads on all the while; pictures that were not asked for in
    time are counted, and reported as one `LostFrame` of `Loss.SKIPPED` before the next frame. Where
    the stream breaks off, or is silent for `decoder.SILENCE`, there is one `Notice`, and one when
    it is back: meanwhile it is opened again and again, after waits that grow from `FIRST_WAIT` to
    `LAST_WAIT`. They begin anew when it has been back for `LAST_WAIT`. Iterating ends only with
    `close`.

    Args:
        name: what a person calls it.
        target: an address, or the number of a device.
        size: columns and rows that are required, and that a device is asked for; or ``None``.

    Raises:
        UserError: it cannot be opened.
    """

    def __init__(self, name: str, target: str | int, size: Size | None = None) -> None:
        super().__init__(name, size)
        self._arguments = target, size
        self._closed = threading.Event()
        self._number, self._began = 0, time.monotonic()
        self._start("live", *self._arguments)
        self._first: Answer | None = self._ask()
        if self._first.end:
            self.close()
            raise UserError(f"{name}: cannot be opened: {self._first.reason}; {_cure(target)}")

    def close(self) -> None:
        """End the stream, and any iterating."""
        self._closed.set()
        super().close()

    def _items(self) -> Iterator[Item]:
        wait, broke_off, back = FIRST_WAIT, None, self._began
        still = _Still()
        while not self._closed.is_set():
            answer, self._first = self._first or self._ask(), None
            now = time.monotonic()
            if answer.end:
                if self._closed.is_set():
                    return
                if broke_off is None:
                    broke_off, wait = now, FIRST_WAIT if now - back > LAST_WAIT else wait
                    yield self._notice(f"{answer.reason}; it is opened again until it is back")
                self._closed.wait(wait)
                wait = min(2 * wait, LAST_WAIT)
                continue
            if broke_off is not None:
                yield self._notice(f"back after {now - broke_off:.1f} s")
                broke_off, back = None, now
            if answer.lost:
                yield self._skipped(answer.lost)
            text = "" if answer.image is None else still.look(answer.image, answer.time)
            yield make_item(self._number, answer, answer.time - self._began)
            self._number += 1
            if text:
                yield self._notice(text)

    def _ask(self) -> Answer:
        """The decoder's answer; one of its own where there is none."""
        process = self._decoder
        if process is None:
            return Answer(end=True)
        process.ask()
        answer = process.answer(HANGING)
        if answer is not None:
            return replace(answer, reason=without_password(answer.reason))
        if not self._closed.is_set():
            self._start("live", *self._arguments)
        if self._closed.is_set():  # and maybe just now
            self._end()
        return Answer(reason="the decoder hung or crashed", end=True)

    def _notice(self, text: str) -> Notice:
        return Notice(time.monotonic() - self._began, f"{self.name}: {text}")

    def _skipped(self, count: int) -> LostFrame:
        number, self._number = self._number, self._number + count
        reason = "skipped, for there was a newer one"
        return LostFrame(number, None, frame_name(number, count), Loss.SKIPPED, reason, count)


class _Still:
    """Notices pictures that do not change: a line when they stop, and one when they change."""

    def __init__(self) -> None:
        self.sum, self.since, self.noticed = -1, 0.0, False

    def look(self, image: UInt8[np.ndarray, "rows columns 3"], seconds: float) -> str:
        """A line where one is due, else nothing."""
        checksum = zlib.crc32(image[::EACH].tobytes())
        if checksum != self.sum:
            self.sum, self.since = checksum, seconds
            text = "the picture changes again" if self.noticed else ""
            self.noticed = False
            return text
        if self.noticed or seconds - self.since < STILL:
            return ""
        self.noticed = True
        return f"the picture has not changed by a bit for {STILL:.0f} s; the camera may hang"
