"""One look for every figure: sizes, colours that survive printing and colour blindness, saving."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from matplotlib.transforms import Bbox

# Okabe & Ito, Color Universal Design (2008), without its yellow, which vanishes on white paper.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#56B4E9", "#E69F00")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")

TEXT_WIDTH = 7.2
"""Width of a figure, in inches: that of the text on an A4 page."""

RIM, TRIMS = 0.05, 5
"""Inches around a trimmed figure, and how often it is trimmed at most: texts keep their size, so a
smaller figure is laid out anew."""

STYLE: dict[Any, Any] = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "figure.constrained_layout.wspace": 0.06,  # a colour bar's label is not the next axis's
    "font.size": 9,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.5,
    "savefig.dpi": 200,
    "svg.fonttype": "path",
    "svg.hashsalt": "designopt",  # the same drawing gives the same file
}


def style() -> AbstractContextManager[None]:
    """Draw in this look while the context lasts; Matplotlib's settings come back after it."""
    return matplotlib.rc_context(STYLE)


def new_figure(
    rows: int = 1,
    columns: int = 1,
    *,
    height: float | None = None,
    width_ratios: Sequence[float] | None = None,
) -> tuple[Figure, np.ndarray]:
    """A figure and its axes, always as a 2D array, without touching Matplotlib's global state.

    Args:
        rows: rows of axes.
        columns: columns of axes.
        height: inches; by default 3.2 per row. The width is that of the text; `save` takes away
            what axes of a fixed aspect leave empty of either.
        width_ratios: relative widths of the columns; equal by default.
    """
    figure = Figure(figsize=(TEXT_WIDTH, height or 3.2 * rows), layout="compressed")
    return figure, figure.subplots(rows, columns, squeeze=False, width_ratios=width_ratios)


def legend_below(
    figure: Figure,
    handles: Iterable[Any] | None = None,
    labels: Iterable[str] | None = None,
    *,
    most: int = 3,
    **style: Any,
) -> int:
    """A legend below all axes, in as many columns as fit.

    Args:
        figure: whose.
        handles: what is named; by default all that has a label in any axes, each label once.
        labels: their names.
        most: columns there may be at most.
        style: as `Figure.legend` takes it.

    Returns:
        How many lines it has.
    """
    if handles is None or labels is None:
        named = {
            label: handle
            for axes in figure.axes
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        handles, labels = named.values(), named.keys()
    handles, labels = list(handles), list(labels)
    columns = max(min(most, len(labels)), 1)
    while True:
        place = {"loc": "outside lower center", "ncols": columns}
        legend = figure.legend(handles, labels, **place, **style)
        if columns == 1 or legend.get_window_extent().width < figure.bbox.width:
            return math.ceil(len(labels) / columns)
        legend.remove()
        columns -= 1


def share_limits(axes: Iterable[Axes], margin: float = 0.03) -> None:
    """Give all axes the same limits, so that each has room for what is drawn in any of them.

    Args:
        axes: with equal units along x and y, and each with something drawn.
        margin: around what is drawn, as a part of the larger of its width and height.
    """
    axes = list(axes)
    drawn = Bbox.union([each.dataLim for each in axes])
    drawn = drawn.padded(margin * max(drawn.width, drawn.height))
    for each in axes:
        each.set(xlim=drawn.intervalx, ylim=drawn.intervaly)


def angle_ticks(last_deg: float, most: int = 4) -> np.ndarray:
    """Ticks of an axis of angles from 0 on, in usual steps: 5, 10, 15, 30, 45 or 90°.

    Args:
        last_deg: where the axis ends, degrees.
        most: steps there may be at most.
    """
    step = next((step for step in (5, 10, 15, 30, 45) if last_deg <= most * step), 90)
    return np.arange(0, last_deg + 1e-9, step)


def label_plainly(axis: Axis) -> None:
    """Label a logarithmic axis in plain numbers, not in powers of ten.

    At 1, 2 and 5 of every decade; where it spans less than one, at a few round numbers, and where
    it spans three or more, at decades. Call it when the axis has its limits.
    """
    low, high = axis.get_view_interval()
    few = MaxNLocator(6, steps=[1, 2, 5, 10])
    usual = LogLocator(subs=(1, 2, 5) if high < 1e3 * low else (1,))  # too many would be none
    axis.set_major_locator(few if high < 10 * low else usual)
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def trim(figure: Figure) -> None:
    """Shrink a figure to what it shows, where axes of a fixed aspect leave bands empty."""
    if not any(isinstance(axes.get_aspect(), float) for axes in figure.axes):
        return
    for _ in range(TRIMS):
        figure.draw_without_rendering()
        box, size = figure.get_tightbbox(), figure.get_size_inches()
        needed = np.minimum(size, np.array([box.width, box.height]) + 2 * RIM)
        if np.max(size - needed) < RIM:
            return
        figure.set_size_inches(*needed.tolist())


def save(figure: Figure, folder: Path, name: str) -> tuple[Path, Path]:
    """Write ``name.png`` and ``name.svg`` into ``folder`` and return their paths.

    A figure with axes of a fixed aspect is trimmed first: see `trim`.
    """
    trim(figure)
    png, svg = folder / f"{name}.png", folder / f"{name}.svg"
    figure.savefig(png)
    figure.savefig(svg, metadata={"Date": None})
    return png, svg
