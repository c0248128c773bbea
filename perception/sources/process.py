"""A process that decodes: it is asked for pictures, and answers with them or with a reason."""

from __future__ import annotations

import io
import json
import os
import select
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import UInt8

from perception.sources import decoder

PIPE = 1 << 20
"""Bytes that wait between the processes; an image has some millions."""

KEPT = 64 << 20
"""Bytes that glibc's allocator keeps: else it returns every image's memory to the system, which
takes longer to be had again than a JPEG to be decoded."""


@dataclass(frozen=True)
class Answer:
    """A picture, or why it is lost.

    Attributes:
        image: red, green and blue; ``None`` if it is lost, and at the end.
        reason: why it is lost, or why the end has come; empty otherwise.
        time: s; of a video from its start, of a live stream of the monotonic clock.
        lost: pictures that are lost before it, or before the end.
        why: they are lost.
        end: there are no more, or a live stream broke off.
    """

    image: UInt8[np.ndarray, "rows columns 3"] | None = None
    reason: str = ""
    time: float = 0.0
    lost: int = 0
    why: str = ""
    end: bool = False


@final
class DecoderProcess:
    """The program `decoder` at work.

    Args:
        task: what it does: ``"pictures"``, ``"video"`` or ``"live"``.
        arguments: of the task, as its function in `decoder` takes them.
    """

    def __init__(self, task: str, *arguments: Any) -> None:
        surroundings = {
            **os.environ,
            "OPENBLAS_NUM_THREADS": "1",
            "OPENCV_IO_MAX_IMAGE_PIXELS": str(decoder.MOST_PIXELS),
            "OPENCV_LOG_LEVEL": "SILENT",
            "OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT": str(round(decoder.SILENCE)),
            "MALLOC_TOP_PAD_": str(KEPT),
        }
        if task == "video":  # a playlist with a video's name must not open what it lists
            surroundings["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = "protocol_whitelist;file"
        for option in ("OPENCV_FFMPEG_LOGLEVEL", "OPENCV_FFMPEG_DEBUG"):
            surroundings.pop(option, None)
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(Path(decoder.__file__)), json.dumps([task, *arguments])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=surroundings,
            pipesize=PIPE,
            start_new_session=True,  # Ctrl-C is for the process that asks
        )

    def ask(self, request: Any = None) -> None:
        """Ask for a picture; that there is no process any more comes out in its answer."""
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):
            self._process.stdin.write(json.dumps(request).encode() + b"\n")
            self._process.stdin.flush()

    def answer(self, timeout: float | None = None) -> Answer | None:
        """The next answer; ``None`` after so many seconds, and when the process has ended."""
        stream = self._process.stdout
        assert isinstance(stream, io.BufferedReader)
        with suppress(ValueError):  # closed meanwhile
            if timeout is not None and not select.select([stream], [], [], timeout)[0]:
                return None
            line = stream.readline()
            if not line.endswith(b"\n"):
                return None
            fields = json.loads(line)
            shape = fields.pop("shape")
            if shape is None:
                return Answer(**fields)
            image = np.empty((*shape, 3), np.uint8)
            if stream.readinto(image.data.cast("B")) == image.nbytes:
                return Answer(image, **fields)
        return None

    def close(self) -> None:
        """End the process, whatever it is at."""
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            with suppress(OSError):
                stream.close()
