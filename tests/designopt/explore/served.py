"""A page that is served from a thread of the test's own process."""

from __future__ import annotations

import asyncio
import os
import shutil
import sys
import threading
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tornado.httpserver import HTTPServer

from designopt.explore.explorer import Explorer
from designopt.explore.server import Site, listen
from tests.designopt.explore import slider_crank

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


class Served:
    """A site, and what happens to it between two messages."""

    site: Site

    def __init__(self) -> None:
        self.loop = asyncio.new_event_loop()
        self.ready = threading.Event()
        self.over = asyncio.Event()

    def call(self, function: Callable[[], Any]) -> Any:
        """What a function returns in the server's thread."""

        async def called() -> Any:
            return function()

        return asyncio.run_coroutine_threadsafe(called(), self.loop).result(60)

    @property
    def values(self) -> dict[str, float]:
        return self.call(lambda: dict(self.site.session.model["values"]))

    @property
    def model(self) -> dict[str, Any]:
        return self.call(lambda: dict(self.site.session.model))


@contextmanager
def served(explorer: Explorer, folder: Path) -> Iterator[Served]:
    """Serve a page, without a browser, with a stand-in for the search."""
    found = Served()

    async def main() -> None:
        with listen(0) as listener:
            found.site = Site(explorer, folder, listener.getsockname()[1])
            server = HTTPServer(found.site.application())
            server.add_socket(listener)
            found.ready.set()
            await found.over.wait()
            server.stop()
            found.site.close()
            for worker in found.site.session.end():
                worker.join()
            await server.close_all_connections()

    module = types.ModuleType("designopt.optimize.design_search")
    module.search = slider_crank.search  # pyright: ignore[reportAttributeAccessIssue]
    thread = threading.Thread(target=found.loop.run_until_complete, args=(main(),))
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, module.__name__, module)
        thread.start()
        assert found.ready.wait(60)
        try:
            yield found
        finally:
            found.loop.call_soon_threadsafe(found.over.set)
            thread.join(60)
            found.loop.close()


@contextmanager
def driven_browser() -> Iterator[Any]:
    """Chromium; the test is skipped where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    executable = next(filter(None, map(shutil.which, BROWSERS)), None)
    if executable is None:
        pytest.skip(f"no browser to drive: none of {', '.join(BROWSERS)} is installed")
    sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []  # Chromium's needs another user
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=executable, args=sandbox)
        yield browser
        browser.close()
