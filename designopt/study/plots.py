"""The usual figures: lines, distributions, quantiles, bars and counts of records; measurements.

Axes are named by their columns, with the unit in which a column's name ends; `Report.figure` adds
the legend.
"""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from designopt.plot.figures import (
    MARKERS,
    PALETTE,
    angle_ticks,
    label_plainly,
    legend_below,
    new_figure,
)
from designopt.plot.typesetting import as_mathtext, heading, spell_out
from designopt.study.records import Records
from designopt.study.results import PrecisionStudy, StabilityRow

DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1)), (0, (3, 1)), (0, (1, 1)))
LEAST_IN_BIN = 3
"""A bin of fewer values is left out."""

LARGEST_ERROR = 10.0
"""An error above this is no answer at all, and would squeeze the others out of the figure."""

LARGEST_PLAIN = 300.0
"""Errors over a smaller range are labelled in plain numbers, others in powers of ten."""

LONG_TITLE = 38
"""Characters of a workload's name that have room over one of two panels; longer ones are broken."""

NONE: Mapping[str, Any] = MappingProxyType({})


def lines(
    records: Records,
    x: str,
    y: str | Sequence[str],
    *,
    by: str | None = None,
    panel: str | None = None,
    step: float | None = None,
    stat: str = "mean",
    log: str = "",
    names: Mapping[str, str] = NONE,
    height: float = 3.2,
) -> Figure:
    """A statistic of one column over another, one line for each group.

    Args:
        records: rows.
        x: column of the abscissae; one that ends in ``_deg`` has ticks in usual steps.
        y: column of the ordinates; of several columns each has axes of its own.
        by: column of the groups.
        panel: column whose values have axes of their own, which share their limits; for one ``y``.
        step: width of the classes of ``x``; by default each value is one.
        stat: of the ordinates in a class, as `Records.stat` takes it.
        log: axes with a logarithmic scale, ``"x"``, ``"y"`` or ``"xy"``.
        names: what is written for a column, in place of its name.
        height: in inches.

    Example:
        >>> rows = Records({"angle_deg": [0, 0, 9, 9], "error_mm": [1, 2, 3, 5.0]})
        >>> [axes] = lines(rows, "angle_deg", "error_mm").axes
        >>> axes.get_xlabel(), axes.lines[0].get_ydata().tolist()
        ('angle (°)', [1.5, 4.0])
        >>> several = rows | {"gap_mm": 0.5}
        >>> both = lines(several, "angle_deg", ["error_mm", "gap_mm"]).axes
        >>> [axes.get_ylabel() for axes in both]
        ['error (mm)', 'gap (mm)']
    """
    columns = [y] if isinstance(y, str) else y
    drawing, parts = _panels(records, panel, height, len(columns))
    for (axes, part), y in zip(parts, itertools.cycle(columns), strict=False):
        for i, (label, own) in enumerate(_groups(part, by, records)):
            if not len(own):
                continue
            style = {"color": PALETTE[i % len(PALETTE)], "label": label}
            classes = own[x] if step is None else step * (np.floor(own[x] / step) + 0.5)
            binned = (own | {x: classes}).summary(x, count=f"count {y}", value=f"{stat} {y}")
            kept = binned.where(binned["count"] >= (1 if step is None else LEAST_IN_BIN))
            order = np.argsort(kept[x])
            line = {"linestyle": DASHES[i % len(DASHES)], "marker": MARKERS[i % len(MARKERS)]}
            axes.plot(kept[x][order], kept["value"][order], **style, **line)
        _finish(axes, x, y, log, names)
        if x.endswith("_deg") and "x" not in log:
            axes.set_xticks(angle_ticks(float(np.nanmax(records[x], initial=1.0)), 6))
    if len(columns) == 1:
        _share([axes for axes, _ in parts], log)
    return drawing


def ecdf(
    records: Records,
    x: str,
    *,
    by: str | None = None,
    panel: str | None = None,
    marks: Mapping[str, float] = NONE,
    log: str = "",
    least: float = 0.0,
    names: Mapping[str, str] = NONE,
    height: float = 3.2,
) -> Figure:
    """The part of the magnitudes of a column that lie below a value, one line for each group.

    Args:
        records: rows; what is not finite is left out.
        x: column.
        by: column of the groups.
        panel: column whose values have axes of their own.
        marks: values marked by upright lines, by their names.
        log: ``"x"`` for a logarithmic scale.
        least: magnitudes below it are drawn there.
        names: what is written for a column, in place of its name.
        height: in inches.
    """
    drawing, parts = _panels(records, panel, height)
    for axes, part in parts:
        for i, (label, own) in enumerate(_groups(part, by, records)):
            sizes = np.sort(np.abs(own[x][np.isfinite(own[x])])) if len(own) else np.zeros(0)
            if len(sizes):
                axes.plot(np.maximum(sizes, least), 100 * np.arange(1, len(sizes) + 1) / len(sizes),
                          color=PALETTE[i % len(PALETTE)], linestyle=DASHES[i % len(DASHES)],
                          label=label)  # fmt: skip
        for i, (label, value) in enumerate(marks.items()):
            axes.axvline(value, color="0.4", linewidth=1, linestyle=(":", "-.", "--")[i % 3],
                         label=as_mathtext(label))  # fmt: skip
        _finish(axes, x, "", log, names)
        axes.set(ylabel="part below (%)", ylim=(0, 101))
    return drawing


def qq(records: Records, error: str, deviation: str, *, by: str, height: float = 3.2) -> Figure:
    """Errors over their predicted deviations against the quantiles of a normal distribution.

    Args:
        records: rows; those whose error or deviation is not finite are left out.
        error: column.
        deviation: column, in the same unit.
        by: column of the groups; one with fewer than five rows is left out.
        height: in inches.
    """
    from scipy import stats

    drawing, [(axes, _)] = _panels(records, None, height)
    for i, (label, own) in enumerate(_groups(records, by, records)):
        scaled = own[error] / own[deviation]
        scaled = np.sort(scaled[np.isfinite(own[error] * own[deviation])])
        if len(scaled) >= 5:
            normal = stats.norm.ppf((np.arange(len(scaled)) + 0.5) / len(scaled))
            axes.plot(normal, scaled, color=PALETTE[i % len(PALETTE)], label=label,
                      linestyle=DASHES[i % len(DASHES)])  # fmt: skip
    axes.plot([-3, 3], [-3, 3], color="0.4", linewidth=1, linestyle=":", label="as predicted")
    axes.set(xlabel="quantile of the standard normal", ylabel="error over predicted deviation")
    return drawing


def bars(
    records: Records,
    x: str,
    y: str,
    *,
    by: str | None = None,
    marks: Mapping[str, float] = NONE,
    names: Mapping[str, str] = NONE,
    height: float = 3.0,
) -> Figure:
    """A bar for every value of a column, side by side for each group.

    Args:
        records: rows, one for each bar.
        x: column that names the bars.
        y: column of their heights; percentages have an axis from 0 to 100.
        by: column of the groups.
        marks: heights marked by level lines, by their names.
        names: what is written for a column, in place of its name.
        height: in inches.
    """
    drawing, [(axes, _)] = _panels(records, None, height)
    places = {value: i for i, value in enumerate(records.group(x))}
    groups = list(_groups(records, by, records))
    width = 0.8 / len(groups)
    for i, (label, own) in enumerate(groups):
        at = np.array([places[value] for value in own[x].tolist()])
        axes.bar(at + width * (i + 0.5) - 0.4, own[y], 0.95 * width, label=label,
                 color=PALETTE[i % len(PALETTE)], hatch=("", "//", "..", "xx")[i % 4])  # fmt: skip
    for label, value in marks.items():
        axes.axhline(value, color="black", linestyle=":", linewidth=1, label=as_mathtext(label))
    axes.set(xticks=range(len(places)), xticklabels=[as_mathtext(str(value)) for value in places])
    axes.set_ylabel(_name(y, names))
    if y.endswith("_percent"):
        axes.set_ylim(0, 102)
    axes.grid(visible=False, axis="x")
    return drawing


def heat(
    axes: Axes, grid: np.ndarray, rows: Sequence[Any], columns: Sequence[Any], form: str = "{:g}"
) -> None:
    """Numbers of a grid, written into squares that are the darker the larger they are.

    Args:
        axes: to draw into.
        grid: shape (rows, columns).
        rows: names, from above.
        columns: names.
        form: how a number is written.
    """
    largest = float(np.nanmax(grid, initial=0.0)) or 1.0
    axes.imshow(grid, cmap="Blues", vmin=0, vmax=largest, aspect="auto")
    for (row, column), value in np.ndenumerate(grid):
        color = "white" if value > largest / 2 else "black"
        axes.text(column, row, form.format(value), ha="center", va="center", color=color)
    axes.set(xticks=range(len(columns)), xticklabels=[as_mathtext(str(name)) for name in columns])
    axes.set(yticks=range(len(rows)), yticklabels=[as_mathtext(str(name)) for name in rows])
    axes.grid(visible=False)


def precision(study: PrecisionStudy) -> Figure:
    """Error over run time, log-log, one panel for each workload and one line for each method.

    An error of 0 is drawn at half the least other one, one above `LARGEST_ERROR` there.
    """
    panels = list(dict.fromkeys(row.panel for row in study.rows))
    methods = list(dict.fromkeys(row.method for row in study.rows))
    floor = min((row.error for row in study.rows if row.error > 0), default=1e-16) / 2
    columns = min(2, len(panels))
    drawing, axes = new_figure(-(-len(panels) // columns), columns)
    for axis, panel in zip(axes.flat, panels, strict=False):
        rows = [row for row in study.rows if row.panel == panel]
        for i, method in enumerate(methods):
            own = [row for row in rows if row.method == method]
            seconds = np.array([row.seconds for row in own])
            slowest, fastest = [row.seconds_high for row in own], [row.seconds_low for row in own]
            drawn = any(not math.isnan(row.error) for row in own)
            if own:
                axis.errorbar(
                    seconds,
                    [min(max(row.error, floor), LARGEST_ERROR) for row in own],
                    xerr=[seconds - fastest, slowest - seconds],
                    color=PALETTE[i % len(PALETTE)],
                    marker=MARKERS[i % len(MARKERS)],
                    linestyle="-" if i < len(PALETTE) else "--",
                    elinewidth=0.8,
                    label=method if drawn else None,
                )
        title = panel if len(panels) == 1 else textwrap.fill(panel, LONG_TITLE)
        axis.set(xscale="log", yscale="log", title=as_mathtext(title))
        axis.set(xlabel="run time of one call (s)", ylabel=as_mathtext(study.error))
        # Whole decades, so that every axis has labelled ticks, and only those.
        low = math.floor(math.log10(min(row.seconds_low for row in rows)))
        high = math.ceil(math.log10(max(row.seconds_high for row in rows)))
        axis.set_xlim(10.0**low, 10.0 ** max(high, low + 1))
        axis.xaxis.set_minor_formatter(NullFormatter())
        low, high = axis.get_ylim()
        if high < LARGEST_PLAIN * low:
            label_plainly(axis.yaxis)
    legend_below(drawing)
    return drawing


def stability(rows: Sequence[StabilityRow]) -> Figure:
    """Worst error of every family, values and gradients, beside the rounding of each float type.

    An error far below rounding is drawn at an eighth of it.
    """
    cases = list(dict.fromkeys(row.case for row in rows))
    drawing, [[axis]] = new_figure(height=1.6 + 0.36 * len(cases))
    for i, dtype in enumerate(dict.fromkeys(row.dtype for row in rows)):
        own = [row for row in rows if row.dtype == dtype and row.infeasible < row.cases]
        rounding = float(np.finfo(dtype).eps)
        heights = np.array([cases.index(row.case) for row in own])
        for shift, face, label, errors in (
            (-0.12, PALETTE[i], "values", [row.worst_error for row in own]),
            (0.12, "none", "gradients", [row.worst_gradient_error for row in own]),
        ):
            if np.isfinite(errors).any():
                axis.plot(np.maximum(errors, rounding / 8), heights + shift, MARKERS[i],
                          color=PALETTE[i], markerfacecolor=face,
                          label=f"{dtype}, {label}")  # fmt: skip
        axis.axvline(rounding, color=PALETTE[i], linestyle=":", label=f"{dtype} rounding")
    for height, case in enumerate(cases):
        if all(row.infeasible == row.cases for row in rows if row.case == case):
            axis.text(0.5, height, "no case has an answer", ha="center", va="center",
                      color="0.35", transform=axis.get_yaxis_transform())  # fmt: skip
    axis.set(xscale="log", xlabel="worst condition-scaled error", yticks=range(len(cases)))
    axis.set(yticklabels=map(as_mathtext, cases), ylim=(len(cases) - 0.5, -0.5))
    low, high = axis.get_xlim()
    if high < 10 * low:
        label_plainly(axis.xaxis)
    legend_below(drawing, most=2)
    return drawing


def _panels(
    records: Records, panel: str | None, height: float, count: int = 1
) -> tuple[Figure, list[tuple[Axes, Records]]]:
    parts = [("", records)] * count if panel is None else list(records.group(panel).items())
    columns = 2 if len(parts) == 4 else min(3, len(parts))
    drawing, grid = new_figure(-(-len(parts) // columns), columns, height=height)
    for axes, (title, _) in zip(grid.flat, parts, strict=False):
        axes.set_title(as_mathtext(spell_out(str(title))))
    for axes in grid.flat[len(parts) :]:
        axes.set_axis_off()
    return drawing, [(axes, part) for axes, (_, part) in zip(grid.flat, parts, strict=False)]


def _groups(part: Records, by: str | None, whole: Records) -> Iterator[tuple[str, Records]]:
    """The groups of a panel; those of all panels have one order, and so one colour."""
    if by is None:
        yield "", part
        return
    own = part.group(by)
    for key in whole.group(by):
        yield as_mathtext(str(key)), own.get(key, Records())


def _finish(axes: Axes, x: str, y: str, log: str, names: Mapping[str, str]) -> None:
    axes.set(xlabel=_name(x, names), ylabel=_name(y, names) if y else "")
    for letter in log:
        getattr(axes, f"set_{letter}scale")("log")
        label_plainly(getattr(axes, f"{letter}axis"))


def _name(column: str, names: Mapping[str, str]) -> str:
    return as_mathtext(names.get(column) or heading(column))


def _share(axes: Sequence[Axes], log: str) -> None:
    limits = np.array([one.get_ylim() for one in axes])
    for one in axes:
        one.set_ylim(limits[:, 0].min(), limits[:, 1].max())
        if "y" in log:
            label_plainly(one.yaxis)
    for one in axes[1:]:
        one.set_ylabel("")
