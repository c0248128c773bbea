"""Pictures and videos that are written beside the records."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from studies.commands.overlay import draw_overlay, draw_pad
from studies.commands.records import Seen
from studies.models.sensor.reading import Image

OVERLAY, PADS, VIDEO = "overlay", "pads", "overlay.avi"

USUAL_RATE, RATES = 25.0, (1.0, 240.0)
"""Pictures per second of a video of one picture, and the range of others."""

QUICK = (cv2.IMWRITE_PNG_COMPRESSION, 1)
"""PNG is lossless anyhow; more takes three times as long for a tenth of its size."""

CENTER, CODES = 128.0, 254.0
"""Of a difference's picture: the code of none, and the codes for 1."""


class Writer(Protocol):
    """Writes something of every frame."""

    def add(self, seen: Seen) -> None:
        """Write that of a frame."""

    def close(self) -> None:
        """Write what is left."""


def write_picture(path: Path, picture: np.ndarray) -> None:
    """Write a picture of red, green and blue.

    Raises:
        OSError: it cannot be written.
    """
    data = cv2.imencode(path.suffix, cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), QUICK)[1]
    path.write_bytes(data.tobytes())


class PadPictures:
    """Every pad unwarped, as ``pads/<frame>-<pad>.png``, and its difference, ``...-change.png``.

    A pad with contacts has a third picture, ``...-contacts.png``, in which they are marked.

    Args:
        folder: of the result.
        pads: their names.
    """

    def __init__(self, folder: Path, pads: Sequence[str]) -> None:
        self._folder = folder / PADS
        self._folder.mkdir()
        plain = [re.sub(r"\W", "_", pad) for pad in pads]
        self._names = {
            pad: name if plain.count(name) == 1 else f"{name}-{number}"
            for number, (pad, name) in enumerate(zip(pads, plain, strict=True))
        }

    def add(self, seen: Seen) -> None:
        """Write those of a frame."""
        for pad, shown in seen.pads.items():
            name = f"{seen.frame.number:06d}-{self._names[pad]}"
            write_picture(self._folder / f"{name}.png", shown.picture)
            if shown.difference is not None:
                codes = np.clip(CENTER + CODES * shown.difference, 0, 255).round().astype(np.uint8)
                write_picture(self._folder / f"{name}-change.png", codes)
            if shown.contacts:
                write_picture(self._folder / f"{name}-contacts.png", draw_pad(shown))

    def close(self) -> None:
        """Nothing is left to write."""


class OverlayPictures:
    """Frames with what was found in them, as ``overlay/<frame>.png``.

    Args:
        folder: of the result.
        joints: their names.
        pads: their names.
    """

    def __init__(self, folder: Path, joints: Sequence[str], pads: Sequence[str]) -> None:
        self._folder, self._names = folder / OVERLAY, (joints, pads)
        self._folder.mkdir()

    def add(self, seen: Seen) -> None:
        """Write that of a frame."""
        path = self._folder / f"{seen.frame.number:06d}.png"
        write_picture(path, draw_overlay(seen, *self._names))

    def close(self) -> None:
        """Nothing is left to write."""


class OverlayVideo:
    """The same as a video, ``overlay.avi`` (MJPEG), at the rate of its first two frames.

    Args:
        folder: of the result.
        joints: their names.
        pads: their names.
    """

    def __init__(self, folder: Path, joints: Sequence[str], pads: Sequence[str]) -> None:
        self._path, self._names = folder / VIDEO, (joints, pads)
        self._writer: cv2.VideoWriter | None = None
        self._first: tuple[float, Image] | None = None

    def add(self, seen: Seen) -> None:
        """Write a frame; the first one waits for the second, which shows the rate."""
        picture, time = draw_overlay(seen, *self._names), seen.frame.time or 0.0
        if self._writer is None:
            if self._first is None:
                self._first = time, picture
                return
            before, first = self._first
            rate = 1 / (time - before) if time > before else USUAL_RATE
            self._writer = self._opened(first, rate)
        self._writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))

    def close(self) -> None:
        """Write what is left, and the video's index."""
        if self._writer is None and self._first is not None:
            self._writer = self._opened(self._first[1], USUAL_RATE)
        if self._writer is not None:
            self._writer.release()

    def _opened(self, first: Image, rate: float) -> cv2.VideoWriter:
        size = first.shape[1::-1]
        code = cv2.VideoWriter.fourcc(*"MJPG")
        rate = float(np.clip(rate, *RATES))
        writer = cv2.VideoWriter(str(self._path), cv2.CAP_FFMPEG, code, rate, size)
        if not writer.isOpened():
            raise OSError(None, "the video cannot be written", str(self._path))
        writer.write(cv2.cvtColor(first, cv2.COLOR_RGB2BGR))
        return writer
