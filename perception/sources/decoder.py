"""The program that decodes, in a process of its own: pictures, videos, live streams.

Decoders report what is wrong with a picture on the error stream of their process alone (libjpeg,
libpng, FFmpeg), they wait for cameras that are silent, and a hostile file may crash them. In a
process of its own that stream can be read, a wait be ended and a crash costs one picture.

It is run as a script, and imports nothing of ours. It answers with lines of JSON, each followed by
the image that it announces; `perception.sources.process` reads them.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import resource
import sys
import tempfile
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from typing import Any, NamedTuple

import cv2
import numpy as np

MOST_MEMORY = 4 << 30
"""Bytes of address space: what would need more is refused."""

MOST_PIXELS = 100_000_000
"""Of a picture: more than any camera's."""

PADDING = 16
"""Bytes of filling that a camera may leave between a JPEG's data and its end mark."""

MOST_TEXT = 1 << 20
"""Bytes of messages that are kept."""

OPENING, SILENCE = 5.0, 3.0
"""Seconds in which a live stream must open, and after which it counts as broken off if silent."""

STEADY = 10
"""Steps of equal time after which a longer one means that pictures are missing."""

ATTEMPTS = 1000
"""Packets without a picture after which a video is at its end: there, each costs nothing."""

COLORS = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
"""Pixels as the sensor has them: a lens is calibrated for those, and not for a turned picture."""

ORIGIN = re.compile(r"^\[(\S+) @ 0x[0-9a-f]+\] *")
"""Before a line of FFmpeg: which part of it wrote it."""


class Shot(NamedTuple):
    """A picture, or why it is lost.

    Attributes:
        data: an image of red, green and blue, or the bytes of a JPEG that is to be decoded.
        reason: why it is lost; empty if it is not.
        time: s since a video's start; of a live stream, of the monotonic clock.
        lost: pictures that are lost before it, and why.
    """

    data: np.ndarray | bytes | None
    reason: str
    time: float
    lost: int = 0
    why: str = ""


class Messages:
    """What decoders wrote on the error stream, line by line: FFmpeg's lines, and others.

    A thread that reads with FFmpeg must not take what libjpeg reports meanwhile of a picture.
    """

    def __init__(self) -> None:
        self.file = tempfile.TemporaryFile()  # noqa: SIM115 - it is the process's error stream
        self.lock, self.start = threading.Lock(), 0
        self.lines: dict[bool, list[str]] = {True: [], False: []}
        number = self.file.fileno()
        fcntl.fcntl(number, fcntl.F_SETFL, fcntl.fcntl(number, fcntl.F_GETFL) | os.O_APPEND)
        for stream in (1, 2):  # nothing is to come between the answers
            os.dup2(number, stream)

    def take(self, *, ffmpeg: bool) -> list[str]:
        """The lines of FFmpeg, or the others, since they were taken last."""
        with self.lock:
            number = self.file.fileno()
            text, _, rest = os.pread(number, MOST_TEXT, self.start).rpartition(b"\n")
            self.start += len(text) + bool(text)
            if self.start > MOST_TEXT and not rest:
                os.ftruncate(number, 0)
                self.start = 0
            for line in text.decode(errors="replace").splitlines():
                self.lines[bool(ORIGIN.match(line))].append(
                    " ".join(ORIGIN.sub(r"\1: ", line).split())
                )
            taken, self.lines[ffmpeg] = self.lines[ffmpeg], []
        return [line for line in taken if line]


def complaint(lines: Iterable[str]) -> str:
    """What is wrong with a picture: the first line that concerns one, or nothing."""
    for line in lines:
        padding = re.search(r": (\d+) extraneous bytes before marker 0xd9", line)
        if padding is None or int(padding[1]) > PADDING:
            return line.removeprefix("Corrupt JPEG data: ").removeprefix("libpng error: ")
    return ""


def decode(data: bytes, messages: Messages) -> tuple[np.ndarray | None, str]:
    """The image in bytes of a file, or ``None`` and why there is none."""
    messages.take(ffmpeg=False)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), COLORS) if data else None
    except (cv2.error, MemoryError) as error:
        if "MAX_IMAGE" in str(error):
            return None, f"it has more than {MOST_PIXELS // 10**6} million pixels"
        return None, f"it cannot be decoded: {' '.join(str(error).split())}"
    wrong = complaint(line for line in messages.take(ffmpeg=False) if "libpng warning" not in line)
    if image is not None and not wrong:
        return image, ""
    return None, f"it is damaged: {wrong}" if wrong else "it is cut off or damaged"


class Capture:
    """A video or a live stream, opened.

    Args:
        target: a file, an address or the number of a device.
        messages: of the process.
        size: columns and rows that a device is asked for.

    Raises:
        OSError: it cannot be opened.
    """

    def __init__(
        self, target: str | int, messages: Messages, size: tuple[int, int] | None = None
    ) -> None:
        self.messages, self.damaged, self.why = messages, False, ""
        self.position, self.steps = -1, 0
        self.is_device = isinstance(target, int)
        self._take()
        if isinstance(target, int):
            backend = cv2.CAP_V4L2 if sys.platform == "linux" else cv2.CAP_ANY
            self.capture = cv2.VideoCapture(target, backend)
            for name, value in zip(
                (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT), size or (), strict=False
            ):
                self.capture.set(name, value)
        else:
            waits = {
                cv2.CAP_PROP_OPEN_TIMEOUT_MSEC: OPENING,
                cv2.CAP_PROP_READ_TIMEOUT_MSEC: SILENCE,
            }
            # With one thread, a message comes with the picture that it concerns.
            parameters = [cv2.CAP_PROP_N_THREADS, 1]
            parameters += [part for key, wait in waits.items() for part in (key, int(1000 * wait))]
            self.capture = cv2.VideoCapture(target, cv2.CAP_FFMPEG, parameters)
        if not self.capture.isOpened():
            raise OSError(next(iter(self._take()), "there is nothing to be read"))
        width, height = (
            self.capture.get(one) for one in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        if width * height > MOST_PIXELS:
            raise OSError(f"its pictures have more than {MOST_PIXELS // 10**6} million pixels")
        self.capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        code = int(self.capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
        self.is_jpeg = not self.is_device and code.to_bytes(4, "little").upper() in (
            b"MJPG",
            b"JPEG",
        )
        if self.is_jpeg:
            # Whole JPEGs: FFmpeg would mend what is missing, and libjpeg reports it.
            self.capture.set(cv2.CAP_PROP_FORMAT, -1)
        self.opening = self._take()

    @property
    def count(self) -> int:
        """Pictures that the container names; 0 if it names none."""
        count = self.capture.get(cv2.CAP_PROP_FRAME_COUNT)
        return int(count) if count > 0 else 0

    def read(self, patience: float = float("inf")) -> Shot | None:
        """The next picture; ``None`` at the end, and where none comes for so many seconds."""
        began, lines, grabbed = time.monotonic(), list[str](), False
        for _ in range(ATTEMPTS):
            grabbed = self.capture.grab()
            lines += self._take()
            if grabbed or time.monotonic() - began > patience:
                break
        if not grabbed:
            self.why = complaint(lines)
            return None
        seconds = self.capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
        gap = self._gap(noticed=bool(lines or self.opening))
        self.opening = []
        try:
            has, data = self.capture.retrieve()
        except cv2.error:
            has, data = False, None
        lines += self._take()
        wrong = complaint(lines)
        if self.is_jpeg:
            return Shot(data.tobytes() if data is not None else b"", "", seconds, gap, wrong)
        if self.is_device:
            self.damaged = bool(wrong)
        else:
            # A picture that is predicted from a damaged one is damaged.
            is_key = self.capture.get(cv2.CAP_PROP_FRAME_TYPE) == ord("I")
            self.damaged = bool(wrong and not gap) or (not is_key and (self.damaged or gap > 0))
        if has and data is not None and not self.damaged:
            return Shot(cv2.cvtColor(data, cv2.COLOR_BGR2RGB), "", seconds, gap, wrong)
        reason = f"it is damaged: {wrong}" if wrong else "it follows a damaged picture"
        return Shot(None, reason if has else "it has no data", seconds, gap, wrong)

    def _take(self) -> list[str]:
        """Messages: of FFmpeg; those about a device's pictures are libjpeg's."""
        return self.messages.take(ffmpeg=not self.is_device)

    def _gap(self, *, noticed: bool) -> int:
        """Pictures that are missing before this one, by its time.

        Times are no steps of a clock in every video: a long one counts if there was a message, or
        after many even ones.
        """
        now = self.capture.get(cv2.CAP_PROP_PTS)
        before, self.position = self.position, round(now) if 0 <= now < 2**31 else self.position + 1
        gap = max(0, self.position - before - 1)
        is_even, self.steps = self.steps >= STEADY, 0 if gap else self.steps + 1
        return gap if noticed or is_even else 0


class Newest:
    """The newest picture of a live stream, which a thread goes on reading."""

    def __init__(self, capture: Capture) -> None:
        self.capture, self.changed = capture, threading.Condition()
        self.shot: Shot | None = None
        self.skipped, self.end = 0, ""
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self) -> None:
        end = "the decoder failed"
        try:
            last = time.monotonic()
            while (shot := self.capture.read(SILENCE)) is not None:
                last = time.monotonic()
                with self.changed:
                    self.skipped += self.shot is not None
                    self.shot = shot._replace(time=last, lost=0, why="")
                    self.changed.notify()
            is_silent = time.monotonic() - last > SILENCE
            end = f"no picture came for {SILENCE:.0f} s" if is_silent else "the stream broke off"
            self.capture.capture.release()
        finally:
            with self.changed:
                self.end = end
                self.changed.notify()

    def take(self) -> Shot | None:
        """The newest, once there is one that was not taken; ``None`` when the stream has ended."""
        with self.changed:
            self.changed.wait_for(lambda: self.shot is not None or self.end)
            shot, self.shot = self.shot, None
            skipped, self.skipped = self.skipped, 0
        return None if shot is None else shot._replace(lost=skipped)


class Answers:
    """The lines of JSON, and images, that this program writes."""

    def __init__(self) -> None:
        self.stream = os.fdopen(os.dup(1), "wb")

    def shot(self, shot: Shot, messages: Messages) -> None:
        """A picture, decoded if it is not yet."""
        image, reason = shot.data, shot.reason
        if isinstance(image, bytes):
            image, reason = decode(image, messages)
        self.write(image, reason=reason, time=shot.time, lost=shot.lost, why=shot.why)

    def write(self, image: np.ndarray | None = None, **fields: Any) -> None:
        """One line, and an image."""
        shape = None if image is None else image.shape[:2]
        self.stream.write(json.dumps({**fields, "shape": shape}).encode() + b"\n")
        if image is not None:
            self.stream.write(np.ascontiguousarray(image).data.cast("B"))
        self.stream.flush()


def requests() -> Iterable[Any]:
    """What is asked for, a line of JSON each."""
    return map(json.loads, iter(sys.stdin.buffer.readline, b""))


def pictures(answers: Answers, messages: Messages) -> None:
    """Decode every file that is asked for."""
    for path in requests():
        try:
            with open(path, "rb") as file:
                data = file.read()
        except OSError as error:
            answers.write(reason=f"it cannot be read: {error.strerror}")
            continue
        if not data:
            answers.write(reason="it is empty")
        elif not cv2.haveImageReader(path):
            answers.write(reason="it is no picture, whatever its name ends in")
        else:
            answers.shot(Shot(data, "", 0.0), messages)


def video(path: str, answers: Answers, messages: Messages) -> None:
    """Decode all pictures of a video, and count those that its container names and that are lost.

    AVI and MP4 name a number of pictures; what other containers do is an estimate from a duration,
    which is believed only if the file ends too early.
    """
    try:
        with open(path, "rb") as file:
            head = file.read(12)
        if not head:
            raise OSError("it is empty")
        capture = Capture(path, messages)
    except OSError as error:
        reason = f"it cannot be opened as a video: {error.strerror or error}"
        answers.write(end=True, reason=reason, lost=1)
        return
    named = capture.count if capture.count <= os.path.getsize(path) else 0
    has_number = head[8:] == b"AVI " or head[4:8] == b"ftyp"
    seen = 0
    while (shot := capture.read()) is not None:
        lost = min(shot.lost, max(0, named - seen - 1)) if named else shot.lost
        if has_number and not shot.why:  # then the number decides, at the end
            lost = 0
        why = shot.why or "there is a gap in the times of its pictures"
        answers.shot(shot._replace(lost=lost, why=f"missing: {why}"), messages)
        seen += 1 + lost
    if has_number:
        rest = max(0, named - seen)
    else:
        rest = max(1, named - 1 - capture.position) if capture.why else 0
    reason = f"missing: {capture.why or 'the file names more pictures than it has'}"
    if not seen:
        rest = max(rest, named, 1)
        reason = ": ".join(filter(None, ["there are no pictures in it", capture.why]))
    answers.write(end=True, reason=reason, lost=rest)


def live(target: str | int, size: Any, answers: Answers, messages: Messages) -> None:
    """Whenever asked, the newest picture of a stream; it is opened again after it broke off."""
    newest = None
    for _ in requests():
        try:
            if newest is None:
                capture = Capture(target, messages, size)
                if capture.count:
                    raise OSError("it is a file and no stream; download it and name the file")
                newest = Newest(capture)
        except OSError as error:
            answers.write(end=True, reason=str(error))
            continue
        shot = newest.take()
        if shot is None:
            answers.write(end=True, reason=newest.end)
            newest = None
        else:
            answers.shot(shot, messages)


def main() -> None:
    """Do one of the three, with the arguments that `perception.sources.process` gives."""
    with suppress(ValueError, OSError):  # where the system has no such limit
        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    answers = Answers()
    messages = Messages()
    task, *arguments = json.loads(sys.argv[1])
    with suppress(BrokenPipeError):
        {"pictures": pictures, "video": video, "live": live}[task](*arguments, answers, messages)
    os._exit(0)  # a thread may be waiting for a camera


if __name__ == "__main__":
    main()
