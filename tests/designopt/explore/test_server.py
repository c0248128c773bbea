"""The page's server: on loopback, for its own pages only, a picture for every tab."""

import asyncio
import gc
import io
import json
import logging
import random
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
from designopt.explore.messages import LONGEST
from designopt.explore.server import Page, listen
from designopt.explore.window import PICTURE
from designopt.plot.figures import style
from tests.designopt.explore.hands import on_button, on_track
from tests.designopt.explore.toy import SliderCrank, place


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


@pytest.mark.parametrize("path", ["", "explore.js", "ws"])
@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1.evil.example"])
def test_a_name_of_another_site_is_refused(visit, path, host):
    async def guest(page, port):
        request = HTTPRequest(
            f"http://127.0.0.1:{port}/{path}", headers={"Host": host.format(port=port)}
        )
        with pytest.raises(HTTPClientError) as caught:
            await AsyncHTTPClient().fetch(request)
        assert caught.value.code == 403

    visit(guest)


@pytest.mark.parametrize("origin", ["http://evil.example", "http://localhost:1", "null"])
def test_a_page_of_another_site_is_refused(visit, origin):
    async def guest(page, port):
        request = HTTPRequest(f"ws://127.0.0.1:{port}/ws", headers={"Origin": origin})
        with pytest.raises(HTTPClientError) as caught:
            await websocket_connect(request)
        assert caught.value.code == 403
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
    async def opened(cls, port):
        url = f"ws://127.0.0.1:{port}/ws"
        request = HTTPRequest(url, headers={"Origin": f"http://127.0.0.1:{port}"})
        tab = cls(await websocket_connect(request))
        BROWSERS.append(tab)
        await tab.send("set_device_pixel_ratio", device_pixel_ratio=1)
        await tab.send("refresh")
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
        side, across, places, (wide, tall) = (
            self._squares[name] for name in ("side", "across", "places", "size")
        )
        if self.picture.shape[:2] != (tall, wide):  # the first picture of a size is whole
            self.picture = np.zeros((tall, wide, 4), np.uint8)
        for number, (left, top) in enumerate(places):
            x, y = number % across * side, number // across * side
            square = image[y : y + side, x : x + side]
            self.picture[top : top + side, left : left + side] = square

    @property
    def place(self):
        return self.news["rows"][0][1]


def drawn(page):
    return np.asarray(page.canvas.buffer_rgba())


def test_a_slider_moved_in_one_tab_moves_in_all(visit):
    async def guest(page, port):
        first, second = await Browser.opened(port), await Browser.opened(port)
        for tab in (first, second):
            await tab.look(lambda tab: tab.pictures)
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
        quick, slow = await Browser.opened(port), await Browser.opened(port)
        await quick.look(lambda tab: tab.pictures)
        await slow.look(lambda tab: tab.pictures, acknowledge=False)
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


def test_a_sharper_screen_gets_a_sharper_picture(visit):
    async def guest(page, port):
        tab = await Browser.opened(port)
        await tab.look(lambda tab: tab.pictures)
        await tab.send("set_device_pixel_ratio", device_pixel_ratio=2)
        await tab.send("draw")
        await tab.look(lambda tab: tab.picture.shape == (2 * HEIGHT, 2 * WIDTH, 4))
        x, y = on_track(page.window.rows[0], 0.25)  # now in the pixels of that screen
        await tab.send("button_press", x=x, y=2 * HEIGHT - y, button=0, buttons=1, modifiers=[])
        before = tab.place
        await tab.look(lambda tab: tab.place != before)
        assert tab.place == f"{place(page.window.values):.6g}"
        assert page.window.values["crank"] == pytest.approx(90, abs=5)

    visit(guest)


def test_what_a_page_does_not_send_changes_nothing(visit, tmp_path):
    async def guest(page, port):
        tab = await Browser.opened(port)
        await tab.look(lambda tab: tab.pictures)
        before = drawn(page).copy()
        await tab.send("toolbar_button", name="save_figure")
        await tab.send("resize", width=10, height=10)
        await tab.look(lambda tab: tab.pictures == 2)
        np.testing.assert_array_equal(tab.picture, before)

    visit(guest)


NONSENSE = (
    "no JSON",
    "3",
    "[]",
    "{}",
    '{"type": 1}',
    '{"type": "motion_notify"}',
    '{"type": "button_press", "x": "a", "y": null, "button": 0, "buttons": 1}',
    '{"type": "button_press", "x": 1e400, "y": 0, "button": 0, "buttons": 1}',
    '{"type": "button_press", "x": 1, "y": 1, "button": "0", "buttons": 1}',
    '{"type": "set_device_pixel_ratio", "device_pixel_ratio": "4"}',
    '{"type": "set_device_pixel_ratio", "device_pixel_ratio": true}',
    '{"type": "set_device_pixel_ratio", "device_pixel_ratio": 0}',
    '{"type": "set_device_pixel_ratio", "device_pixel_ratio": NaN}',
    '{"type": "set_device_pixel_ratio", "device_pixel_ratio": 1e9}',
    '{"type": "\\u001b[31m\\n"}',
    "[" * 30_000,
    b"\xff\x00",
)


def test_nonsense_is_ignored_with_one_line_in_the_log(visit, caplog):
    async def guest(page, port):
        other = await Browser.opened(port)
        for message in NONSENSE:
            tab = await Browser.opened(port)
            await tab.look(lambda tab: tab.pictures)
            for _ in range(3):
                await tab.connection.write_message(message, binary=isinstance(message, bytes))
            await tab.send("refresh")
            await tab.look(lambda tab: tab.pictures == 2)
            await tab.closed()
        await other.send("draw")
        await other.look(lambda tab: tab.pictures == 2)
        np.testing.assert_array_equal(other.picture, drawn(page))

    visit(guest)
    assert len(caplog.messages) == len(NONSENSE)
    for line in caplog.messages:
        assert line.isascii()
        assert line.isprintable()
        assert len(line) < 200


def test_a_far_larger_picture_than_can_be_drawn_is_enlarged_by_the_browser(visit):
    async def guest(page, port):
        tab = await Browser.opened(port)
        await tab.look(lambda tab: tab.pictures)
        await tab.send("set_device_pixel_ratio", device_pixel_ratio=10)
        await tab.send("draw")
        await tab.look(lambda tab: tab.picture.shape == (4 * HEIGHT, 4 * WIDTH, 4))
        x, y = (place / 4 * 10 for place in on_track(page.window.rows[0], 0.25))
        await tab.send("button_press", x=x, y=10 * HEIGHT - y, button=0, buttons=1)
        before = tab.place
        await tab.look(lambda tab: tab.place != before)
        assert page.window.values["crank"] == pytest.approx(90, abs=5)

    visit(guest)


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


POINTERS = ("button_press", "button_release", "motion_notify", "figure_enter", "figure_leave")
ODD = (None, True, "4", "", "\x00", [], {}, [[]], -1, 0, 3, 31, 2**31, -(2**63), 1e308, -1e-308)
ODD_TEXTS = (
    "NaN",
    "-Infinity",
    "1e999",
    "9" * 400,
    "[" * 300 + "]" * 300,
    '{"a":' * 300,
    '"\\ud800"',
)


def good_message(rng):
    kind = rng.choice(
        [*POINTERS * 3, "ack", "refresh", "resize", "set_device_pixel_ratio", "scroll"]
    )
    if kind == "set_device_pixel_ratio":
        return {"type": kind, "device_pixel_ratio": rng.choice([0.5, 1, 1.25])}
    place = {"x": rng.uniform(-50, 1.1 * WIDTH), "y": rng.uniform(-50, 1.1 * HEIGHT)}
    return {"type": kind, **place, "button": rng.randrange(5), "buttons": rng.randrange(32)}


def mutated(rng):
    """A message that may be anything, most often one of the page's with something wrong in it."""
    content = good_message(rng)
    key = rng.choice(list(content))
    match rng.randrange(7):
        case 0:
            del content[key]
        case 1:
            content[key] = rng.choice(ODD)
        case 2:
            content[key] = "@"
            return json.dumps(content).replace('"@"', rng.choice(ODD_TEXTS))
        case 3:
            text = bytearray(json.dumps(content).encode())
            for _ in range(rng.randint(1, 4)):
                text[rng.randrange(len(text))] = rng.randrange(128)
            return text[: rng.randint(0, len(text))].decode()
        case 4:
            return rng.randbytes(rng.randint(0, 200))
        case 5:
            content["type"] = rng.choice(["draw_idle", "toolbar_button", "__class__", "press", ""])
    return json.dumps(content)


FRAMES = (
    b"\x81\xff" + struct.pack("!Q", 2**62) + b"mask",  # longer than any memory
    b"\x81\xfe\xff\xff" + b"mask" + b"x" * 10,  # ends too early
    b"\xf1\x80mask",  # a reserved bit
    b"\x83\x80mask",  # an unknown kind
    b"\x80\x80mask",  # goes on with nothing
    b"\x89\xfe\x01\x00mask" + b"x" * 256,  # too long a ping
    b"\x81\x82mask" + bytes(a ^ b for a, b in zip(b"\xc3\x28", b"ma", strict=True)),  # no UTF-8
    b"\x88\x80mask",
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
    rng = random.Random(0)
    failed = []

    async def guest(page, port):
        asyncio.get_running_loop().set_exception_handler(lambda _, context: failed.append(context))
        other = await Browser.opened(port)
        for _ in range(5):
            hostile = await Browser.opened(port)
            for _ in range(600):
                message = mutated(rng)
                await hostile.connection.write_message(message, isinstance(message, bytes))
            await hostile.connection.write_message("9" * (LONGEST + 1))  # it is closed for this
            await hostile.closed()
        for frame in FRAMES:
            await send_frame(port, frame)
        await other.send("set_device_pixel_ratio", device_pixel_ratio=1)
        await other.send("draw")
        row = page.window.rows[0]
        for fraction in (0.3, 0.7):
            await other.mouse("button_press", on_track(row, fraction))
            await other.mouse("button_release", on_track(row, fraction), 0)
            await other.look(lambda tab, wanted=fraction: abs(row.value / 360 - wanted) < 0.02)
        await other.look(lambda tab: tab.picture.shape == drawn(page).shape)
        await other.look(lambda tab: (tab.picture == drawn(page)).all())
        assert page.tabs == {next(iter(page.tabs))}
        gc.collect()  # a task that failed is told of when it goes

    visit(guest)
    assert not failed
    assert {record.name for record in caplog.records} == {"designopt.explore"}
    assert max(record.levelno for record in caplog.records) == logging.WARNING


def test_a_button_is_pressed_and_the_message_comes(visit, tmp_path):
    async def guest(page, port):
        tab = await Browser.opened(port)
        await tab.look(lambda tab: tab.pictures)
        await tab.mouse("button_press", on_button(page.window, PICTURE))
        await tab.mouse("button_release", on_button(page.window, PICTURE), 0)
        await tab.look(lambda tab: tab.news["message"].startswith("Saved toy-1.png and toy-1.svg"))
        assert (tmp_path / "toy-1.png").is_file()

    visit(guest)
