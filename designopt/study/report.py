"""What a study finds, put down line by line: metrics, findings, tables, figures, measurements."""

from __future__ import annotations

import math
import string
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from designopt.io.spec import Spec, SpecFile
from designopt.plot.typesetting import unit_of
from designopt.study.records import Records
from designopt.study.results import (
    Cell,
    Claim,
    Figure,
    LeftOutRow,
    Metric,
    PrecisionRow,
    PrecisionStudy,
    Results,
    StabilityRow,
    Table,
    Target,
)
from designopt.study.settings import targets_waived

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure


class Report:
    """The results of one run in the making.

    Args:
        spec: the run's settings, which decide whether targets apply
            (`designopt.study.settings.setting`); without them they do.

    Example:
        >>> out = Report()
        >>> errors = Records({"way": ["a", "a", "b"], "error_mm": [1.0, -3.0, 0.5]})
        >>> out.metric("mean_mm", errors.stat("mean_abs error_mm"), "mean error", "<= 2", paper=2.4)
        >>> out.table("errors", "Errors", errors.summary("way", mean_mm="mean error_mm"))
        >>> out.say("On average {mean_mm:.1f} mm, in {share:.0%} of the trials.", share=0.5)
        >>> results = out.results()
        >>> results.findings, results.metrics[0].unit, results.metrics[0].met
        (['On average 1.5 mm, in 50 % of the trials.'], 'mm', True)
    """

    def __init__(self, spec: Spec | None = None) -> None:
        self.waived = "" if spec is None else targets_waived(spec)
        self._findings: list[str] = []
        self._metrics: dict[str, Metric] = {}
        self._tables: list[Table] = []
        self._figures: list[Figure] = []
        self._files: list[SpecFile] = []
        self._precision: PrecisionStudy | None = None
        self._stability: list[StabilityRow] = []
        self._left_out: list[LeftOutRow] = []

    def __getitem__(self, name: str) -> float:
        """The value of a metric."""
        return self._metrics[name].value

    def metric(
        self,
        name: str,
        value: Any,
        description: str,
        target: str | None = None,
        *,
        paper: float | None = None,
        unit: str | None = None,
        always: bool = False,
    ) -> None:
        """A number that the study stands for.

        Args:
            name: key in ``results.json``, ending in the unit.
            value: the number; NaN where none was found, ``None`` where none was looked for, which
                misses no target.
            description: what it is, for the report.
            target: what is asked of it, as `Target.parse` reads it.
            paper: a published number beside it.
            unit: where the name does not end in it.
            always: whether the target applies whatever the settings are.
        """
        asked = None
        if target is not None and value is not None and (always or not self.waived):
            asked = Target.parse(target)
        number = math.nan if value is None else value if isinstance(value, int) else float(value)
        written = unit_of(name) if unit is None else unit
        self._metrics[name] = Metric(name, number, written, description, paper, asked)

    def say(self, template: str, **values: Any) -> None:
        """A finding, with the metrics given so far in braces, and further values.

        Formats are Python's; ``%`` writes a share as ``34 %``, and what is no number as ``none``.
        """
        numbers = {name: metric.value for name, metric in self._metrics.items()}
        self._findings.append(_Filler().vformat(template, (), {**numbers, **values}))

    def table(
        self,
        name: str,
        title: str,
        columns: Records | Mapping[str, Sequence[Any] | np.ndarray],
        show: str = "*",
    ) -> None:
        """A table.

        Args:
            name: of its file.
            title: its caption.
            columns: their values by name, which ends in the unit.
            show: names of the columns to be shown, in their order, each with the decimals of the
                report after a colon, such as ``"eta:1 angle_deg:3"``; ``*`` is all the others.
        """
        names = columns.names if isinstance(columns, Records) else list(columns)
        places = dict(token.partition(":")[::2] for token in show.split())
        others = places.get("*")
        chosen: dict[str, str] = {}
        for token, decimals in places.items():
            rest = [name for name in names if name not in places]
            chosen |= dict.fromkeys(rest, others or "") if token == "*" else {token: decimals}
        cells = {name: [_cell(value) for value in _list(columns[name])] for name in chosen}
        decimals = {name: int(number) for name, number in chosen.items() if number}
        self._tables.append(Table.of_columns(name, title, cells, decimals))

    def figure(
        self, name: str, title: str, caption: str, drawing: MatplotlibFigure, most: int = 3
    ) -> None:
        """A figure of any kind; `designopt.study.plots` draws the usual ones.

        Args:
            name: of its files.
            title: its title.
            caption: what it shows.
            drawing: it; where it has no legend, one is put below its axes.
            most: columns of that legend, at most.
        """
        from designopt.plot.figures import legend_below  # Matplotlib loads when it is needed

        labelled = any(one.get_legend_handles_labels()[1] for one in drawing.axes)
        if labelled and not (drawing.legends or any(one.get_legend() for one in drawing.axes)):
            legend_below(drawing, most=most)
        self._figures.append(Figure(name, title, caption, drawing))

    def file(self, file: SpecFile) -> None:
        """A file of what was designed."""
        self._files.append(file)

    def precision(
        self, rows: Sequence[PrecisionRow], error: str, reference: str, *claims: Claim
    ) -> None:
        """Error against run time (`designopt.study.benchmark`); nothing where there are no rows.

        Args:
            rows: of all methods.
            error: what the error is of.
            reference: what it is measured against.
            claims: what the rows show.
        """
        if rows:
            self._precision = PrecisionStudy(rows, error, reference, claims)

    def stability(self, rows: Sequence[StabilityRow]) -> None:
        """Stiff and extreme cases (`designopt.study.stability`)."""
        self._stability += rows

    def left_out(self, rows: Sequence[LeftOutRow]) -> None:
        """What a scene did not need (`designopt.study.left_out`)."""
        self._left_out += rows

    def results(self) -> Results:
        """All of it."""
        return Results(
            self._findings,
            list(self._metrics.values()),
            self._tables,
            self._figures,
            self._files,
            self._precision,
            self._stability,
            self._left_out,
            self.waived,
        )


class _Filler(string.Formatter):
    """Fills braces as ``str.format`` does, with shares in per cent as they are set in print."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, float) and not math.isfinite(value):
            return "none"
        if format_spec.endswith("%"):
            return f"{100 * value:{format_spec[:-1]}f} %"
        return super().format_field(value, format_spec)


def _list(values: Any) -> list[Any]:
    return values.tolist() if isinstance(values, np.ndarray) else list(values)


def _cell(value: Any) -> Cell:
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and math.isnan(value) else value
