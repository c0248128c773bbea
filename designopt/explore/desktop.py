"""A window on the desktop."""

from __future__ import annotations

import gc
import subprocess
import sys

import matplotlib
from matplotlib import pyplot
from matplotlib.figure import Figure

from designopt.errors import UserError
from designopt.explore.face import DPI, HEIGHT, WIDTH
from designopt.interrupts import deferred

TRIAL = """
from matplotlib import pyplot
from matplotlib.backends.backend_agg import FigureCanvasAgg

canvas = pyplot.figure().canvas
if not (isinstance(canvas, FigureCanvasAgg) and canvas.required_interactive_framework):
    raise SystemExit("Matplotlib finds no window system, or no toolkit for it")
"""
HEARTBEAT = 200
"""Milliseconds until a window closes after an interrupt."""
PATIENCE = 60.0
"""Seconds that a window system may take to answer; one on another machine may never do so."""


def desktop_figure() -> Figure:
    """An empty figure in a window that is not shown yet.

    Raises:
        UserError: no window can be opened.
    """
    _try_window()
    with matplotlib.rc_context({"toolbar": "None"}):
        return pyplot.figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=DPI)


def _try_window() -> None:
    """Open a window in a process of its own: a toolkit may end the process in which it fails."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", TRIAL],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            timeout=PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise _no_window(f"the window system does not answer within {PATIENCE:g} s") from None
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        # Python ends with the reason; a toolkit that ends the process begins with it.
        lines = lines or [f"the window system ended the process with code {done.returncode}"]
        raise _no_window(lines[0 if done.returncode < 0 else -1])


def _no_window(reason: str) -> UserError:
    return UserError(f"no window can be opened here; use --web and a browser ({reason})")


def show_window(figure: Figure, title: str) -> None:
    """Show the figure's window until it is closed, or until Ctrl-C or SIGTERM closes it."""
    if figure.canvas.manager is not None:
        figure.canvas.manager.set_window_title(title)
    gc.freeze()  # as for a page
    with deferred() as is_interrupted:

        def go_on() -> bool:
            if is_interrupted():
                pyplot.close(figure)
            return not is_interrupted()

        # Python gets to its signals only while Python runs, which a toolkit does for a callback.
        timer = figure.canvas.new_timer(interval=HEARTBEAT, callbacks=[(go_on, (), {})])
        timer.start()
        pyplot.show(block=True)
