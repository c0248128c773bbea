"""What a sweep hands back: one table of all points, those that failed, a figure per metric."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from designopt.errors import UserError
from designopt.plot import figures
from designopt.study.page import RunRecord
from designopt.study.result_folders import result_folder
from designopt.study.results import Cell, Figure, Metric, Results, Table, Target
from designopt.study.runner import write_results
from designopt.study.study import Study
from designopt.sweep.drawings import MOST_WRITTEN, Series, draw
from designopt.sweep.outcomes import Outcome
from designopt.sweep.points import Points, Value

TIMES = ("s", "ms")
"""A metric in one of these is a run time: the studies' mechanics and optics have no time. It is not
the same twice, and stays out of the tables that are."""

ALL_FOUND = Target("=", 0)


@dataclass(frozen=True)
class Swept:
    """A finished sweep.

    Attributes:
        study: which.
        points: over what.
        outcomes: what became of every point.
        settings: ``key=value`` texts that all points share.
        seed: seed of every random draw.
        dtype: float type computed in.
        versions: of the packages that shape the numbers.
    """

    study: Study
    points: Points
    outcomes: tuple[Outcome, ...]
    settings: tuple[str, ...]
    seed: int
    dtype: str
    versions: Mapping[str, str]

    @property
    def failures(self) -> list[int]:
        """The points that failed."""
        return [index for index, outcome in enumerate(self.outcomes) if outcome.failure]

    def metrics(self) -> dict[str, list[Metric | None]]:
        """Every metric's name with what each point found for it, in the order of appearance."""
        found: dict[str, list[Metric | None]] = {}
        for index, outcome in enumerate(self.outcomes):
            for metric in outcome.metrics:
                column = found.setdefault(metric.name, [None] * len(self.outcomes))
                column[index] = metric
        return found

    def columns(self, *, timed: bool) -> dict[str, list[Value | None]]:
        """The values of every metric that is a run time, or of every one that is none."""
        return {
            name: [_number(metric) for metric in column]
            for name, column in self.metrics().items()
            if (_shared(column).unit in TIMES) == timed
        }


def write_result(swept: Swept, out: Path) -> None:
    """Write tables, figures and the report, complete or not at all, over an earlier result.

    Args:
        swept: the sweep.
        out: the folder to make.

    Raises:
        UserError: it cannot be written.
    """
    points, study = swept.points, swept.study
    record = RunRecord(
        study=study.name,
        purpose=f"A sweep of {len(points)} points over {', '.join(points.keys)}: {study.purpose}",
        spec={
            "vary": _told(points),
            "set": {
                key: value for key, _, value in (text.partition("=") for text in swept.settings)
            },
        },
        seed=swept.seed,
        dtype=swept.dtype,
        device=", ".join(sorted({one.device for one in swept.outcomes if one.device})),
        versions=dict(swept.versions),
        seconds=sum(outcome.seconds for outcome in swept.outcomes),
    )
    with result_folder(out, force=True) as folder, figures.style():
        try:
            write_results(record, results(swept), folder)
        except OSError as error:
            raise UserError(f"{out}: cannot be written ({error.strerror})") from error


def results(swept: Swept) -> Results:
    """The sweep's tables and figures."""
    failures = swept.failures
    tables = [points_table(swept), extremes(swept), run_times(swept)]
    if failures:
        tables.insert(1, failed_table(swept))
    return Results(
        findings=_findings(swept),
        metrics=[
            Metric("points", len(swept.points), "", "points of the sweep"),
            Metric("failed_points", len(failures), "", "points without an answer", None, ALL_FOUND),
        ],
        tables=tables,
        figures=[
            figure
            for name, column in swept.metrics().items()
            if (figure := metric_figure(swept.points, name, column)) is not None
        ],
    )


def points_table(swept: Swept) -> Table:
    """Every point with its settings and metrics; empty cells where there is no number."""
    columns = swept.columns(timed=False)
    return Table(
        "points",
        "Every point; empty cells where a point failed or a metric has no value",
        ["point", *swept.points.keys, *columns],
        [
            (index, *row, *(column[index] for column in columns.values()))
            for index, row in enumerate(swept.points.rows)
        ],
    )


def failed_table(swept: Swept) -> Table:
    """The points that failed, with the reason."""
    return Table(
        "failed",
        "Points that failed",
        ["point", *swept.points.keys, "reason"],
        [
            (index, *swept.points.rows[index], swept.outcomes[index].failure)
            for index in swept.failures
        ],
    )


def extremes(swept: Swept) -> Table:
    """The least and the greatest value of every metric, and the points that have them."""
    rows: list[tuple[Cell, ...]] = []
    metrics = swept.metrics()
    for name, column in swept.columns(timed=False).items():
        numbers = [(value, index) for index, value in enumerate(column) if value is not None]
        if numbers:
            least, greatest = min(numbers), max(numbers, key=lambda one: (one[0], -one[1]))
            rows.append((name, _shared(metrics[name]).unit, *least, *greatest))
    return Table(
        "extremes",
        "Least and greatest value of every metric, and the first point that has it",
        ["metric", "unit", "least", "at_point", "greatest", "at_that_point"],
        rows,
    )


def run_times(swept: Swept) -> Table:
    """How long every point took; apart from the other tables, which are the same every time."""
    columns = swept.columns(timed=True)
    return Table(
        "run_times",
        "Run time of every point, shared evenly within a batch, and metrics that are run times",
        ["point", *swept.points.keys, "seconds", *columns],
        [
            (
                index,
                *row,
                swept.outcomes[index].seconds,
                *(column[index] for column in columns.values()),
            )
            for index, row in enumerate(swept.points.rows)
        ],
    )


def metric_figure(points: Points, name: str, column: list[Metric | None]) -> Figure | None:
    """A metric over what is varied; ``None`` if no point has a finite number."""
    values = [metric.value if metric and math.isfinite(metric.value) else None for metric in column]
    if all(value is None for value in values):
        return None
    shared = _shared(column)
    series = Series(name, shared.unit, values, shared.target)
    title = name.replace("_", " ")
    caption = f"{shared.description[:1].upper()}{shared.description[1:]}" or title
    return Figure(re.sub(r"[^\w.-]", "_", name), title, caption, draw(points, series))


def _findings(swept: Swept) -> list[str]:
    points, count = swept.points, len(swept.points)
    if points.grid is None:
        where = f"{count} Sobol points over {', '.join(points.keys)}"
    else:
        where = f"{count} points: " + " × ".join(
            f"{len(values)} of {key}" for key, values in zip(points.keys, points.grid, strict=True)
        )
    failures = len(swept.failures)
    ending = f"{failures} failed, and a table says why" if failures else "every point has an answer"
    return [f"{where}; {ending}."]


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
    asked = all(metric.target == first.target for metric in found)
    return Metric(
        first.name,
        first.value,
        first.unit,
        first.description if same else "",
        target=first.target if asked else None,
    )
