"""The page's server against whoever should not come in, and against what no page sends."""

import asyncio
import http.client
import json
import logging
import socket
import struct
import threading
import time
from contextlib import AsyncExitStack, asynccontextmanager

import numpy as np
import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

from designopt.errors import UserError
from designopt.explore import server
from designopt.explore.messages import LONGEST, Save, read_message
from designopt.explore.server import MOST_TABS, listen
from tests.designopt.explore.served import served
from tests.designopt.explore.slider_crank import SliderCrank
from tests.designopt.tables import cases
from tests.mutations import mutate


@pytest.fixture
def site(tmp_path):
    with served(SliderCrank(), tmp_path) as site:
        yield site


def answer(site, path="/", method="GET", **headers):
    """What a request is answered, with a host and a cookie of this site unless others are given."""
    port = port_of(site)
    connection = http.client.HTTPConnection("127.0.0.1", port)
    known = {"Host": f"127.0.0.1:{port}", "Cookie": f"{site.site.cookie}={site.site.token}"}
    connection.request(method, path, headers=known | headers)
    found = connection.getresponse()
    body = found.read().decode()
    connection.close()
    return found, body


def port_of(site):
    return int(site.site.cookie.partition("-")[2])


def test_it_listens_on_loopback_alone():
    with listen(0) as listener:
        address, port = listener.getsockname()
        assert address == "127.0.0.1"
        with pytest.raises(UserError, match=r"--port \d+: .*in use; choose another, or 0"):
            listen(port)


FILES = ["page.css", "page.js", "view.js", "chart.js", "inputs.js", "panels.js", "saving.js"]


def test_the_page_and_its_files_come_from_here_alone(site):
    html, page = answer(site)
    assert html.status == 200
    for name in FILES:
        found, script = answer(site, f"/page/{name}")
        assert found.status == 200
        assert found.getheader("Content-Type") in (
            "text/css; charset=utf-8",
            "text/javascript; charset=utf-8",
        )
        for text in (page, script):
            elsewhere = text.replace("http://www.w3.org/2000/svg", "").replace("ws://${", "")
            assert "http:" not in elsewhere
            assert "//" not in elsewhere.replace("// ", "")
            assert not any(one in text for one in ("innerHTML", "insertAdjacentHTML", "eval("))
    for path in ("/page/none.js", "/page/../server.py", "/page/%2e%2e/server.py", "/server.py"):
        assert answer(site, path)[0].status == 404


def test_every_answer_has_the_headers_that_guard_it(site):
    for path, status in (("/", 200), ("/page/page.js", 200), ("/no", 404), ("/?token=x", 403)):
        found, _ = answer(site, path)
        assert found.status == status
        policy = found.getheader("Content-Security-Policy") or ""
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert found.getheader("Referrer-Policy") == "no-referrer"
        assert found.getheader("X-Content-Type-Options") == "nosniff"
        assert found.getheader("Cache-Control") == "no-store"


def test_the_token_becomes_a_cookie_and_leaves_the_address(site):
    found, _ = answer(site, f"/?token={site.site.token}", Cookie="")
    assert (found.status, found.getheader("Location")) == (302, "/open")
    cookie = found.getheader("Set-Cookie") or ""
    assert cookie.startswith(f"designopt-{port_of(site)}={site.site.token};")
    assert {"HttpOnly", "SameSite=Strict"} <= set(cookie.split("; "))
    opened, text = answer(site, "/open", Cookie="")
    assert opened.status == 200
    assert site.site.token not in text + answer(site)[1]


OTHERS = ["evil.example", "evil.example:{}", "127.0.0.1.evil.example", "127.0.0.2"]


@pytest.mark.parametrize("path", ["/", "/?token={}", "/open", "/page/page.js", "/ws", "/no"])
def test_without_the_token_or_under_another_name_nobody_comes_in(site, path):
    path = path.format("%C3%A9")
    wrong = ["", f"{site.site.cookie}=x", f"{site.site.cookie}=é", f"other={site.site.token}"]
    for cookie in wrong if path != "/open" else ():
        found, text = answer(site, path, Cookie=cookie.encode())
        assert found.status == 403
        assert "designopt explore --no-browser" in text
    for host in OTHERS:
        assert answer(site, path, Host=host.format(1))[0].status == 403
    assert not site.site.tabs


def test_other_ways_of_asking_are_refused_in_a_line(site):
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        found, text = answer(site, method=method)
        assert found.status == 405
        assert text == "405: there is nothing here.\n"


@asynccontextmanager
async def connected(site, **headers):
    """A tab without a screen."""
    port = port_of(site)
    known = {
        "Origin": f"http://127.0.0.1:{port}",
        "Cookie": f"{site.site.cookie}={site.site.token}",
    }
    url = f"ws://127.0.0.1:{port}/ws"
    tab = await websocket_connect(HTTPRequest(url, headers=known | headers))
    try:
        yield tab
    finally:
        is_open = tab.close_code is None
        tab.close(1001)  # as browsers do
        if is_open:
            await closed(tab)


async def closed(tab):
    """Take what comes until the connection is closed."""
    while await asyncio.wait_for(tab.read_message(), 20) is not None:
        pass


async def send(tab, **content):
    await tab.write_message(json.dumps(content))


async def read(tab):
    """What a tab is sent next."""
    text = await asyncio.wait_for(tab.read_message(), 20)
    assert text is not None
    return json.loads(text)["fields"]


def test_pages_of_other_sites_do_not_connect(site):
    async def main():
        others = ["http://evil.example", "http://localhost:1", "null"]
        for headers in ({"Cookie": ""}, *({"Origin": one} for one in others)):
            with pytest.raises(HTTPClientError) as caught:
                async with connected(site, **headers):
                    pass
            assert caught.value.code == 403

    asyncio.run(main())
    assert not site.site.tabs


NONSENSE = (*cases("no_message"), "[" * 30_000, b"\xff\x00")


@pytest.mark.parametrize("message", NONSENSE, ids=range(len(NONSENSE)))
def test_nonsense_is_no_message_and_the_fault_fits_in_a_line(message):
    with pytest.raises(ValueError, match=r"\w") as caught:
        read_message(message)
    line = str(caught.value)
    assert line.isascii()
    assert line.isprintable()
    assert len(line) < 123  # bytes of a reason


def messages(count):
    """Messages of a page with something wrong in most of them."""
    rng = np.random.default_rng(0)
    for _ in range(count):
        content = {"type": "set", "values": {"rod": 70.0}, "seq": 1, "gesture": 1}
        if rng.uniform() < 0.5:
            content = {"type": "drag", "handle": "tip", "x": 1.0, "y": 2.0, "seq": 1, "gesture": 1}
        mutate(content, rng)
        yield json.dumps(content)


FRAMES = (
    b"\x81\xff" + struct.pack("!Q", 2**62) + b"mask",  # longer than any memory
    b"\xf1\x80mask",  # a reserved bit
    b"\x88\x81mask0",
    b"",
)


async def send_frame(site, frame):
    """Open a tab, send bytes that need not be a frame, and break the connection off."""
    port = port_of(site)
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(
        f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
        f"Cookie: {site.site.cookie}={site.site.token}\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
        + frame
    )
    await reader.read(100)
    lingering = struct.pack("ii", 1, 0)  # for no time: closing resets the connection
    writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, lingering)
    writer.close()


def test_no_message_harms_another_tab(site, caplog, capfd):
    async def main():
        async with connected(site) as other:
            for message in (*NONSENSE, "9" * (LONGEST + 1), *messages(100)):
                async with connected(site) as hostile:
                    await hostile.write_message(message, isinstance(message, bytes))
                    if message in NONSENSE:
                        await closed(hostile)
                        assert (hostile.close_code, bool(hostile.close_reason)) == (1008, True)
            for frame in FRAMES:
                await send_frame(site, frame)
            await send(other, type="set", values={"crank": 123.0}, seq=9, gesture=1)
            while '"at": 123.0' not in json.dumps(await read(other)):
                await send(other, type="ack")

    asyncio.run(main())
    assert not [one for one in caplog.records if one.levelno >= logging.WARNING]
    assert "Traceback" not in capfd.readouterr().err


def test_no_more_than_so_many_tabs(site):
    async def main():
        async with AsyncExitStack() as stack:
            for _ in range(MOST_TABS):
                await stack.enter_async_context(connected(site))
            ninth = await stack.enter_async_context(connected(site))
            assert await ninth.read_message() is None
            assert ninth.close_code == 4008
            assert "8 tabs are open already" in (ninth.close_reason or "")

    asyncio.run(main())


def test_a_tab_that_does_not_answer_is_spared_and_catches_up(site):
    async def main():
        async with connected(site) as tab:
            for number in range(100):
                value = {"crank": float(number)}
                await send(tab, type="set", values=value, seq=number, gesture=1)
                await asyncio.sleep(0.01)
            for _ in range(server.MOST_UNANSWERED):
                fields = await read(tab)
                assert fields.get("values", {}).get("crank") != 99.0
            for _ in range(server.MOST_UNANSWERED):
                await send(tab, type="ack")
            fields = await read(tab)
            assert fields["values"]["crank"] == 99.0
            assert fields["title"] == "slider-crank"

    asyncio.run(main())


def test_it_ends_some_time_after_its_last_tab_unless_one_comes_back(site, monkeypatch):
    monkeypatch.setattr(server, "GRACE", 0.3)

    async def main():
        async with connected(site) as tab:
            await read(tab)
        await asyncio.sleep(0.1)
        async with connected(site):
            await asyncio.sleep(0.5)
            assert not site.site.deserted.is_set()
        await asyncio.sleep(0.6)
        assert site.site.deserted.is_set()

    asyncio.run(main())


def test_an_interrupt_waits_for_what_is_being_saved(tmp_path, monkeypatch, capsys):
    explorer, begun = SliderCrank(), threading.Event()
    files = explorer.design.files

    def slow(values):
        begun.set()
        time.sleep(0.5)
        return files(values)

    class Interrupted:
        def __init__(self, site):
            self.site = site

        async def wait(self):
            self.site.session.take("tab", Save(type="save", although_failing=True))
            await asyncio.to_thread(begun.wait, 20)
            raise KeyboardInterrupt

    class Site(server.Site):
        def __init__(self, *given):
            super().__init__(*given)
            self.deserted = Interrupted(self)

    monkeypatch.setattr(explorer.design, "files", slow)
    monkeypatch.setattr(server, "Site", Site)
    with listen(0) as listener, pytest.raises(KeyboardInterrupt):
        server.serve(explorer, tmp_path, listener, browser=False)
    assert "saving what was asked for; Ctrl-C again ends at once" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"crank-1.toml", "raw-1.bin"}
