"""From what a person types to a source of pictures."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

from designopt.errors import UserError
from perception.sources.live import LiveStream, without_password
from perception.sources.pictures import PICTURES, PictureFiles, is_picture, natural_order
from perception.sources.source import Size, Source
from perception.sources.videos import VIDEOS, VideoFile

SCHEMES = ("http", "https", "rtsp", "rtsps")
"""Of cameras in a network."""

ADVICE = (
    "name a picture, a folder of pictures, a video, a camera by its number (0) or an address "
    "(http://…, rtsp://…)"
)


def open_source(text: str, *, size: Size | None = None) -> Source:
    """A source of pictures by its name.

    The name of a picture file or of a video (by its ending), of a folder (its pictures, 2 before
    10; other files are counted as ``ignored``), a number or ``camera:`` and a number or a path
    under ``/dev`` (a camera of this machine), or an address (a camera that serves MJPEG by HTTP,
    or RTSP). Files that cannot be decoded are found out when they come.

    Args:
        text: the name.
        size: columns and rows that are required of every picture, and that a camera of this machine
            is asked for. Others are lost.

    Raises:
        UserError: there is no such thing, it is of another kind, or a live stream cannot be opened.

    Example:
        >>> import tempfile
        >>> import cv2
        >>> import numpy as np
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     for number in (10, 9):
        ...         image = np.full((4, 6, 3), number, np.uint8)
        ...         _ = cv2.imwrite(f"{folder}/{number}.png", image)
        ...     with open_source(folder) as source:
        ...         [(item.number, item.name, item.image.mean()) for item in source]
        [(0, '9.png', np.float64(9.0)), (1, '10.png', np.float64(10.0))]
    """
    if (scheme := re.match(r"([A-Za-z][A-Za-z0-9+.-]*)://", text)) is not None:
        if scheme[1].lower() not in SCHEMES:
            raise UserError(
                f"{without_password(text)}: {scheme[1]} is no scheme of a camera; use one of "
                f"{', '.join(SCHEMES)}"
            )
        return LiveStream(without_password(text), text, size)
    if (number := _device(text)) is not None:
        return LiveStream(f"camera {number}", number, size)
    path = Path(text)
    try:
        if not text or not path.exists():
            raise UserError(f"{text or 'source'}: there is no such file; {ADVICE}")
        if path.is_dir():
            return _folder(text, path, size)
        if not path.is_file():
            raise UserError(f"{text}: that is no ordinary file; {ADVICE}")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UserError(f"{text}: cannot be read: {reason}; {ADVICE}") from error
    if path.suffix.lower() in PICTURES:
        return PictureFiles(text, [path], size=size)
    if path.suffix.lower() in VIDEOS:
        return VideoFile(path, size)
    raise UserError(
        f"{text}: is neither a picture ({', '.join(PICTURES)}) nor a video ({', '.join(VIDEOS)}); "
        "convert it to one of them"
    )


def _folder(text: str, path: Path, size: Size | None) -> PictureFiles:
    files = [one for one in path.iterdir() if one.is_file()]
    paths = sorted(filter(is_picture, files), key=natural_order)
    ignored = len(files) - len(paths)
    if not paths:
        raise UserError(
            f"{text}: there is no picture in the folder, of {ignored} files; a picture ends in "
            f"{', '.join(PICTURES)}"
        )
    return PictureFiles(text, paths, ignored=ignored, size=size)


def _device(text: str) -> int | None:
    """The number of a camera of this machine; ``None`` if the text is no name of one."""
    named = re.fullmatch(r"(?:camera:)?(\d{1,3})", text, re.ASCII)
    if named is None and text.startswith("/dev/") and sys.platform == "linux":
        named = re.fullmatch(r"/dev/video(\d{1,3})", os.path.realpath(text), re.ASCII)
    return None if named is None else int(named[1])
