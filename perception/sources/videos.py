"""Video files: every picture that they name, decoded or lost."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import final

from perception.sources.frames import Item, Loss, LostFrame, frame_name
from perception.sources.source import Size, Source, make_item

VIDEOS = (
    *(".avi", ".mp4", ".m4v", ".mov", ".mkv", ".webm", ".mpg", ".mpeg", ".ts", ".mts", ".wmv"),
    *(".flv", ".ogv", ".3gp", ".mjpg", ".mjpeg", ".h264", ".hevc"),
)
"""Endings of video files, in small letters."""


@final
class VideoFile(Source):
    """A video file.

    Pictures that are predicted from a damaged one are lost with it, up to the next that is not
    predicted. What its decoder does not notice stays unnoticed: VP9's, for one, notices little.

    Args:
        path: of the file.
        size: columns and rows that are required, or ``None``.
    """

    def __init__(self, path: Path, size: Size | None = None) -> None:
        super().__init__(str(path), size)
        self.path = path

    def _items(self) -> Iterator[Item]:
        decoder = self._start("video", str(self.path.absolute()))
        number = 0
        try:
            while (answer := decoder.answer()) is not None:
                if answer.lost:
                    yield _absent(number, answer.lost, answer.reason if answer.end else answer.why)
                    number += answer.lost
                if answer.end:
                    return
                yield make_item(number, answer, answer.time)
                number += 1
            if self._decoder is decoder:  # and was not closed by another thread
                yield _absent(number, 1, "the decoder crashed; whatever follows is lost")
        finally:
            self.close()


def _absent(number: int, count: int, reason: str) -> LostFrame:
    return LostFrame(number, None, frame_name(number, count), Loss.ABSENT, reason, count)
