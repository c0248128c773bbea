"""A page on this machine: the window's canvas, live, and its readings as a table."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import os
import socket
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from matplotlib.backends.backend_webagg_core import FigureCanvasWebAggCore, FigureManagerWebAgg
from matplotlib.figure import Figure
from tornado.httpserver import HTTPServer
from tornado.httputil import split_host_and_port
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from designopt.errors import UserError
from designopt.explore.bench import Bench, Reading, number_text
from designopt.explore.face import DPI, HEIGHT, WIDTH
from designopt.explore.frames import SIDE, Pixels, change, pixels_of, png
from designopt.explore.messages import LONGEST, Message, PixelRatio, Pointer, Signal, read_message
from designopt.explore.window import Window

ADDRESS = "127.0.0.1"
HOSTS = (ADDRESS, "localhost")
"""What a browser on this machine calls it; another name is another site's, led here."""

LEAST_RATIO, GREATEST_RATIO = 0.25, 4.0
"""Pixels of the picture per pixel of the page; a screen with more gets the picture enlarged."""

NOWHERE = Pointer(type="button_release", x=-1e6, y=-1e6, button=0, buttons=0)
"""A mouse button that is let go where there is nothing to press."""

LOG = logging.getLogger("designopt.explore")

HEADERS = {
    "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' blob: data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


def listen(port: int) -> socket.socket:
    """A socket that listens on this machine's loopback alone.

    Args:
        port: 0 takes any that is free.

    Raises:
        UserError: the port cannot be had.
    """
    try:
        listener = socket.create_server((ADDRESS, port))
    except OSError as error:
        reason = os.strerror(error.errno or 0)
        raise UserError(f"--port {port}: {reason}; choose another, or 0 for any free") from error
    listener.setblocking(False)
    return listener


def serve(bench: Bench, name: str, folder: Path, listener: socket.socket) -> None:
    """Show a bench on a page until interrupted; the page's address is printed when it is ready.

    Args:
        bench: with its knobs.
        name: of the saved pictures.
        folder: where pictures and specs are saved.
        listener: see `listen`.
    """
    asyncio.run(_serve(bench, name, folder, listener))


async def _serve(bench: Bench, name: str, folder: Path, listener: socket.socket) -> None:
    page = Page(bench, name, folder)
    gc.freeze()  # to look through all that is here by now takes longer than to show a move
    server = HTTPServer(page.application())
    server.add_socket(listener)
    port = listener.getsockname()[1]
    print(f"{bench.title}: http://{ADDRESS}:{port}/ (Ctrl-C ends it)", flush=True)
    try:
        await asyncio.Event().wait()
    finally:
        server.stop()
        while page.tabs:
            page.tabs.pop().close()


class Page:
    """A window that any number of browser tabs share.

    Attributes:
        title: of the page.
        window: what is shown.
        canvas: what it is drawn on.
        manager: Matplotlib's link between the canvas and the tabs.
        tabs: the tabs that are open.
        picture: counts the pictures drawn so far.
        news: the readings and the message, as they were last sent.
    """

    def __init__(self, bench: Bench, name: str, folder: Path) -> None:
        self.title = bench.title
        self.tabs: set[Tab] = set()
        self.picture = 0
        self.news: dict[str, Any] = {}
        self._pressed_by: Tab | None = None
        figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=DPI)
        self.canvas = FigureCanvasWebAggCore(figure)
        self.manager = _Manager(self.canvas, self)
        self.manager.set_window_title(bench.title)
        self.window = Window(bench, figure, name, folder, self._tell)

    def application(self) -> Application:
        """The web application."""
        return Application(
            [
                (r"/", _Html, {"page": self}),
                (r"/(mpl|explore)\.js", _Script),
                (r"/ws", Tab, {"page": self}),
            ],
            log_function=lambda _: None,
            websocket_max_message_size=LONGEST,
        )

    def drawn(self) -> None:
        """Send what was drawn to all tabs."""
        self.picture += 1
        for tab in self.tabs:
            tab.send_picture()

    def point(self, tab: Tab, pointer: Pointer, scale: float) -> None:
        """Let a tab's mouse do something, unless another tab holds a button down.

        Args:
            tab: it.
            pointer: what its mouse does.
            scale: pixels of the picture per pixel of its screen.
        """
        if pointer.type == "button_press":
            self.let_go()  # of a button whose release was lost, or of another tab's
            self._pressed_by = tab
        elif self._pressed_by not in (None, tab):
            return
        elif pointer.type == "button_release":
            self._pressed_by = None
        event = pointer.model_dump() | {"x": pointer.x * scale, "y": pointer.y * scale}
        self.canvas.handle_event(event | {"modifiers": []})

    def let_go(self, tab: Tab | None = None) -> None:
        """End what a mouse button holds, if any; with a tab, only if it is that tab's."""
        holder = self._pressed_by
        if holder is not None and tab in (None, holder):
            self.point(holder, NOWHERE, 1.0)

    def _tell(self, readings: Sequence[Reading], message: str) -> None:
        rows = [(each.name, number_text(each.value), each.unit) for each in readings]
        self.news = {"type": "readings", "rows": rows, "message": message}
        for tab in self.tabs:
            tab.send_json(self.news)


class _Manager(FigureManagerWebAgg):
    """Every tab is sent what is new for it, when it has shown what it was sent before."""

    def __init__(self, canvas: FigureCanvasWebAggCore, page: Page) -> None:
        self._page = page
        super().__init__(canvas, 1)
        if self.key_press_handler_id is not None:
            canvas.mpl_disconnect(self.key_press_handler_id)  # no toolbar, no shortcuts for it

    def refresh_all(self) -> None:
        self._page.drawn()


class _Guarded(RequestHandler):
    """Answers nobody but this machine's own pages."""

    def prepare(self) -> None:
        host, _ = split_host_and_port(self.request.host.lower())
        if host not in HOSTS:
            raise HTTPError(403)

    def set_default_headers(self) -> None:
        for name, value in HEADERS.items():
            self.set_header(name, value)


class _Html(_Guarded):
    def initialize(self, page: Page) -> None:
        self._page = page

    def get(self) -> None:
        template = jinja2.Environment(autoescape=True).from_string(_resource("explore.html.j2"))
        self.write(template.render(title=self._page.title, width=WIDTH, height=HEIGHT))


class _Script(_Guarded):
    def get(self, name: str) -> None:
        self.set_header("Content-Type", "text/javascript; charset=utf-8")
        script = _resource("explore.js") if name == "explore" else _Manager.get_javascript()
        self.write(script or "")


class Tab(_Guarded, WebSocketHandler):
    """One browser tab; Tornado refuses those of pages from elsewhere."""

    def initialize(self, page: Page) -> None:
        """Nothing of the page has been sent yet."""
        self._page = page
        self._ratio = 1.0
        self._warned = False
        self._seen: Pixels | None = None
        self._sent, self._busy = -1, False

    def open(self) -> None:
        """Show the window as it stands."""
        self.set_nodelay(True)
        self._page.tabs.add(self)
        self._page.manager.add_web_socket(self)
        self.send_json(self._page.news)

    def on_close(self) -> None:
        """Forget the tab."""
        self._page.tabs.discard(self)
        self._page.manager.web_sockets.discard(self)
        self._page.let_go(self)

    def on_message(self, message: str | bytes) -> None:
        """Take what the page's script sends; see Matplotlib's ``mpl.js``."""
        try:
            known = read_message(message)
        except ValueError as error:
            if not self._warned:  # once, however many there are
                LOG.warning("a tab sent what is no message of this page; ignored: %s", error)
                self._warned = True
            return
        self._take(known)

    def _take(self, message: Message) -> None:
        match message:
            case Signal(type="ack"):
                self._busy = False
                self.send_picture()
            case Signal(type="refresh" | "resize"):  # the canvas is new, or was cleared
                self._seen, self._sent = None, -1
                self.send_picture()
            case Signal(type="draw"):
                self._seen, self._sent = None, -1  # the page waits for a picture, come what may
                self._page.canvas.draw()
            case PixelRatio(device_pixel_ratio=ratio):
                self._ratio = ratio
                ratio = min(max(ratio, LEAST_RATIO), GREATEST_RATIO)
                self._page.canvas.handle_event(message.model_dump() | {"device_pixel_ratio": ratio})
            case Pointer():
                self._page.point(self, message, self._page.canvas.device_pixel_ratio / self._ratio)

    def send_json(self, content: Mapping[str, Any]) -> None:
        """Send a message for the page's script."""
        self._write(json.dumps(content))

    def send_binary(self, data: bytes) -> None:
        """Send a picture, over the last one or instead of it."""
        self._write(data)

    def _write(self, message: str | bytes) -> None:
        with suppress(WebSocketClosedError):  # it is just being closed
            written = self.write_message(message, binary=isinstance(message, bytes))
            # The tab may be gone before it is written, which is no news to anyone.
            written.add_done_callback(lambda done: done.cancelled() or done.exception())

    def send_picture(self) -> None:
        """Send what this tab lacks of the picture, unless it is still busy with the last one."""
        if self._busy or self._sent == self._page.picture:
            return
        self._sent = self._page.picture
        pixels = pixels_of(np.asarray(self._page.canvas.buffer_rgba()))
        if self._seen is None or self._seen.shape != pixels.shape:
            self._seen, changed = pixels.copy(), change(pixels, None)
        else:
            changed = change(pixels, self._seen)
            np.copyto(self._seen, pixels)
        if changed is None:
            return
        self._busy = True
        places = {"side": SIDE, "across": changed.across, "places": changed.places.tolist()}
        self.send_json({"type": "squares", "size": pixels.shape[::-1], **places})
        self.send_binary(png(changed.pixels))


def _resource(name: str) -> str:
    return (files("designopt") / "templates" / name).read_text(encoding="utf-8")
