"""Pictures of the page of ``designopt explore``, in a browser without windows."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

from playwright.sync_api import Page, ViewportSize, sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATIENCE = 300_000
"""Milliseconds in which numbers come: programs are compiled first."""

DESKTOP = ViewportSize(width=1280, height=860)
PHONE = ViewportSize(width=390, height=780)


def write_screenshots(folder: Path) -> None:
    """Write ``explore.png``, ``explore-optimised.png`` and ``explore-phone.png`` of a four-bar.

    Raises:
        RuntimeError: there is no browser to make them in.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise RuntimeError(f"pictures of the page need one of {', '.join(BROWSERS)}: install it")
    file = str(files("studies") / "gallery/linkages/four-bar.toml")
    command = [sys.executable, "-m", "designopt", "explore", file, "--no-browser", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None  # as it is a pipe
            [address] = re.findall(r"http\S+", server.stdout.readline())
            with sync_playwright() as driver:
                sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
                chromium = driver.chromium.launch(executable_path=browser, args=sandbox)
                page = chromium.new_page(viewport=DESKTOP)
                page.goto(address)
                _wait(page)
                page.screenshot(path=folder / "explore.png")
                page.click("#optimise")
                page.wait_for_selector("#report li", timeout=PATIENCE)
                _wait(page)
                page.screenshot(path=folder / "explore-optimised.png", full_page=True)
                page.set_viewport_size(PHONE)
                page.wait_for_timeout(500)
                page.screenshot(path=folder / "explore-phone.png")
                chromium.close()
        finally:
            server.send_signal(signal.SIGINT)


def _wait(page: Page) -> None:
    """Until readouts and requirements are computed, and shown."""
    listed = "!document.getElementById('optimising').hidden"
    done = f"() => {listed} && !document.body.innerText.includes('computing')"
    page.wait_for_function(done, timeout=PATIENCE)
    page.evaluate("scrollTo(0, 0)")
    page.wait_for_timeout(500)
