"""The page's server: on this machine's loopback, for whoever has the token, for a few tabs."""

from __future__ import annotations

import asyncio
import gc
import html
import json
import os
import secrets
import socket
import tempfile
import webbrowser
from collections.abc import Hashable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.httputil import split_host_and_port
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from designopt.errors import UserError
from designopt.explore.explorer import Explorer
from designopt.explore.messages import LONGEST, MessageError, Signal, read_message
from designopt.explore.session import Session
from designopt.explore.wire import Wire
from designopt.explore.worker import Worker

ADDRESS = "127.0.0.1"
HOSTS = (ADDRESS, "localhost")
"""What a browser on this machine calls it; another name is another site's, led here."""

MOST_TABS = 8
GRACE = 3.0
"""Seconds after the last tab has closed in which one may come back, as a reloaded one does."""

MOST_UNANSWERED = 6
"""Messages that a tab may leave unanswered before it is sent no more until it has caught up."""

TOO_MANY, NO_MESSAGE = 4008, 1008
"""Codes with which a connection is closed; the second is RFC 6455's for a violated policy."""

HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript"}
RELOADED = """<!doctype html>
<html lang="en"><title>designopt explore</title><link rel="icon" href="data:,">
<meta http-equiv="refresh" content="0; url={}">
"""


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


def serve(explorer: Explorer, folder: Path, listener: socket.socket, *, browser: bool) -> None:
    """Show a design on a page until its last tab has closed, or until interrupted.

    Args:
        explorer: the design.
        folder: where files are saved.
        listener: see `listen`.
        browser: whether to open the page in the person's browser; its address is printed otherwise,
            and where there is none.
    """
    workers = list[Worker]()
    try:
        asyncio.run(_serve(explorer, folder, listener, browser, workers))
        for worker in workers:  # Python must not be taken down around what XLA compiles
            worker.join()
    except KeyboardInterrupt:
        owing = [worker for worker in workers if worker.owes]
        if owing:
            print("saving what was asked for; Ctrl-C again ends at once", flush=True)
        for worker in owing:
            worker.join()
        raise


async def _serve(
    explorer: Explorer,
    folder: Path,
    listener: socket.socket,
    browser: bool,
    workers: list[Worker],
) -> None:
    gc.freeze()  # to look through all that is here by now takes longer than to show a move
    site = Site(explorer, folder, listener.getsockname()[1])
    server = HTTPServer(site.application())
    server.add_socket(listener)
    title = explorer.design.title
    try:
        with _redirect_file(site.address) as file:
            if browser and await asyncio.to_thread(_open, file.as_uri()):
                print(
                    f"{title}: in your browser; close the page or press Ctrl-C to end", flush=True
                )
            else:
                print(f"{title}: {site.address} (Ctrl-C ends it)", flush=True)
            await site.deserted.wait()
    finally:
        server.stop()
        site.close()
        workers += site.session.end()


@contextmanager
def _redirect_file(address: str) -> Iterator[Path]:
    """A file that leads to an address, for this user's eyes: command lines are for everyone's."""
    with tempfile.TemporaryDirectory(prefix="designopt-") as folder:
        path = Path(folder) / "open.html"
        path.touch(mode=0o600)
        path.write_text(RELOADED.format(html.escape(address)), encoding="utf-8")
        yield path


def _open(address: str) -> bool:
    """Open an address in a browser with windows; returns whether there is one."""
    try:
        found = webbrowser.get()
    except webbrowser.Error:
        return False
    in_terminal = type(found) is webbrowser.GenericBrowser and "BROWSER" not in os.environ
    return not in_terminal and found.open(address)


class Site:
    """The pages of one session.

    Attributes:
        token: whoever has it may come in.
        cookie: name of the cookie that holds it.
        address: with the token.
        session: what the tabs share.
        tabs: the tabs that are open.
        deserted: set when the last tab has closed for good.
    """

    def __init__(self, explorer: Explorer, folder: Path, port: int) -> None:
        self.token = secrets.token_urlsafe(32)
        self.cookie = f"designopt-{port}"
        self.address = f"http://{ADDRESS}:{port}/?token={self.token}"
        self.tabs: set[Tab] = set()
        self.deserted = asyncio.Event()
        self.session = Session(explorer, folder, self._send)

    def application(self) -> Application:
        """The web application."""
        folder = files("designopt") / "explore" / "page"
        pages = {one.name: one.read_bytes() for one in folder.iterdir() if one.is_file()}
        return Application(
            [
                (r"/", _Entrance, {"site": self, "pages": pages}),
                (r"/open", _Opened, {"site": self}),
                (r"/page/([a-z]+\.[a-z]+)", _File, {"site": self, "pages": pages}),
                (r"/ws", Tab, {"site": self}),
                (r".*", _Missing, {"site": self}),
            ],
            log_function=lambda _: None,
            websocket_max_message_size=LONGEST,
        )

    def leave(self, tab: Tab) -> None:
        """Forget a tab; after the last the page ends, unless one comes back soon."""
        self.tabs.discard(tab)
        self.session.seqs.pop(tab, None)
        if not self.tabs:
            asyncio.get_running_loop().call_later(GRACE, self._end_if_deserted)

    def close(self) -> None:
        """Close all tabs."""
        while self.tabs:
            self.tabs.pop().close(1001, "the command has ended")

    def _end_if_deserted(self) -> None:
        if not self.tabs:
            self.deserted.set()

    def _send(self, fields: Wire, shown: Mapping[Hashable, int] | None) -> None:
        if not fields and not shown:
            return
        text = json.dumps(fields, allow_nan=False)
        for tab in self.tabs:
            seqs = {"seq": self.session.seqs.get(tab, 0)}
            if shown is not None:
                seqs["shown"] = shown.get(tab, 0)
            tab.send(text, seqs)


class _Guarded(RequestHandler):
    """Answers this machine's own pages, and of them those with the cookie."""

    def initialize(self, site: Site, pages: Mapping[str, bytes] | None = None) -> None:
        self._site, self._pages = site, pages or {}

    def set_default_headers(self) -> None:
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        host, _ = split_host_and_port(self.request.host.lower())
        if host not in HOSTS:
            raise HTTPError(403)
        self._check(self.get_cookie(self._site.cookie) or "")

    def _check(self, token: str) -> None:
        if not secrets.compare_digest(token.encode(), self._site.token.encode()):
            raise HTTPError(403)

    def write_error(self, status_code: int, **_: Any) -> None:
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(
            "Open this page by the address that 'designopt explore --no-browser' prints.\n"
            if status_code == 403
            else f"{status_code}: there is nothing here.\n"
        )

    def _finish_page(self, name: str) -> None:
        if name not in self._pages:
            raise HTTPError(404)
        kind = TYPES[name.partition(".")[2]]
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.finish(self._pages[name])


class _Entrance(_Guarded):
    """The page; whoever brings the token is given the cookie, and the address loses the token."""

    def _check(self, token: str) -> None:
        super()._check(self.get_query_argument("token", token))

    def get(self, *_: str) -> None:
        token = self.get_query_argument("token", None)
        if token is None:
            self._finish_page("index.html")
            return
        self.set_cookie(self._site.cookie, token, httponly=True, samesite="Strict")
        self.redirect("/open")


class _Opened(_Guarded):
    """Leads to the page: a strict cookie is sent only where a page of this site leads."""

    def _check(self, token: str) -> None:
        pass

    def get(self, *_: str) -> None:
        self.finish(RELOADED.format("/"))


class _Missing(_Guarded):
    def get(self) -> None:
        raise HTTPError(404)


class _File(_Guarded):
    def get(self, *names: str) -> None:
        self._finish_page(names[0])


class Tab(_Guarded, WebSocketHandler):
    """One browser tab; Tornado refuses those of pages from elsewhere."""

    def open(self, *_: str, **__: str) -> None:
        """Show the design as it stands."""
        self._unanswered, self._is_behind = 0, False
        if len(self._site.tabs) >= MOST_TABS:
            self.close(TOO_MANY, f"{MOST_TABS} tabs are open already; close one, and reload this")
            return
        self.set_nodelay(True)
        self._site.tabs.add(self)
        self._send_model()

    def on_close(self) -> None:
        """Forget the tab."""
        if self in self._site.tabs:
            self._site.leave(self)

    def on_message(self, message: str | bytes) -> None:
        """Do what the page asks for; the connection ends if no page asks for such a thing."""
        if self not in self._site.tabs:
            return
        try:
            known = read_message(message)
            if known == Signal(type="ack"):
                self._answered()
            else:
                self._site.session.take(self, known)
        except MessageError as error:
            self._site.leave(self)
            self.close(NO_MESSAGE, str(error))

    def send(self, fields: str, seqs: Mapping[str, int]) -> None:
        """Send fields of the model, as JSON; a tab that does not keep up gets all of them later."""
        # What has changed is sent, so that after one message is left out no other can follow it.
        if self._is_behind or self._unanswered >= MOST_UNANSWERED:
            self._is_behind = True
            return
        self._unanswered += 1
        text = f'{{"fields":{fields},"seqs":{json.dumps(seqs)}}}'
        with suppress(WebSocketClosedError):  # it is just being closed
            written = self.write_message(text)
            # The tab may be gone before it is written, which is no news to anyone.
            written.add_done_callback(lambda done: done.cancelled() or done.exception())

    def _answered(self) -> None:
        self._unanswered = max(0, self._unanswered - 1)
        if self._is_behind and self._unanswered <= 0:
            self._is_behind = False
            self._send_model()

    def _send_model(self) -> None:
        session = self._site.session
        seq = session.seqs.get(self, 0)
        self.send(json.dumps(session.whole(), allow_nan=False), {"seq": seq, "shown": seq})
