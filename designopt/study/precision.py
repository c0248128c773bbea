"""Error against run time: every method at every setting, measured the same way.

A study states its workloads as `Contender`s; `measure` times and checks one, `table` and `figure`
show them, and a `designopt.Claim` states what they show and whether it holds in this run.
"""

from __future__ import annotations

import math
import statistics
import textwrap
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import jax
from matplotlib.ticker import NullFormatter

from designopt.plot.figures import MARKERS, PALETTE, label_plainly, legend_below, new_figure
from designopt.plot.typesetting import as_mathtext
from designopt.study.results import Figure, PrecisionRow, PrecisionStudy, Table

LARGEST_DRAWN = 10.0
"""An error above this is no answer at all, and would squeeze the others out of the figure."""

LARGEST_PLAIN = 300.0
"""Errors over a smaller range are labelled in plain numbers, others in powers of ten."""

LONG_TITLE = 38
"""Characters of a workload's name that have room over one of two panels; longer ones are broken."""

MIN_SAMPLE_SECONDS = 2e-3
"""A timed sample repeats its call until it lasts this long, so that the clock's grain is lost."""


@dataclass(frozen=True)
class Contender:
    """One method at one setting on one workload.

    Attributes:
        method: its name, the same at every setting.
        setting: what is varied, such as ``"tolerance 1e-06"``.
        panel: the workload; contenders of one panel are compared with each other.
        call: answers the workload; a JAX function is compiled beforehand (`compile_timed`).
        error: from the call's answer to its worst error against the reference.
        compile_seconds: what compiling it took, 0 where nothing is compiled.
        scale: workload over what ``call`` does of it, for a method so slow that a part has to
            represent the whole; its setting must name them.
    """

    method: str
    setting: str
    panel: str
    call: Callable[[], Any]
    error: Callable[[Any], float]
    compile_seconds: float = 0.0
    scale: float = 1.0


def compile_timed(function: Callable[..., Any], *args: Any) -> tuple[Callable[..., Any], float]:
    """``function`` compiled for arguments like ``args``, and the seconds that took.

    Example:
        >>> import jax.numpy as jnp
        >>> double, seconds = compile_timed(lambda x: 2 * x, jnp.array(3.0))
        >>> float(double(jnp.array(3.0))), seconds > 0
        (6.0, True)
    """
    start = time.perf_counter()
    compiled = jax.jit(function).lower(*args).compile()
    return compiled, time.perf_counter() - start


def measure(contender: Contender, *, repeats: int, budget_seconds: float = 0.25) -> PrecisionRow:
    """Time one contender, after a warm-up and with its result waited for, and take its error.

    Args:
        contender: what to time.
        repeats: samples to take.
        budget_seconds: once the samples have taken this long, three of them are enough; a call
            that takes longer by itself needs no warming up and counts from its first time.

    Returns:
        A row with the median and the range of the samples. Seconds are per call.

    Example:
        >>> import math
        >>> row = measure(
        ...     Contender("math", "", "", lambda: math.sqrt(2), lambda x: abs(x - 2**0.5)),
        ...     repeats=3,
        ... )
        >>> row.method, row.error, row.seconds_low <= row.seconds
        ('math', 0.0, True)
    """
    start = time.perf_counter()
    answer = jax.block_until_ready(contender.call())
    first = time.perf_counter() - start
    calls = max(1, math.ceil(MIN_SAMPLE_SECONDS / max(first, 1e-9)))
    samples = [first] if first > budget_seconds else []
    deadline = time.perf_counter() + budget_seconds
    while len(samples) < 3 or (len(samples) < repeats and time.perf_counter() < deadline):
        start = time.perf_counter()
        for _ in range(calls):
            jax.block_until_ready(contender.call())
        samples.append((time.perf_counter() - start) / calls)
    seconds, low, high = (
        contender.scale * statistic(samples) for statistic in (statistics.median, min, max)
    )
    return PrecisionRow(
        method=contender.method,
        setting=contender.setting,
        panel=contender.panel,
        error=contender.error(answer),
        seconds=seconds,
        seconds_low=low,
        seconds_high=high,
        compile_seconds=contender.compile_seconds,
    )


def find_dominating(row: PrecisionRow, rows: Iterable[PrecisionRow]) -> list[PrecisionRow]:
    """Rows of the same panel that are both faster (even in their slowest repeat) and closer.

    Example:
        >>> rows = [
        ...     PrecisionRow(name, "", "", error, time, time, time, 0.0)
        ...     for name, error, time in (("a", 1e-3, 2.0), ("b", 1e-6, 1.0))
        ... ]
        >>> [row.method for row in find_dominating(rows[0], rows)]
        ['b']
    """
    return [
        other
        for other in rows
        if other.panel == row.panel
        and other.error < row.error
        and other.seconds_high < row.seconds_low
    ]


def timing(study: PrecisionStudy) -> str:
    """How the run times of a study were taken, in words."""
    once = all(row.seconds_low == row.seconds_high for row in study.rows)
    how = "of one run each" if once else "medians over repeats after a warm-up"
    return f"Run times are {how}, with the result waited for; compiling is counted apart."


def table(study: PrecisionStudy) -> Table:
    """The rows of a precision study, all of them."""
    return Table(
        "precision",
        f"Error against run time; reference: {study.reference}",
        [
            "workload",
            "method",
            "setting",
            "error",
            "seconds",
            "seconds_low",
            "seconds_high",
            "compile_seconds",
        ],
        [
            (
                row.panel,
                row.method,
                row.setting,
                row.error,
                row.seconds,
                row.seconds_low,
                row.seconds_high,
                row.compile_seconds,
            )
            for row in study.rows
        ],
    )


def figure(study: PrecisionStudy) -> Figure:
    """Error over run time, log-log, one panel per workload and one line per method."""
    panels = list(dict.fromkeys(row.panel for row in study.rows))
    methods = list(dict.fromkeys(row.method for row in study.rows))
    floor = min((row.error for row in study.rows if row.error > 0), default=1e-16) / 2
    columns = min(2, len(panels))
    drawing, axes = new_figure(-(-len(panels) // columns), columns)
    for axis, panel in zip(axes.flat, panels, strict=False):
        for index, method in enumerate(methods):
            mine = [row for row in study.rows if (row.panel, row.method) == (panel, method)]
            if not mine:
                continue
            seconds = [row.seconds for row in mine]
            spread = [
                [row.seconds - row.seconds_low for row in mine],
                [row.seconds_high - row.seconds for row in mine],
            ]
            drawn = any(not math.isnan(row.error) for row in mine)
            axis.errorbar(
                seconds,
                [min(max(row.error, floor), LARGEST_DRAWN) for row in mine],
                xerr=spread,
                color=PALETTE[index % len(PALETTE)],
                marker=MARKERS[index % len(MARKERS)],
                linestyle="-" if index < len(PALETTE) else "--",
                elinewidth=0.8,
                label=method if drawn else None,
            )
        title = panel if len(panels) == 1 else textwrap.fill(panel, LONG_TITLE)
        axis.set(xscale="log", yscale="log", title=as_mathtext(title))
        axis.set(xlabel="run time of one call (s)", ylabel=as_mathtext(study.error))
        # Whole decades, so that every axis has labelled ticks, and only those.
        panel_rows = [row for row in study.rows if row.panel == panel]
        low = math.floor(math.log10(min(row.seconds_low for row in panel_rows)))
        high = math.ceil(math.log10(max(row.seconds_high for row in panel_rows)))
        axis.set_xlim(10.0**low, 10.0 ** max(high, low + 1))
        axis.xaxis.set_minor_formatter(NullFormatter())
        low, high = axis.get_ylim()
        if high < LARGEST_PLAIN * low:
            label_plainly(axis.yaxis)
    legend_below(drawing)
    return Figure(
        "precision",
        "Error against run time",
        "Each point is one setting of one method at its median run time; the bar spans its fastest "
        "to slowest repeat. Lower left is better. An error of exactly 0 is drawn at half the least "
        "other one, one above 10 at 10.",
        drawing,
    )
