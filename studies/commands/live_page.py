"""The page of ``designopt see --live``: the picture with what is found in it, angles and pads.

Pictures are drawn and compressed when a browser asks for them, of the frame that is newest then.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

import cv2
import jax
import numpy as np

from designopt.errors import UserError
from studies.commands.overlay import difference_picture, draw_overlay, draw_pad
from studies.commands.records import Seen, document_of
from studies.models.sensor.reading import Reader

ADDRESS = "127.0.0.1"
HOSTS = (ADDRESS, "localhost")
"""What a browser on this machine calls it; another name is another site's, led here."""

WIDEST = 960
"""Columns of the picture on the page."""

HEADERS = {
    "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; "
    "script-src 'self' 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}

BOUNDARY = "frame"


class LivePage:
    """What the page shows: the newest frame.

    Attributes:
        address: of the page.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._reader: Reader | None = None
        self._seen: Seen | None = None
        self._shown: Seen | None = None
        self._one = threading.Lock()
        self._summary, self._count, self._has_ended = "", 0, False
        self._changed = threading.Condition()

    def begin(self, reader: Reader) -> None:
        """Take what frames are read by, before the first is shown."""
        self._reader = reader

    def show(self, seen: Seen, summary: str) -> None:
        """Show a frame, and a line on all frames so far."""
        with self._changed:
            self._seen, self._summary, self._count = seen, summary, self._count + 1
            self._changed.notify_all()

    def stay(self) -> None:
        """Return with an interrupt."""
        with suppress(KeyboardInterrupt):
            threading.Event().wait()

    def end(self) -> None:
        """Let those go who wait for a frame."""
        with self._changed:
            self._has_ended = True
            self._changed.notify_all()

    def pictures(self) -> Iterator[bytes]:
        """JPEGs of the newest frame, whenever there is a newer one."""
        count = 0
        while True:
            with self._changed:
                self._changed.wait_for(lambda now=count: self._count > now or self._has_ended)
                if self._has_ended:
                    return
                seen, count = self._seen, self._count
            assert seen is not None
            assert self._reader is not None
            yield _jpeg(_fitting(draw_overlay(seen, self._reader.joints, self._reader.pads)))

    def reading(self) -> dict[str, Any]:
        """The newest frame's record with its pads, and a line on all frames."""
        seen, summary = self._newest(), self._summary
        if seen is None or self._reader is None:
            return {"summary": "waiting for the first frame", "pads": [], "record": {}}
        record = document_of(seen, self._reader.joints)
        return {"summary": summary, "pads": self._reader.pads, "record": record}

    def pad(self, number: int) -> bytes | None:
        """JPEG of a pad beside its difference, as `reading` had it; ``None`` where it has none."""
        seen = self._shown
        if seen is None or self._reader is None or not 0 <= number < len(self._reader.pads):
            return None
        shown = seen.pads.get(self._reader.pads[number])
        if shown is None:
            return None
        parts = [draw_pad(shown)]
        if shown.difference is not None:
            parts.append(difference_picture(shown.difference))
        return _jpeg(np.hstack(parts))

    def _newest(self) -> Seen | None:
        """The newest frame with its pads, which are read here if the loop does not."""
        with self._one:
            seen = self._seen
            if seen is None or self._reader is None:
                return None
            if self._shown is None or self._shown.frame is not seen.frame:
                if not seen.pads:
                    with jax.enable_x64(True):
                        pads = self._reader.read_pads(seen.frame.image, seen.reading)
                    seen = seen._replace(pads=pads)
                self._shown = seen
            return self._shown


@contextmanager
def live_page(port: int) -> Iterator[LivePage]:
    """A page on this machine's loopback, served in threads until the end.

    Args:
        port: 0 takes any that is free.

    Raises:
        UserError: the port cannot be had.
    """

    class Handler(_Handler):
        page: LivePage

    try:
        server = ThreadingHTTPServer((ADDRESS, port), Handler)
    except OSError as error:
        reason = os.strerror(error.errno or 0)
        raise UserError(f"--port {port}: {reason}; choose another, or 0 for any free") from error
    server.daemon_threads = True
    Handler.page = page = LivePage(f"http://{ADDRESS}:{server.server_port}/")
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        yield page
    finally:
        page.end()
        server.shutdown()
        server.server_close()


class _Handler(BaseHTTPRequestHandler):
    """Answers nobody but this machine's own browsers."""

    page: LivePage

    def do_GET(self) -> None:
        """Answer."""
        with suppress(OSError):  # the browser has gone
            self._answer()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Nothing."""

    def _answer(self) -> None:
        path = self.path.partition("?")[0]
        if self.headers.get("Host", "").rpartition(":")[0] not in HOSTS:
            self.send_error(403)
        elif path == "/":
            self._send("text/html; charset=utf-8", _html())
        elif path == "/reading.json":
            text = json.dumps(self.page.reading(), ensure_ascii=False)
            self._send("application/json", text.encode())
        elif path == "/frames.mjpeg":
            self._head(f"multipart/x-mixed-replace; boundary={BOUNDARY}")
            for data in self.page.pictures():
                head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}"
                self.wfile.write(f"{head}\r\n\r\n".encode() + data + b"\r\n")
        elif path.startswith("/pad/") and path[5:].isdecimal() and len(path) < 10:
            data = self.page.pad(int(path[5:]))
            if data is None:
                self.send_error(404)
            else:
                self._send("image/jpeg", data)
        else:
            self.send_error(404)

    def _send(self, kind: str, data: bytes) -> None:
        self._head(kind, len(data))
        self.wfile.write(data)

    def _head(self, kind: str, length: int | None = None) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        if length is not None:
            self.send_header("Content-Length", str(length))
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.end_headers()


def _html() -> bytes:
    return (files("studies.commands") / "live_page.html").read_bytes()


def _fitting(picture: np.ndarray) -> np.ndarray:
    """A picture no wider than the page has room for."""
    rows, columns, _ = picture.shape
    if columns <= WIDEST:
        return picture
    size = WIDEST, round(rows * WIDEST / columns)
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def _jpeg(picture: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes()
