"""A camera that serves MJPEG by HTTP from this machine, and does what cameras do when they fail."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import cv2
import numpy as np

ROWS, COLUMNS = 48, 64

BARS = 12
"""Bits of a picture's number that are drawn into it, a bar each."""


def picture(number: int, size: tuple[int, int] = (COLUMNS, ROWS)) -> np.ndarray:
    """A picture, BGR, into which its number is drawn, over a pattern that stays the same."""
    bits = [130 * (number >> bit & 1) for bit in range(BARS)]
    bars = cv2.resize(np.array([bits], np.uint8), size, interpolation=cv2.INTER_NEAREST)
    return bars[..., None] + _pattern(size)


@functools.cache
def _pattern(size: tuple[int, int]) -> np.ndarray:
    columns, rows = size
    return np.random.default_rng(0).integers(30, 90, (rows, columns, 3), np.uint8)


def number_of(image: np.ndarray) -> int:
    """The number that is drawn into a picture."""
    _, columns, _ = image.shape
    middles = ((np.arange(BARS) + 0.5) * columns / BARS).astype(int)
    bits = image[:, middles, 1].mean(axis=0) > 127
    return int(sum(1 << bit for bit, is_set in enumerate(bits) if is_set))


def jpeg(image: np.ndarray) -> bytes:
    """A picture as a camera sends it."""
    return cv2.imencode(".jpg", image)[1].tobytes()


class Camera:
    """A served camera; all that it does is set from outside, at any time.

    Attributes:
        pause: s between pictures.
        is_on: it answers; if not, every connection is broken off.
        is_silent: it sends no pictures, and keeps its connections.
        size: columns and rows.
        still: it sends this number again and again.
        spoil: what is done to a JPEG, by its number.
        sent: pictures sent, over all connections.
    """

    def __init__(self) -> None:
        self.pause, self.is_on, self.is_silent = 0.01, True, False
        self.size: tuple[int, int] = (COLUMNS, ROWS)
        self.still: int | None = None
        self.spoil: dict[int, Any] = {}
        self.sent = 0
        self.url = ""

    def stream(self, handler: BaseHTTPRequestHandler) -> None:
        """One connection, to its end."""
        if not self.is_on:
            return
        if handler.path == "/picture.jpg":
            data = jpeg(picture(5))
            self._head(handler, "image/jpeg", length=len(data))
            handler.wfile.write(data)
            return
        if handler.path != "/":
            handler.send_error(404)
            return
        self._head(handler, "multipart/x-mixed-replace; boundary=frame")
        while self.is_on:
            if not self.is_silent:
                number = self.sent if self.still is None else self.still
                data = jpeg(picture(number, self.size))
                data = self.spoil.get(number, lambda whole: whole)(data)
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                self.sent += 1
                handler.wfile.write(head.encode() + data + b"\r\n")
            time.sleep(self.pause)

    @staticmethod
    def _head(handler: BaseHTTPRequestHandler, kind: str, length: int | None = None) -> None:
        handler.send_response(200)
        handler.send_header("Content-Type", kind)
        if length is not None:
            handler.send_header("Content-Length", str(length))
        handler.end_headers()


@contextmanager
def serving() -> Iterator[Camera]:
    """A camera, on as long as the block runs."""
    camera = Camera()

    class Handler(BaseHTTPRequestHandler):
        disable_nagle_algorithm = True

        def do_GET(self) -> None:
            try:
                camera.stream(self)
            except OSError:
                return  # the other side has gone

        def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
            """Nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    camera.url = f"http://127.0.0.1:{server.server_port}/"
    try:
        yield camera
    finally:
        camera.is_on = False
        server.shutdown()
        thread.join()
        server.server_close()
