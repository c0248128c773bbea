"""Error against run time: every method at every setting, measured the same way.

A study states its workloads as `Contender`s; `measure` times and checks them, `draw` shows them
on a log-log plane, and a `Claim` says in words what they show and whether this run bears it out.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax

from designopt.figures import MARKERS, PALETTE, new_figure
from designopt.results import PrecisionRow

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    """

    method: str
    setting: str
    panel: str
    call: Callable[[], Any]
    error: Callable[[Any], float]
    compile_seconds: float = 0.0


def compile_timed(
    function: Callable[..., Any], *args: Any
) -> tuple[Callable[..., Any], float]:
    """``function`` compiled for arguments like ``args``, and the seconds that took."""
    start = time.perf_counter()
    compiled = jax.jit(function).lower(*args).compile()
    return compiled, time.perf_counter() - start


def measure(contender: Contender, *, repeats: int = 7) -> PrecisionRow:
    """Time one contender, after a warm-up and with its result waited for, and take its error.

    Returns:
        A row with the median and the range of ``repeats`` samples. Seconds are per call.
    """
    start = time.perf_counter()
    answer = jax.block_until_ready(contender.call())  # the warm-up, and a first estimate
    estimate = time.perf_counter() - start
    calls = max(1, math.ceil(MIN_SAMPLE_SECONDS / max(estimate, 1e-9)))
    samples = []
    for _ in range(repeats):
        start = time.perf_counter()
        for _ in range(calls):
            jax.block_until_ready(contender.call())
        samples.append((time.perf_counter() - start) / calls)
    return PrecisionRow(
        method=contender.method,
        setting=contender.setting,
        panel=contender.panel,
        error=contender.error(answer),
        seconds=statistics.median(samples),
        seconds_low=min(samples),
        seconds_high=max(samples),
        compile_seconds=contender.compile_seconds,
    )


def dominating(row: PrecisionRow, rows: Iterable[PrecisionRow]) -> list[PrecisionRow]:
    """Rows of the same panel that are both faster (even in their slowest repeat) and closer."""
    return [
        other
        for other in rows
        if other.panel == row.panel
        and other.error < row.error
        and other.seconds_high < row.seconds_low
    ]


def draw(rows: Sequence[PrecisionRow], *, error_label: str) -> Figure:
    """Error over run time, log-log, one panel per workload and one line per method.

    Errors of exactly 0 are drawn at the lower edge, at half the least positive error.
    """
    panels = list(dict.fromkeys(row.panel for row in rows))
    methods = list(dict.fromkeys(row.method for row in rows))
    floor = min((row.error for row in rows if row.error > 0), default=1e-16) / 2
    columns = min(2, len(panels))
    figure, axes = new_figure(-(-len(panels) // columns), columns, legend_space=True)
    for axis, panel in zip(axes.flat, panels, strict=False):
        for index, method in enumerate(methods):
            mine = [row for row in rows if row.panel == panel and row.method == method]
            if not mine:
                continue
            seconds = [row.seconds for row in mine]
            axis.errorbar(
                seconds,
                [max(row.error, floor) for row in mine],
                xerr=[
                    [row.seconds - row.seconds_low for row in mine],
                    [row.seconds_high - row.seconds for row in mine],
                ],
                color=PALETTE[index % len(PALETTE)],
                marker=MARKERS[index % len(MARKERS)],
                linestyle="-" if index < len(PALETTE) else "--",
                label=method,
            )
        axis.set(xscale="log", yscale="log", title=panel)
        axis.set(xlabel="run time of one call (s)", ylabel=error_label)
    figure.legend(*axes.flat[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
