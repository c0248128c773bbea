"""What a study hands back: metrics, tables, figures and measurements, all plain data.

Nothing here imports JAX or Matplotlib, so a study can be listed and its spec checked cheaply.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from designopt.io.spec import SpecFile

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

Cell = float | int | str | bool | None


@dataclass(frozen=True)
class Target:
    """The figure a metric is asked to reach.

    Attributes:
        relation: ``"="`` (within ``tolerance``), ``"<="`` or ``">="``.
        value: the asked figure, in the metric's unit.
        tolerance: half-width of the accepted band around ``value``; only with ``"="``.
    """

    relation: Literal["=", "<=", ">="]
    value: float
    tolerance: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Target:
        """A target as people write it: ``"<= 0.5"``, ``">= 0.95"``, ``"= 8.616 ± 0.005"``.

        Raises:
            ValueError: it is none.

        Example:
            >>> Target.parse("= 8.616 ± 0.005").met_by(8.618)
            True
        """
        found = re.fullmatch(r"\s*(=|<=|>=)\s*([^±\s]+)(?:\s*±\s*(\S+))?\s*", text)
        if found is None or (found[3] and found[1] != "="):
            raise ValueError(f"{text!r} is no target: write <=, >= or =, a number, and ± a number")
        return cls(found[1], float(found[2]), float(found[3] or 0))  # type: ignore[arg-type]

    def met_by(self, value: float) -> bool:
        """Whether ``value`` reaches the target; a value that is not finite never does."""
        if not math.isfinite(value):
            return False
        if self.relation == "<=":
            return value <= self.value
        if self.relation == ">=":
            return value >= self.value
        return abs(value - self.value) <= self.tolerance

    def __str__(self) -> str:
        if self.relation == "=":
            return f"{self.value:g} ± {self.tolerance:g}" if self.tolerance else f"{self.value:g}"
        return f"{'≤' if self.relation == '<=' else '≥'} {self.value:g}"


@dataclass(frozen=True)
class Metric:
    """One number that a study stands for.

    Attributes:
        name: key in ``results.json``; ends in the unit where it has one (``_mm``, ``_deg``).
        value: the number found; NaN where there is none (``null`` in ``results.json``).
        unit: unit of ``value``, ``reference`` and ``target``; empty for a pure number.
        description: what it is, in words, for the report.
        reference: a published figure to compare with, where there is one.
        target: the figure asked for, where there is one.
        is_check: whether it checks the computation, such as an error against a reference, and is
            no number of the design; the report has these apart.
    """

    name: str
    value: float
    unit: str
    description: str
    reference: float | None = None
    target: Target | None = None
    is_check: bool = False

    @property
    def met(self) -> bool | None:
        """Whether the target is met; ``None`` where none is set."""
        return None if self.target is None else self.target.met_by(self.value)


@dataclass(frozen=True)
class Table:
    """A table, written to ``tables/<name>.csv`` in full precision and shown in the report.

    Attributes:
        name: file name without its ending.
        title: caption in the report.
        columns: column names; each ends in its unit.
        rows: one sequence of cells per row, as long as ``columns``; ``None`` is an empty cell.
        places: decimals shown in the report, per column; a column left out shows four digits.
    """

    name: str
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    places: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def of_columns(
        cls,
        name: str,
        title: str,
        columns: Mapping[str, Sequence[Cell]],
        places: Mapping[str, int] | None = None,
    ) -> Table:
        """A table from its columns, all of one length."""
        rows = list(zip(*columns.values(), strict=True))
        return cls(name, title, list(columns), rows, places or {})


@dataclass(frozen=True)
class Figure:
    """A drawing, written to ``figures/<name>.png`` and ``.svg`` and shown in the report."""

    name: str
    title: str
    caption: str
    drawing: MatplotlibFigure


@dataclass(frozen=True)
class PrecisionRow:
    """One method at one setting: its error beside its run time.

    Attributes:
        method: name of the method.
        setting: what was varied for it (tolerance, number of problems, dtype).
        panel: the workload, whose rows are compared with each other and drawn together.
        error: worst error against the stated reference.
        seconds: median run time of one call, with its result waited for.
        seconds_low: fastest repeat.
        seconds_high: slowest repeat.
        compile_seconds: time to compile, 0 where nothing is compiled.
        samples: run times of one call, one for each round.
    """

    method: str
    setting: str
    panel: str
    error: float
    seconds: float
    seconds_low: float
    seconds_high: float
    compile_seconds: float
    samples: tuple[float, ...] = ()


@dataclass(frozen=True)
class Claim:
    """A claim of a precision study that one run can prove wrong.

    Attributes:
        statement: what is claimed.
        mechanism: why it should be so.
        evidence: what this run measured, one sentence per workload.
        holds: whether this run confirms the claim.
    """

    statement: str
    mechanism: str
    evidence: Sequence[str]
    holds: bool


@dataclass(frozen=True)
class PrecisionStudy:
    """Error against run time, with the reference and the claims.

    Attributes:
        rows: one per method and setting.
        error: what the error is of, for axes and table heads.
        reference: what it is measured against, in words.
        claims: sentences about the rows.
    """

    rows: Sequence[PrecisionRow]
    error: str
    reference: str
    claims: Sequence[Claim]


@dataclass(frozen=True)
class StabilityRow:
    """One family of stiff or extreme cases, judged against high-precision arithmetic.

    Attributes:
        case: what is extreme in it.
        dtype: float type of the inputs and of the arithmetic.
        cases: how many were tried.
        infeasible: how many of them have no answer, and were to be reported so.
        failures: cases answered wrongly: feasibility misjudged, or an error above tolerance.
        worst_error: largest error of a value over the feasible cases, relative to the value and
            to what an input changed by its own size would do to it (``designopt.study.stability``).
        worst_gradient_error: the same of a gradient's entries.
        worst_gradient_relative_error: largest deviation of an entry relative to that entry alone,
            which the cancellation within a small entry may make large.
        non_finite: numbers among values, margins, residuals and gradients that are not finite.
    """

    case: str
    dtype: str
    cases: int
    infeasible: int
    failures: int
    worst_error: float
    worst_gradient_error: float
    worst_gradient_relative_error: float
    non_finite: int


@dataclass(frozen=True)
class LeftOutRow:
    """What a scene did not need, as operation counts of two compiled programs.

    Attributes:
        asked: what was computed.
        left_out: what the general program has and this one does not.
        scene_operations: operations in the program compiled for this scene.
        general_operations: operations in the general program, asked for the same.
    """

    asked: str
    left_out: str
    scene_operations: int
    general_operations: int


@dataclass(frozen=True)
class Results:
    """Everything a study found.

    Attributes:
        findings: plain sentences, most important first.
        metrics: the numbers it stands for.
        tables: its tables.
        figures: its figures.
        specs: files of what was designed, for other commands.
        precision: error against run time, where it was measured.
        stability: stiff and extreme cases.
        left_out: what this scene did not need.
        waived: why targets do not apply to these settings; empty if they do.
    """

    findings: Sequence[str]
    metrics: Sequence[Metric]
    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()
    specs: Sequence[SpecFile] = ()
    precision: PrecisionStudy | None = None
    stability: Sequence[StabilityRow] = ()
    left_out: Sequence[LeftOutRow] = ()
    waived: str = ""

    @property
    def design_numbers(self) -> list[Metric]:
        """The metrics that are no checks of the computation."""
        return [metric for metric in self.metrics if not metric.is_check]

    @property
    def checks(self) -> list[Metric]:
        """The metrics that check the computation."""
        return [metric for metric in self.metrics if metric.is_check]

    @property
    def unmet(self) -> list[Metric]:
        """The metrics whose target was missed."""
        return [metric for metric in self.metrics if metric.met is False]

    def _repr_html_(self) -> str:
        """What a notebook shows of them."""
        from designopt.study.page import render_results

        return render_results(self)
