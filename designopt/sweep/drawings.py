"""One figure per metric: a curve, a map, or a panel for every setting that is varied."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from designopt.plot.figures import PALETTE, new_figure
from designopt.plot.typesetting import as_mathtext, spell_out
from designopt.study.results import Target
from designopt.sweep.points import Points

MOST_WRITTEN = 12
"""A map with more values along a side than this has no numbers in its cells."""

COLORS = "cividis"  # the same order for all eyes, and in grey

WRITTEN = {"°": "deg", "mm²": "mm2", "%": "percent"}
"""Units as names of metrics end in them, where that is not the unit itself."""


class Series(NamedTuple):
    """A metric over the points of a sweep.

    Attributes:
        name: of the metric.
        unit: of its values; empty for a pure number.
        values: one per point; NaN where there is none.
        target: the figure asked for, if all points have the same.
    """

    name: str
    unit: str
    values: np.ndarray
    target: Target | None

    @property
    def label(self) -> str:
        """For an axis."""
        ending = "_" + WRITTEN.get(self.unit, self.unit.lower())
        name = as_mathtext(spell_out(self.name.removesuffix(ending)))
        return f"{name} ({self.unit})" if self.unit else name


def draw(points: Points, series: Series) -> Figure:
    """A metric over what is varied."""
    if points.grid is not None and len(points.grid) == 2:
        return _map(points, series)
    return _panels(points, series)


def _panels(points: Points, series: Series) -> Figure:
    """A panel per setting; joined by a line where nothing else is varied."""
    columns = min(3, len(points.keys))
    rows = -(-len(points.keys) // columns)
    figure, all_axes = new_figure(rows, columns, height=3.6 if rows == 1 else None)
    numbers, missing = series.values, np.isnan(series.values)
    curve = points.grid is not None and len(points.keys) == 1
    settings = np.array(points.rows, float)
    for axes in all_axes.flat[len(points.keys) :]:
        axes.set_axis_off()
    for axes, label, column in zip(all_axes.flat, points.labels, settings.T, strict=False):
        order = np.argsort(column, kind="stable")
        marks = "o-" if curve else "o"
        axes.plot(column[order], numbers[order], marks, color=PALETTE[0], clip_on=False)
        if missing.any():
            crosses = {"color": PALETTE[1], "clip_on": False, "label": "no value"}
            above, along = np.full(missing.sum(), 0.03), axes.get_xaxis_transform()
            axes.plot(column[missing], above, "x", transform=along, **crosses)
        _draw_target(axes, series.target)
        axes.ticklabel_format(useOffset=False)
        axes.set_xlabel(label)
        axes.set_ylabel(series.label if axes in all_axes[:, 0] else "")
    handles, names = all_axes[0, 0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, names, loc="outside upper right", ncols=2)
    return figure


def _draw_target(axes: Axes, target: Target | None) -> None:
    if target is None:
        return
    axes.axhline(target.value, color=PALETTE[2], linestyle="--", label=f"target {target}")
    if target.tolerance:
        low, high = target.value - target.tolerance, target.value + target.tolerance
        axes.axhspan(low, high, color=PALETTE[2], alpha=0.15)


def _map(points: Points, series: Series) -> Figure:
    """Two settings: a cell per point, the first setting upwards and the second to the right."""
    assert points.grid is not None
    upwards, across = points.grid
    shape = len(upwards), len(across)
    cells = np.ma.masked_invalid(series.values.reshape(shape))
    figure, ((axes,),) = new_figure(height=min(7.0, 1.6 + 0.45 * shape[0]) if shape[0] > 4 else 3.4)
    axes.grid(visible=False)
    axes.set_facecolor("0.85")
    low, high = float(cells.min()), float(cells.max())
    scale = Normalize(low, high)
    written = max(shape) <= MOST_WRITTEN
    edges = {"edgecolors": "white", "linewidth": 0.5} if written else {}
    image = axes.pcolormesh(cells, cmap=COLORS, norm=scale, **edges)
    bar = figure.colorbar(image, ax=axes, label=series.label)
    bar.ax.ticklabel_format(useOffset=False)
    target = series.target
    if target is not None and low < target.value < high:
        bar.ax.axhline(target.value, color="white", linewidth=2)
    for axis, label, values in zip(
        (axes.yaxis, axes.xaxis), points.labels, points.grid, strict=True
    ):
        step = -(-len(values) // MOST_WRITTEN)
        axis.set_ticks(np.arange(0, len(values), step) + 0.5, [f"{v:.4g}" for v in values[::step]])
        axis.set_label_text(label)
    axes.tick_params(length=0)
    missed = written and _write(axes, cells, scale, target)
    notes = [f"target {target}" + " (* missed)" * missed] if target is not None else []
    axes.set_title("; ".join(notes + ["grey: no value"] * np.ma.is_masked(cells)))
    return figure


def _write(axes: Axes, cells: np.ma.MaskedArray, scale: Normalize, target: Target | None) -> bool:
    """Write every cell's number, starred where it misses the target; whether any number does."""
    any_missed = False
    for (row, column), value in np.ndenumerate(cells.filled(np.nan)):
        known = not np.isnan(value)
        missed = target is not None and known and not target.met_by(float(value))
        any_missed |= missed
        text = f"{value:.4g}" + "*" * missed if known else "–"
        color = "white" if known and scale(value) < 0.5 else "black"
        axes.text(column + 0.5, row + 0.5, text, ha="center", va="center", color=color)
    return any_missed
