"""Picture files: one, or those of a folder."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import final

from perception.sources.frames import Item
from perception.sources.process import Answer
from perception.sources.source import Size, Source, make_item

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
"""Endings of picture files, in small letters."""


@final
class PictureFiles(Source):
    """Picture files in an order.

    Args:
        name: what a person calls them.
        paths: of the files.
        ignored: number of other files beside them.
        size: columns and rows that are required, or ``None``.
    """

    def __init__(
        self, name: str, paths: list[Path], *, ignored: int = 0, size: Size | None = None
    ) -> None:
        super().__init__(name, size)
        self.paths, self.ignored = paths, ignored

    def _items(self) -> Iterator[Item]:
        decoder = self._start("pictures")
        try:
            for number, path in enumerate(self.paths):
                decoder.ask(str(path))
                answer = decoder.answer()
                if answer is None:
                    if self._decoder is not decoder:  # closed by another thread
                        return
                    answer = Answer(reason="the decoder crashed on it")
                    decoder = self._start("pictures")
                yield make_item(number, answer, None, path.name)
        finally:
            self.close()


def natural_order(path: Path) -> tuple[list[str | int], str]:
    """A key that sorts names as people count: 2 before 10, whatever the case of letters.

    Example:
        >>> paths = [Path("f10.png"), Path("F2.png"), Path("f1.png")]
        >>> [path.name for path in sorted(paths, key=natural_order)]
        ['f1.png', 'F2.png', 'f10.png']
    """
    parts = re.split(r"(\d+)", path.name.casefold())
    return [int(part) if odd % 2 else part for odd, part in enumerate(parts)], path.name


def is_picture(path: Path) -> bool:
    """Whether a file's name is that of a picture; hidden files are none."""
    return path.suffix.lower() in PICTURES and not path.name.startswith(".")
