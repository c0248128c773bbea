"""How long a slider takes to reach the picture: a real pointer in a headless Chromium.

``python -m tests.designopt.explore.latency STUDY|FILE …`` prints for each design and its first
sliders the median and the 95 % quantile of the time from the pointer's event until after the frame
that shows the new values, and how long the first numbers took from the command's start.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from tests.designopt.explore.served import driven_browser

MOVES = 150
PAUSE = 0.06
"""Seconds between two moves of the pointer: with charts and numbers, which come after the picture,
the page is idle before each."""

TIMES = "performance.getEntriesByName('change to picture').map((one) => one.duration)"


@contextmanager
def explored(named: str) -> Iterator[str]:
    """The address of a page that the command serves."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["--no-browser", "--port", "0", "--out", folder]
        command = [sys.executable, "-m", "designopt", "explore", named, *options]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            found = re.search(r"http://\S+", process.stdout.readline())
            assert found, f"{named}: no page"
            yield found[0]
            process.terminate()


def until(condition: Callable[[], bool]) -> None:
    """Wait for a condition; the page's policy rules out a browser's own waiting for one."""
    while not condition():
        time.sleep(0.05)


def measure(browser, named: str, sliders: int = 3) -> Iterator[tuple[str, np.ndarray]]:
    """Times in ms by slider; first that of the first picture and the first numbers."""
    start = time.monotonic()
    with explored(named) as address:
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto(address)
        page.wait_for_selector(".view svg path, .view svg circle, .view canvas", state="attached")
        first = time.monotonic() - start
        until(lambda: page.locator("#readouts th").first.inner_text() != "numbers")
        yield "first picture and first numbers", 1e3 * np.array([first, time.monotonic() - start])
        until(lambda: page.locator("#judging").inner_text() == "")
        found = page.locator("input[type=range]")
        for slider in [found.nth(n) for n in range(min(found.count(), sliders))]:
            slider.scroll_into_view_if_needed()
            box = slider.bounding_box()
            x, y = box["x"], box["y"] + box["height"] / 2
            page.mouse.move(x + 0.5 * box["width"], y)
            page.mouse.down()
            page.evaluate("performance.clearMeasures()")
            for number in range(MOVES):
                page.mouse.move(x + box["width"] * (0.5 + 0.3 * np.sin(0.1 * number)), y)
                time.sleep(PAUSE)
            page.mouse.up()
            page.wait_for_timeout(500)
            yield slider.get_attribute("aria-label"), np.array(page.evaluate(TIMES))
        page.close()


def main(designs: list[str]) -> None:
    """Print the times of each design."""
    with driven_browser() as browser:
        for named in designs:
            for name, times in measure(browser, named):
                median, most = np.quantile(times, [0.5, 0.95])
                text = f"median {median:.1f} ms, 95 % {most:.1f} ms, {len(times)} times"
                if len(times) == 2:
                    text = " and ".join(f"{one / 1e3:.1f} s" for one in times)
                print(f"{named}: {name}: {text}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
