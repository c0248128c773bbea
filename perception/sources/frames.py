"""What a source of pictures yields: frames, frames that are lost, and notices."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import UInt8


@final
class Loss(enum.Enum):
    """Why frames are lost; the values are what a person reads."""

    BROKEN = "It is there and cannot be decoded, or only with errors."
    ABSENT = "The video names it and has it no more."
    OTHER_SIZE = "It has other columns and rows than are required."
    SKIPPED = "A live stream had a newer one when the next was asked for."


@final
@dataclass(frozen=True)
class Frame:
    """A picture.

    Attributes:
        number: of frames before it, lost ones too.
        time: s: from a video's start, or since a live stream was opened; ``None`` of a picture
            file.
        name: of the file, or ``"frame"`` and its number.
        image: red, green and blue, 8 bits: what `perception.detect_views` takes.
    """

    number: int
    time: float | None
    name: str
    image: UInt8[np.ndarray, "rows columns 3"]


@final
@dataclass(frozen=True)
class LostFrame:
    """Frames that are lost, one after another for the same reason; its text is one line.

    Attributes:
        number: of the first of them.
        time: s, as a `Frame` has it; ``None`` where it is unknown.
        name: of the file, or ``"frame"`` and its number, or ``"frames"`` and their numbers.
        loss: what kind of loss it is.
        reason: in words.
        count: how many are lost. Of a video that cannot be opened it is 1.
    """

    number: int
    time: float | None
    name: str
    loss: Loss
    reason: str
    count: int = 1

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}"


@final
@dataclass(frozen=True)
class Notice:
    """What a live stream did between frames: it broke off, is back, or shows a still picture.

    Attributes:
        time: s since the stream was opened.
        text: one line.
    """

    time: float
    text: str

    def __str__(self) -> str:
        return self.text


Item = Frame | LostFrame | Notice


def frame_name(number: int, count: int = 1) -> str:
    """What frames are called that have no file."""
    return f"frame {number}" if count == 1 else f"frames {number} to {number + count - 1}"
