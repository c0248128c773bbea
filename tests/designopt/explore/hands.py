"""A person at a window: a mouse, and a clock that runs when it is told to."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from matplotlib.backend_bases import MouseEvent, TimerBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from designopt.explore.bench import Bench
from designopt.explore.face import DPI, HEIGHT, WIDTH, KnobRow
from designopt.explore.frames import SIDE
from designopt.explore.window import Window
from designopt.plot.figures import style


@contextmanager
def served(named: str, folder: Path) -> Iterator[str]:
    """The command shows a page at an address, until it is interrupted: it ends without a word."""
    arguments = ["-m", "designopt", "explore", named, "--web", "--port", "0", "--out", str(folder)]
    with subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout is not None
            said = process.stdout.readline()
            address = re.search(r"http://127\.0\.0\.1:\d+/", said)
            assert address, said + (process.stderr.read() if process.stderr else "")
            yield address[0]
        finally:
            process.send_signal(signal.SIGINT)
            ended = process.communicate(timeout=60)
    assert (process.returncode, *ended) == (0, "", "")


class Timer(TimerBase):
    """Goes off when the canvas's clock runs."""

    def __init__(self, canvas: Canvas, interval: int | None) -> None:
        self.canvas = canvas
        super().__init__(interval)

    def _timer_start(self) -> None:
        self.canvas.due.append(self._on_timer)  # pyright: ignore[reportAttributeAccessIssue]


class Canvas(FigureCanvasAgg):
    """Counts what is drawn."""

    def __init__(self, figure: Figure) -> None:
        self.due: list[Callable[[], None]] = []
        self.draws = self.blits = 0
        super().__init__(figure)

    def new_timer(self, interval=None, callbacks=None):
        return Timer(self, interval)

    def draw(self) -> None:
        self.draws += 1
        super().draw()

    def blit(self, bbox=None) -> None:
        self.blits += 1

    def run(self) -> None:
        """Let the clock go on until every timer that is set by now went off."""
        due, self.due = self.due, []
        for action in due:
            action()

    def pixels(self) -> np.ndarray:
        return np.array(self.buffer_rgba())


class Hands:
    """A window on such a canvas, and what a mouse does to it."""

    def __init__(self, bench: Bench, folder: Path) -> None:
        self.told: list[tuple[list[float | None], str]] = []
        self.bench = bench
        with style():
            figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=DPI)
            self.canvas = Canvas(figure)
            self.window = Window(bench, figure, "toy", folder, self._hear)

    def _hear(self, readings, message) -> None:
        self.told.append(([each.value for each in readings], message))

    def row(self, name: str) -> KnobRow:
        return next(row for row in self.window.rows if row.knob.name == name)

    def mouse(self, kind: str, x: float, y: float, button: int | None = 1) -> None:
        with style():
            MouseEvent(f"{kind}_event", self.canvas, x, y, button)._process()  # pyright: ignore[reportAttributeAccessIssue, reportArgumentType]

    def hold(self, name: str, *fractions: float) -> None:
        """Take a slider and move it to fractions of its track, without letting it go."""
        x, y = on_track(self.row(name), fractions[0])
        self.mouse("button_press", x, y)
        for fraction in fractions[1:]:
            self.mouse("motion_notify", *on_track(self.row(name), fraction))

    def drag(self, name: str, *fractions: float) -> None:
        """Move a slider to fractions of its track, and see what comes of it."""
        self.hold(name, *fractions)
        self.mouse("button_release", *on_track(self.row(name), fractions[-1]))
        self.run()

    def press(self, name: str) -> None:
        x, y = on_button(self.window, name)
        self.mouse("button_press", x, y)
        self.mouse("button_release", x, y)
        self.run()

    def run(self) -> None:
        with style():
            self.canvas.run()

    def run_until_still(self) -> None:
        while self.canvas.due:
            self.run()

    def redrawn(self) -> np.ndarray:
        """The same window with everything drawn anew."""
        with style():
            self.canvas.draw()
        return self.canvas.pixels()


def on_track(row: KnobRow, fraction: float) -> tuple[float, float]:
    """A place on a slider, pixels from the lower left."""
    box = row.slider.ax.bbox
    return float(box.x0 + fraction * box.width), float(box.y0 + box.height / 2)


def on_button(window: Window, name: str) -> tuple[float, float]:
    """The middle of a button, pixels from the lower left."""
    box = window.buttons[name].button.ax.bbox
    return float(box.x0 + box.width / 2), float(box.y0 + box.height / 2)


def put_squares(
    picture: np.ndarray, image: np.ndarray, places: list[list[int]], across: int
) -> None:
    """Put the squares of an image where they have changed a picture, as a page's script does."""
    for number, (left, top) in enumerate(places):
        x, y = number % across * SIDE, number // across * SIDE
        picture[top : top + SIDE, left : left + SIDE] = image[y : y + SIDE, x : x + SIDE]
