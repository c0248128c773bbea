"""The page in a real browser, over the real command and real designs."""

import base64
import io
import os
import shutil
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

from designopt.designs import load_design
from designopt.explore.bench import number_text
from designopt.explore.face import HEIGHT
from designopt.explore.window import OPTIMISE, PICTURE, RESET, SPEC
from kinematics import read_linkage, solve_poses
from tests.designopt.explore.hands import Hands, on_button, on_track, served

STUDIES = Path(__file__).parents[3] / "studies"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATIENCE = 120_000
"""Milliseconds: a busy machine compiles slowly."""


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    executable = next(filter(None, map(shutil.which, BROWSERS)), None)
    if executable is None:
        pytest.skip(f"no browser to drive: none of {', '.join(BROWSERS)} is installed")
    sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []  # Chromium's needs another user
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=executable, args=sandbox)
        yield browser
        browser.close()


NUMBERS = """(wanted) => {
  const cells = [...document.querySelectorAll('#readings td.number')].map((c) => c.textContent);
  return cells.length === wanted.length && wanted.every((number, i) => number === null
    ? cells[i] === '–' : Math.abs(Number(cells[i]) - number) <= 1e-5 * Math.abs(number) + 1e-7);
}"""
STILL = """() => {
  const picture = () => document.querySelector('canvas.mpl-canvas').toDataURL();
  const before = picture();
  return new Promise((tell) => setTimeout(() => tell(picture() === before), 500));
}"""
OTHER = "(before) => document.querySelector('canvas.mpl-canvas').toDataURL() !== before"
SAID = "(words) => new RegExp(words).test(document.querySelector('#message').textContent)"
LOADED = """() => {
  const canvas = document.querySelector('canvas.mpl-canvas');
  return canvas.width === Math.round(1280 * devicePixelRatio)
    && document.querySelector('#readings tr')
    && canvas.getContext('2d').getImageData(0, 0, 1, 1).data[3] === 255;
}"""
"""Numbers come first, and the picture when the browser has unpacked it."""


class Visitor:
    """Does the same on the page and at a window in this process."""

    def __init__(self, page, window):
        self.page, self.window = page, window
        self.wait(LOADED)
        self._box = page.locator("canvas.mpl-canvas").bounding_box()

    def wait(self, condition, given=None):
        self.page.wait_for_function(condition, arg=given, timeout=PATIENCE)

    def whole(self, place):
        """The whole pixel of the page at a place in the figure, and where that is in the figure."""
        left, top = self._box["x"], self._box["y"]
        x, y = round(left + place[0]), round(top + HEIGHT - place[1])
        return (x, y), (x - left, HEIGHT - (y - top))

    def drag(self, row, fraction):
        """Take a slider by its handle and let it go elsewhere."""
        now = (row.value - row.knob.low) / (row.knob.high - row.knob.low)
        (start, here), (end, there) = (
            self.whole(on_track(row, each)) for each in (min(max(now, 0.02), 0.98), fraction)
        )
        self.page.mouse.move(*start)
        self.page.mouse.down()
        self.page.mouse.move(*end, steps=4)
        self.page.mouse.up()
        self.window.mouse("button_press", *here)
        self.window.mouse("motion_notify", *there)
        self.window.mouse("button_release", *there)
        self.window.run_until_still()

    def press(self, name):
        self.page.mouse.click(*self.whole(on_button(self.window.window, name))[0])

    @property
    def expected(self):
        values = (each.value for each in self.window.window.readings)
        return [None if number_text(value) == "–" else value for value in values]

    def picture(self):
        return self.page.evaluate("document.querySelector('canvas.mpl-canvas').toDataURL()")

    def pixels(self):
        """Those of the page's picture, when it has come to rest."""
        self.wait(STILL)
        data = base64.b64decode(self.picture().partition(",")[2])
        return np.array(Image.open(io.BytesIO(data)).convert("RGBA"), float)


def tour(browser, named, folder, check=lambda saved, numbers, joint: None, ratio=1.0):
    """Move every slider and press every button of a design's page, on a screen of so many pixels.

    At some ratios Matplotlib's script makes the canvas a pixel or two too small.
    """
    window, sharp = (Hands(load_design(named).explorer(), folder) for _ in range(2))
    canvas: Any = sharp.canvas
    canvas._set_device_pixel_ratio(ratio)
    page = browser.new_page(viewport={"width": 1340, "height": 1000}, device_scale_factor=ratio)
    faults = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda said: faults.append(said.text) if said.type == "error" else None)
    with served(named, folder) as address:
        page.goto(address)
        visitor = Visitor(page, window)
        first = visitor.expected
        visitor.wait(NUMBERS, first)
        # The same picture, but for what another compiler's rounding does to an edge.
        assert np.abs(visitor.pixels() - sharp.redrawn()).mean() < 0.5
        names = page.locator("#readings th").all_inner_texts()
        assert names == [each.name for each in window.window.readings]
        for row in window.window.rows:
            before, value = visitor.picture(), row.value
            high = value > (row.knob.low + row.knob.high) / 2
            visitor.drag(row, 0.4 if high else 0.6)
            assert row.value != value
            visitor.wait(OTHER, before)
            visitor.wait(NUMBERS, visitor.expected)
        visitor.press(RESET)
        visitor.wait(NUMBERS, first)
        joint = window.window.rows[0]
        window.press(RESET)
        visitor.drag(joint, 0.45)
        visitor.wait(NUMBERS, visitor.expected)
        visitor.press(SPEC)
        visitor.wait(SAID, "^Saved .*-1\\.toml")
        specs = sorted(folder.glob("*-1.*"))
        numbers = page.locator("#readings td.number").all_inner_texts()
        check(specs[0], dict(zip(names, numbers, strict=True)), joint)
        visitor.press(PICTURE)
        visitor.wait(SAID, "^Saved .*-1\\.png and .*-1\\.svg")
        (picture,) = folder.glob("*-1.png")
        assert np.array(Image.open(picture)).shape == (1520, 2560, 4)
        assert len(list(folder.glob("*-1.svg"))) == 1
        if OPTIMISE in window.window.buttons:
            visitor.press(RESET)
            visitor.wait(NUMBERS, first)
            visitor.press(OPTIMISE)
            page.wait_for_function(f"(first) => !({NUMBERS})(first)", arg=first, timeout=PATIENCE)
            visitor.press(RESET)
            visitor.wait(NUMBERS, first)
    visitor.wait(SAID, "The connection was lost")
    page.close()
    assert not faults


def check_four_bar(saved, numbers, joint):
    """The saved linkage, solved by itself, has the margin that the page says."""
    poses = solve_poses(read_linkage(saved), jnp.deg2rad(jnp.array([[joint.value]])))
    assert float(numbers["margin"]) == pytest.approx(float(poses.margin[0]), rel=1e-5)


@pytest.mark.slow
def test_a_linkage_on_the_page_of_a_sharper_screen(browser, tmp_path):
    tour(browser, str(STUDIES / "gallery/linkages/four-bar.toml"), tmp_path, check_four_bar, 1.5)


@pytest.mark.nightly
@pytest.mark.parametrize("named", [str(STUDIES / "gallery/scenes/finger.toml"), "table1", "finger"])
def test_other_designs_on_the_page(browser, tmp_path, named):
    tour(browser, named, tmp_path)
