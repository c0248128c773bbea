"""One look for every figure: sizes, colours that survive printing and colour blindness, saving."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

# Okabe & Ito, Color Universal Design (2008), without its yellow, which vanishes on white paper.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#56B4E9", "#E69F00")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")

STYLE: dict[Any, Any] = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
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
        height: inches; by default 3.2 per row. The width fills the text width of an A4 page.
        width_ratios: relative widths of the columns; equal by default.
    """
    figure = Figure(figsize=(7.2, height or 3.2 * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, width_ratios=width_ratios)


def save(figure: Figure, folder: Path, name: str) -> tuple[Path, Path]:
    """Write ``name.png`` and ``name.svg`` into ``folder`` and return their paths."""
    png, svg = folder / f"{name}.png", folder / f"{name}.svg"
    figure.savefig(png)
    figure.savefig(svg, metadata={"Date": None})
    return png, svg
