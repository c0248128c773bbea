"""The page's server: on loopback, for its own pages only, a picture for every tab."""

import asyncio
import gc
import io
import json
import logging
import socket
import struct

import numpy as np
import pytest
from PIL import Image
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.httpserver import HTTPServer
from tornado.websocket import websocket_connect

from designopt.errors import UserError
from designopt.explore.face import HEIGHT, WIDTH
from designopt.explore.messages import LONGEST, read_message
from designopt.explore.server import Page, listen
from designopt.explore.window import PICTURE
from designopt.plot.figures import style
from tests.designopt.explore.hands import on_button, on_track, put_squares
from tests.designopt.explore.toy import SliderCrank, place
from tests.designopt.tables import cases
from tests.mutations import mutate


@pytest.fixture
def visit(tmp_path):
    """Run a coroutine that is given the page and the port it is served at."""

    def run(guest):
        async def main():
            page = Page(SliderCrank(), "toy", tmp_path)
            listener = listen(0)
            server = HTTPServer(page.application())
            server.add_socket(listener)
            try:
                await asyncio.wait_for(guest(page, listener.getsockname()[1]), 60)
            finally:
                while BROWSERS:
                    await BROWSERS[-1].closed()
                server.stop()
                await server.close_all_connections()

        with style():
            asyncio.run(main())

    return run


def test_it_listens_on_loopback_alone():
    with listen(0) as listener:
        address, port = listener.getsockname()
        assert address == "127.0.0.1"
        with pytest.raises(UserError, match=r"--port \d+: .*in use; choose another, or 0"):
            listen(port)


def test_the_page_and_its_scripts_load(visit):
    async def guest(page, port):
        client = AsyncHTTPClient()
        html = (await client.fetch(f"http://127.0.0.1:{port}/")).body.decode()
        assert "<title>slider-crank</title>" in html
        for name, words in (("mpl", "mpl.figure"), ("explore", "handle_readings")):
            assert f'src="{name}.js"' in html
            script = await client.fetch(f"http://localhost:{port}/{name}.js")
            assert words in script.body.decode()
        assert "//" not in html.replace("<!doctype html>", "")  # nothing from elsewhere

    visit(guest)


async def is_forbidden(answer):
    with pytest.raises(HTTPClientError) as caught:
        await answer
    return caught.value.code == 403


def test_names_and_pages_of_other_sites_are_refused(visit):
    async def guest(page, port):
        for host in ("evil.example", f"evil.example:{port}", "127.0.0.1.evil.example"):
            for path in ("", "explore.js", "ws"):
                url = f"http://127.0.0.1:{port}/{path}"
                asked = AsyncHTTPClient().fetch(HTTPRequest(url, headers={"Host": host}))
                assert await is_forbidden(asked), (host, path)
        for origin in ("http://evil.example", "http://localhost:1", "null"):
            asked = HTTPRequest(f"ws://127.0.0.1:{port}/ws", headers={"Origin": origin})
            assert await is_forbidden(websocket_connect(asked)), origin
        assert not page.tabs

    visit(guest)


BROWSERS = []


class Browser:
    """A tab without a screen: it puts the pictures together and keeps the readings."""

    def __init__(self, connection):
        self.connection = connection
        self.news = {}
        self.picture = np.zeros((1, 1, 4), np.uint8)
        self.pictures = 0
        self._squares = {}

    @classmethod
    async def opened(cls, port, acknowledge=True):
        """A tab that has its first picture."""
        url = f"ws://127.0.0.1:{port}/ws"
        request = HTTPRequest(url, headers={"Origin": f"http://127.0.0.1:{port}"})
        tab = cls(await websocket_connect(request))
        BROWSERS.append(tab)
        await tab.send("set_device_pixel_ratio", device_pixel_ratio=1)
        await tab.send("refresh")
        await tab.look(lambda tab: tab.pictures, acknowledge)
        return tab

    async def closed(self):
        BROWSERS.remove(self)
        self.connection.close(1001)  # as browsers do
        while await self.connection.read_message() is not None:
            pass

    async def send(self, kind, **content):
        await self.connection.write_message(json.dumps({"type": kind, **content}))

    async def mouse(self, kind, place, buttons=1):
        x, y = place
        await self.send(
            kind, x=x, y=HEIGHT - y, button=0, buttons=buttons, modifiers=[], step=0, guiEvent={}
        )

    async def look(self, until, acknowledge=True):
        """Take what comes until a condition holds."""
        while not until(self):
            message = await self.connection.read_message()
            assert message is not None
            if isinstance(message, bytes):
                self._put(np.array(Image.open(io.BytesIO(message)).convert("RGBA")))
                self.pictures += 1
                if acknowledge:
                    await self.send("ack")
            else:
                content = json.loads(message)
                if content["type"] == "squares":
                    self._squares = content
                if content["type"] == "readings":
                    self.news = content

    def _put(self, image):
        wide, tall = self._squares["size"]
        if self.picture.shape[:2] != (tall, wide):  # the first picture of a size is whole
            self.picture = np.zeros((tall, wide, 4), np.uint8)
        put_squares(self.picture, image, self._squares["places"], self._squares["across"])

    @property
    def place(self):
        return self.news["rows"][0][1]


def drawn(page):
    return np.asarray(page.canvas.buffer_rgba())


def test_a_slider_moved_in_one_tab_moves_in_all(visit):
    async def guest(page, port):
        first, second = await Browser.opened(port), await Browser.opened(port)
        for tab in (first, second):
            assert tab.picture.shape == (HEIGHT, WIDTH, 4)
            assert tab.place == f"{place(page.window.values):.6g}"
            np.testing.assert_array_equal(tab.picture, drawn(page))
        row, before = page.window.rows[0], first.place
        await first.mouse("button_press", on_track(row, 0.5))
        await first.mouse("motion_notify", on_track(row, 0.6))
        await first.mouse("button_release", on_track(row, 0.6), 0)
        await first.look(lambda _: page.window.values["crank"] > 0.58 * 360)
        for tab in (first, second):
            await tab.look(lambda tab: tab.place == f"{place(page.window.values):.6g}")
            await tab.look(lambda tab: (tab.picture == drawn(page)).all())
            assert tab.place != before

    visit(guest)


def test_a_busy_tab_is_spared_and_catches_up(visit):
    async def guest(page, port):
        quick, slow = await Browser.opened(port), await Browser.opened(port, acknowledge=False)
        row = page.window.rows[1]
        await quick.mouse("button_press", on_track(row, 0.1))
        for fraction in (0.3, 0.5, 0.7, 0.9):
            before = quick.pictures
            await quick.mouse("motion_notify", on_track(row, fraction))
            await quick.look(lambda tab, before=before: tab.pictures > before)
        await slow.look(lambda tab: tab.place == f"{place(page.window.values):.6g}", False)
        assert slow.pictures == 1
        await slow.send("ack")
        await slow.look(lambda tab: tab.pictures == 2)
        np.testing.assert_array_equal(slow.picture, drawn(page))

    visit(guest)


@pytest.mark.parametrize(("ratio", "drawn_ratio"), [(1.5, 1.5), (10, 2)])
def test_a_sharper_screen_gets_a_sharper_picture_up_to_a_bound(
    visit, monkeypatch, ratio, drawn_ratio
):
    """Beyond it the browser enlarges the picture."""
    monkeypatch.setattr("designopt.explore.server.GREATEST_RATIO", 2.0)

    async def guest(page, port):
        tab = await Browser.opened(port)
        await tab.send("set_device_pixel_ratio", device_pixel_ratio=ratio)
        await tab.send("draw")
        size = (drawn_ratio * HEIGHT, drawn_ratio * WIDTH, 4)
        await tab.look(lambda tab: tab.picture.shape == size)
        x, y = (place * ratio / drawn_ratio for place in on_track(page.window.rows[0], 0.25))
        await tab.send("button_press", x=x, y=ratio * HEIGHT - y, button=0, buttons=1)
        before = tab.place
        await tab.look(lambda tab: tab.place != before)
        assert tab.place == f"{place(page.window.values):.6g}"
        assert page.window.values["crank"] == pytest.approx(90, abs=5)

    visit(guest)


def test_what_a_page_does_not_send_changes_nothing(visit):
    async def guest(page, port):
        tab = await Browser.opened(port)
        before = drawn(page).copy()
        await tab.send("toolbar_button", name="save_figure")
        await tab.send("resize", width=10, height=10)
        await tab.look(lambda tab: tab.pictures == 2)
        np.testing.assert_array_equal(tab.picture, before)

    visit(guest)


NONSENSE = (*cases("no_message"), "[" * 30_000, b"\xff\x00")


@pytest.mark.parametrize("message", NONSENSE, ids=range(len(NONSENSE)))
def test_nonsense_is_no_message_and_the_fault_fits_in_a_line_of_the_log(message):
    with pytest.raises(ValueError, match=r"\w") as caught:
        read_message(message)
    line = str(caught.value)
    assert line.isascii()
    assert line.isprintable()
    assert len(line) < 150


def test_a_mouse_button_pressed_in_a_second_tab_takes_the_first_ones_place(visit):
    async def guest(page, port):
        first, second = await Browser.opened(port), await Browser.opened(port)
        crank, radius = page.window.rows[:2]
        await first.mouse("button_press", on_track(crank, 0.5))
        await first.mouse("motion_notify", on_track(crank, 0.25))
        await first.look(lambda _: page.window.values["crank"] < 0.3 * 360)
        await second.mouse("button_press", on_track(radius, 0.9))
        await second.look(lambda _: page.window.values["radius"] > 70)
        await first.mouse("motion_notify", on_track(crank, 0.75))
        await second.closed()  # without letting go
        await first.mouse("motion_notify", on_track(radius, 0.1))
        await first.mouse("button_press", on_track(crank, 0.4))
        await first.look(lambda _: page.window.values["crank"] > 0.35 * 360)
        assert page.window.values["crank"] == pytest.approx(0.4 * 360, abs=5)
        assert page.window.values["radius"] > 70

    visit(guest)


def messages(count):
    """Messages of a page, most of them with something wrong in them."""
    rng = np.random.default_rng(0)
    types = ("button_press", "button_release", "motion_notify", "figure_leave", "refresh", "scroll")
    for _ in range(count):
        content = {"type": str(rng.choice(types)), "x": rng.uniform(-50, WIDTH), "y": 99.0}
        content |= {"button": int(rng.integers(5)), "buttons": int(rng.integers(32))}
        mutate(content, rng)
        yield json.dumps(content)


FRAMES = (
    b"\x81\xff" + struct.pack("!Q", 2**62) + b"mask",  # longer than any memory
    b"\xf1\x80mask",  # a reserved bit
    b"\x88\x81mask0",
    b"",
)
RESET = struct.pack("ii", 1, 0)
"""Lingering switched on, for no time: closing resets the connection."""


async def send_frame(port, frame):
    """Open a tab, send bytes that need not be a frame, and break the connection off."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(
        f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
        + frame
    )
    await reader.read(100)
    writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
    writer.close()


def test_no_message_harms_another_tab(visit, caplog):
    failed = []

    async def guest(page, port):
        asyncio.get_running_loop().set_exception_handler(lambda _, context: failed.append(context))
        other, hostile = await Browser.opened(port), await Browser.opened(port)
        for message in (*NONSENSE, *messages(400)):
            await hostile.connection.write_message(message, isinstance(message, bytes))
        seen = hostile.pictures
        await hostile.send("refresh")
        await hostile.look(lambda tab: tab.pictures > seen)
        await hostile.connection.write_message("9" * (LONGEST + 1))  # it is closed for this
        await hostile.closed()
        for frame in FRAMES:
            await send_frame(port, frame)
        await other.send("draw")
        row = page.window.rows[0]
        for fraction in (0.3, 0.7):
            await other.mouse("button_press", on_track(row, fraction))
            await other.mouse("button_release", on_track(row, fraction), 0)
            await other.look(lambda tab, wanted=fraction: abs(row.value / 360 - wanted) < 0.02)
        await other.look(lambda tab: (tab.picture == drawn(page)).all())
        assert len(page.tabs) == 1
        gc.collect()  # a task that failed is told of when it goes

    visit(guest)
    assert not failed
    [warning] = [record for record in caplog.records if "no message of this page" in record.message]
    assert {record.name for record in caplog.records} == {"designopt.explore"}
    assert max(record.levelno for record in caplog.records) == warning.levelno == logging.WARNING


def test_a_button_is_pressed_and_the_message_comes(visit, tmp_path):
    async def guest(page, port):
        tab = await Browser.opened(port)
        await tab.mouse("button_press", on_button(page.window, PICTURE))
        await tab.mouse("button_release", on_button(page.window, PICTURE), 0)
        await tab.look(lambda tab: tab.news["message"].startswith("Saved toy-1.png and toy-1.svg"))
        assert (tmp_path / "toy-1.png").is_file()

    visit(guest)
