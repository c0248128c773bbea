"""A source of pictures: iterating yields what there is, and what is lost."""

from __future__ import annotations

import abc
from collections.abc import Iterator
from types import TracebackType
from typing import Any

from perception.sources.frames import Frame, Item, Loss, LostFrame, frame_name
from perception.sources.process import Answer, DecoderProcess

Size = tuple[int, int]
"""Columns and rows."""


class Source(abc.ABC):
    """Where pictures come from. Iterating yields every one, and what was lost, in their order.

    The numbers of frames and of lost frames add up to what there was. A frame is lost if its
    decoder notices damage: all pieces that are missing or zero it does, but JPEG has no checksum,
    and a few wrong bytes in it often pass for a picture. A source ends at the end of a ``with``
    block, or by `close`; one of files ends by itself and can be iterated again.

    Attributes:
        name: what a person calls it.
        size: columns and rows that are required of every picture, or ``None``.
    """

    def __init__(self, name: str, size: Size | None) -> None:
        self.name, self.size = name, size
        self._decoder: DecoderProcess | None = None

    def __iter__(self) -> Iterator[Item]:
        for item in self._items():
            yield self._fitted(item) if isinstance(item, Frame) else item

    def close(self) -> None:
        """End what runs for it, at once, also while another thread iterates."""
        self._end()

    def __enter__(self) -> Source:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    @abc.abstractmethod
    def _items(self) -> Iterator[Item]:
        """All there is, of any size."""

    def _start(self, task: str, *arguments: Any) -> DecoderProcess:
        """A new decoder, in place of one that there may be."""
        self._end()
        self._decoder = DecoderProcess(task, *arguments)
        return self._decoder

    def _end(self) -> None:
        decoder, self._decoder = self._decoder, None
        if decoder is not None:
            decoder.close()

    def _fitted(self, frame: Frame) -> Frame | LostFrame:
        rows, columns, _ = frame.image.shape
        if self.size is None or self.size == (columns, rows):
            return frame
        reason = "it has {}x{} px (columns x rows), not {}x{}".format(columns, rows, *self.size)
        return LostFrame(frame.number, frame.time, frame.name, Loss.OTHER_SIZE, reason)


def make_item(
    number: int, answer: Answer, time: float | None, name: str | None = None
) -> Frame | LostFrame:
    """The frame that a decoder answered with, or its loss."""
    name = frame_name(number) if name is None else name
    if answer.image is None:
        return LostFrame(number, time, name, Loss.BROKEN, answer.reason)
    return Frame(number, time, name, answer.image)
