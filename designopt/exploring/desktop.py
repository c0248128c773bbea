"""A window on the desktop."""

from __future__ import annotations

import gc

import matplotlib
from matplotlib import pyplot
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from designopt.errors import UserError
from designopt.exploring.face import DPI, HEIGHT, WIDTH

NO_WINDOWS = "there is no window system here to open a window with; use --web and a browser"


def desktop_figure() -> Figure:
    """An empty figure in a window that is not shown yet.

    Raises:
        UserError: there is no window system.
    """
    try:
        with matplotlib.rc_context({"toolbar": "None"}):
            figure = pyplot.figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=DPI)
    except (ImportError, RuntimeError) as error:  # a backend that was asked for by its name
        raise UserError(NO_WINDOWS) from error
    canvas = figure.canvas
    if not isinstance(canvas, FigureCanvasAgg) or not canvas.required_interactive_framework:
        pyplot.close(figure)
        raise UserError(NO_WINDOWS)
    return figure


def show_window(figure: Figure, title: str) -> None:
    """Show the figure's window until it is closed."""
    if figure.canvas.manager is not None:
        figure.canvas.manager.set_window_title(title)
    gc.freeze()  # as for a page
    pyplot.show(block=True)
