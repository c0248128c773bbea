"""What a sweep hands back: one table of all points, those that failed, a figure per metric."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from designopt.errors import UserError
from designopt.plot import figures
from designopt.plot.typesetting import heading
from designopt.study.page import RunRecord
from designopt.study.result_folders import result_folder
from designopt.study.results import Cell, Figure, Metric, Results, Table, Target
from designopt.study.runner import write_results
from designopt.sweep.drawings import MOST_WRITTEN, Series, draw
from designopt.sweep.outcomes import Outcome
from designopt.sweep.points import Points, Sweep, Value

TIMES = ("s", "ms")
"""A metric in one of these is a run time: the studies' mechanics and optics have no time. It is not
the same twice, and stays out of the tables that are."""

Columns = Sequence[tuple[str, Sequence[Any]]]
"""Names with what every point has there."""

ALL_FOUND = Target("=", 0)


def write_result(sweep: Sweep, outcomes: Sequence[Outcome], out: Path) -> None:
    """Write tables, figures and the report, complete or not at all, over an earlier result.

    Args:
        sweep: what was asked for.
        outcomes: what became of every point.
        out: the folder to make.

    Raises:
        UserError: it cannot be written.
    """
    points, study = sweep.points, sweep.study
    record = RunRecord(
        study=study.name,
        purpose=f"A sweep of {len(points)} points over {', '.join(points.keys)}: {study.purpose}",
        spec={"vary": _told(points), "set": dict(text.split("=", 1) for text in sweep.settings)}
        | ({"config": dict(sweep.config.tables)} if sweep.config.tables else {}),
        seed=sweep.seed,
        dtype=sweep.dtype,
        device=", ".join(sorted({one.device for one in outcomes if one.device})),
        versions=dict(sweep.versions),
        seconds=sum(outcome.seconds for outcome in outcomes),
    )
    with result_folder(out, force=True) as folder, figures.style():
        try:
            write_results(record, results(points, outcomes), folder)
        except OSError as error:
            raise UserError(f"{out}: cannot be written ({error.strerror})") from error


def results(points: Points, outcomes: Sequence[Outcome]) -> Results:
    """A sweep's tables and figures; all tables but that of run times are the same every time."""
    metrics = metrics_of(outcomes)
    units = {name: _shared(column).unit for name, column in metrics.items()}
    values = {name: [_number(metric) for metric in column] for name, column in metrics.items()}
    constant = [
        name for name, column in values.items() if units[name] not in TIMES and _is_constant(column)
    ]
    steady = [
        (name, column)
        for name, column in values.items()
        if units[name] not in TIMES and name not in constant
    ]
    timed = [(name, column) for name, column in values.items() if units[name] in TIMES]
    failures = [index for index, outcome in enumerate(outcomes) if outcome.failure]

    def table(name: str, title: str, columns: Columns, which: Iterable[int]) -> Table:
        rows = [(i, *points.rows[i], *(column[i] for _, column in columns)) for i in which]
        return Table(name, title, ["point", *points.keys, *(one for one, _ in columns)], rows)

    every, reasons = range(len(points)), [outcome.failure for outcome in outcomes]
    times = [("seconds", [outcome.seconds for outcome in outcomes]), *timed]
    cells = "Every point; empty cells where a point failed or a metric has no value"
    shares = "Run time of every point, shared evenly within a batch, and metrics that are run times"
    tables = [
        table("points", cells, steady, every),
        table("failed", "Points that failed", [("reason", reasons)], failures),
        _extremes(steady, units),
        table("run_times", shares, times, every),
    ]
    drawn = [
        metric_figure(points, name, column)
        for name, column in metrics.items()
        if name not in constant
    ]
    findings = [_finding(points, len(failures))]
    if constant:
        named = "; ".join(_in_words(_shared(metrics[name]), values[name]) for name in constant)
        findings.append(f"The same at every point that has an answer: {named}.")
    return Results(
        findings=findings,
        metrics=[
            Metric("points", len(points), "", "points of the sweep"),
            Metric("failed_points", len(failures), "", "points without an answer", None, ALL_FOUND),
        ],
        tables=[one for one in tables if one.name != "failed" or failures],
        figures=[figure for figure in drawn if figure is not None],
    )


def metrics_of(outcomes: Sequence[Outcome]) -> dict[str, list[Metric | None]]:
    """Every metric's name with what each point found for it, in the order of appearance."""
    found: dict[str, list[Metric | None]] = {}
    for index, outcome in enumerate(outcomes):
        for metric in outcome.metrics:
            found.setdefault(metric.name, [None] * len(outcomes))[index] = metric
    return found


def _is_constant(column: Sequence[Value | None]) -> bool:
    """Whether several points have one value, or none has any: no column or figure shows more."""
    found = [value for value in column if value is not None]
    return not found or (len(found) > 1 and len(set(found)) == 1)


def _in_words(metric: Metric, column: Sequence[Value | None]) -> str:
    """A constant metric and its value: ``reflections, 2``."""
    words = metric.description or heading(metric.name)
    found = next((value for value in column if value is not None), None)
    return f"{words}, none" if found is None else f"{words}, {found:.6g} {metric.unit}".rstrip()


def _extremes(columns: Columns, units: Mapping[str, str]) -> Table:
    """The least and the greatest value of every metric, and the points that have them."""
    rows: list[tuple[Cell, ...]] = []
    for name, column in columns:
        numbers = [(value, index) for index, value in enumerate(column) if value is not None]
        if numbers:
            least, greatest = min(numbers), max(numbers, key=lambda one: (one[0], -one[1]))
            rows.append((name, units[name], *least, *greatest))
    return Table(
        "extremes",
        "Least and greatest value of every metric, and the first point that has it",
        ["metric", "unit", "least", "at_point", "greatest", "at_that_point"],
        rows,
    )


def metric_figure(points: Points, name: str, column: list[Metric | None]) -> Figure | None:
    """A metric over what is varied; ``None`` if no point has a finite number."""
    values = np.array([metric.value if metric else math.nan for metric in column], float)
    values[~np.isfinite(values)] = math.nan
    if np.isnan(values).all():
        return None
    shared = _shared(column)
    series = Series(name, shared.unit, values, shared.target)
    title = name.replace("_", " ")
    caption = f"{shared.description[:1].upper()}{shared.description[1:]}" or title
    return Figure(re.sub(r"[^\w.-]", "_", name), title, caption, draw(points, series))


def _finding(points: Points, failures: int) -> str:
    if points.grid is None:
        where = f"{len(points)} Sobol points over {', '.join(points.keys)}"
    else:
        where = f"{len(points)} points: " + " × ".join(
            f"{len(values)} of {key}" for key, values in zip(points.keys, points.grid, strict=True)
        )
    ending = f"{failures} failed, and a table says why" if failures else "every point has an answer"
    return f"{where}; {ending}."


def _told(points: Points) -> dict[str, Any]:
    """What makes the points, without long lists of values: the table of all points has them."""
    if points.grid is None:
        return dict(points.definition)
    return {
        key: list(values)
        if len(values) <= MOST_WRITTEN
        else f"{len(values)} values from {min(values)} to {max(values)}"
        for key, values in zip(points.keys, points.grid, strict=True)
    }


def _number(metric: Metric | None) -> Value | None:
    # NaN, which equals nothing, is the absence of a value.
    return None if metric is None or metric.value != metric.value else metric.value


def _shared(column: list[Metric | None]) -> Metric:
    """A metric as all points have it: without description or target where these differ."""
    found = [metric for metric in column if metric is not None]
    first = found[0]
    same = all(metric.description == first.description for metric in found)
    target = first.target if all(metric.target == first.target for metric in found) else None
    words = first.description if same else ""
    return Metric(first.name, first.value, first.unit, words, target=target)
