"""The study's figures."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

from designopt.plot.figures import MARKERS, PALETTE, legend_below, new_figure
from designopt.study import benchmark as run_time
from designopt.study.results import Figure, PrecisionStudy
from studies.benchmarks.linkage.contenders import FLOOR
from studies.benchmarks.linkage.measuring import Measured
from studies.benchmarks.linkage.statements import fastest

TITLES = {
    "float32": "Error against run time in float32",
    "short": "Error against run time of one pose and of few",
}


def further(
    groups: Mapping[str, Sequence[Measured]], error: str, reference: str
) -> Iterator[Figure]:
    """The rows that the report's own figure has no room for, one figure per group."""
    for name, rows in groups.items():
        if rows:
            study = PrecisionStudy([m.row for m in rows], error, reference, [])
            drawn = run_time.figure(study)
            yield dataclasses.replace(drawn, name=f"precision_{name}", title=TITLES[name])


def throughput(rows: Sequence[Measured]) -> Figure:
    """Poses a second over the length of the sweep, one panel per linkage."""
    shown = [m for m in rows if m.work.dtype == "float64" and not m.work.gradient]
    methods = list(dict.fromkeys(m.row.method for m in shown))
    names = list(dict.fromkeys(m.work.case.name for m in shown))
    drawing, axes = new_figure(1, len(names), height=4.4)
    for axis, name in zip(axes.flat, names, strict=True):
        for index, method in enumerate(methods):
            mine = [m for m in shown if (m.work.case.name, m.row.method) == (name, method)]
            best = {m.work.poses: fastest(mine, m.work.poses) for m in mine}
            points = sorted((n, n / m.row.seconds) for n, m in best.items() if m is not None)
            floor = method == FLOOR
            axis.plot(
                [n for n, _ in points],
                [rate for _, rate in points],
                color="0.4" if floor else PALETTE[index % len(PALETTE)],
                marker="" if floor else MARKERS[index % len(MARKERS)],
                linestyle="--" if floor else "-",
                label=method,
            )
        axis.set(xscale="log", yscale="log", title=name, xlabel="poses of the sweep")
    bounds = [axis.get_ylim() for axis in axes.flat]
    for axis in axes.flat:
        axis.set_ylim(min(low for low, _ in bounds), max(high for _, high in bounds))
    axes[0, 0].set_ylabel("poses per second")
    legend_below(drawing)
    return Figure(
        "throughput",
        "Poses per second over the length of the sweep",
        "Float64 on one core; of each method the fastest setting whose error is below 1e-9 of the "
        "linkage's size. Dashed: sine and cosine of the same angles and nothing else. The other "
        "tools solve a part of a long sweep, and their time is scaled.",
        drawing,
    )
