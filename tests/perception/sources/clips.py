"""Videos in which every picture shows its number, and what can happen to a file."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from tests.perception.sources.served import picture

SIZE = 192, 144

CODES = {".avi": "MJPG", ".mp4": "mp4v", ".mkv": "mp4v", ".mov": "MJPG"}


def write_clip(path: Path, count: int, code: str | None = None) -> bytes:
    """Write so many pictures at 25 a second, and return the file's bytes."""
    four = cv2.VideoWriter.fourcc(*(code or CODES[path.suffix]))
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, four, 25.0, SIZE)
    assert writer.isOpened()
    for number in range(count):
        writer.write(picture(number, SIZE))
    writer.release()
    return path.read_bytes()


def damaged(data: bytes, generator: np.random.Generator, head: int = 0) -> bytes:
    """A file that was cut, of which a piece is missing or overwritten, or single bytes are wrong.

    Args:
        data: the whole file.
        generator: of what happens, and where.
        head: so many bytes at its beginning stay.
    """
    body = bytearray(data)
    at, length = int(generator.integers(head, len(body))), int(generator.integers(1, 2000))
    match int(generator.integers(5)):
        case 0:
            del body[at:]
        case 1:
            del body[at : at + length]
        case 2:
            body[at : at + length] = bytes(len(body[at : at + length]))
        case 3:
            noise = generator.integers(0, 256, len(body[at : at + length]), np.uint8)
            body[at : at + length] = noise.tobytes()
        case _:
            for place in generator.integers(head, len(body), 40):
                body[place] ^= int(generator.integers(1, 256))
    return bytes(body)
