"""One look for every figure: sizes, colours that survive printing and colour blindness, saving."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

# Okabe & Ito, Color Universal Design (2008), without its yellow, which vanishes on white paper.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#56B4E9", "#E69F00")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")

STYLE = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "figure.constrained_layout.use": True,
    "font.size": 9,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.5,
    "savefig.dpi": 200,
    "svg.fonttype": "path",
    "svg.hashsalt": "designopt",  # the same drawing gives the same file
}


def new_figure(
    rows: int = 1, columns: int = 1, *, width: float = 7.2, height: float | None = None
) -> tuple[Figure, np.ndarray[Any, Any]]:
    """A figure and its axes, always as a 2D array, without touching Matplotlib's global state.

    Args:
        rows: rows of axes.
        columns: columns of axes.
        width: inches; 7.2 fills the text width of an A4 page.
        height: inches; by default 3.2 per row.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height or 3.2 * rows))
        return figure, figure.subplots(rows, columns, squeeze=False)


def save(figure: Figure, folder: Path, name: str) -> tuple[Path, Path]:
    """Write ``name.png`` and ``name.svg`` into ``folder`` and return their paths."""
    png, svg = folder / f"{name}.png", folder / f"{name}.svg"
    with matplotlib.rc_context(STYLE):
        figure.savefig(png)
        figure.savefig(svg, metadata={"Date": None})
    return png, svg
