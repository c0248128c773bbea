"""What a study finds, put down part by part: metrics, findings, tables, figures, measurements."""

from __future__ import annotations

import importlib.resources
import math
import re
import string
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

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

WORDS = "report.md"
"""File of a study's package that holds the words of its report."""

NONE: Mapping[str, Any] = MappingProxyType({})

_ENTRY = re.compile(r"^([\w-]+)(?: \[(.*)\])?: (.*(?:\n+[ \t]+\S.*)*)", re.MULTILINE)


class Entry(NamedTuple):
    """The words of one part: its text, and what stands in brackets behind its name."""

    text: str
    notes: str


class Report:
    """The results of one run in the making; numbers come from the study, words from a text.

    The text has the sections ``# Metrics``, ``# Findings``, ``# Tables``, ``# Figures``,
    ``# Claims`` and ``# Operations``, with an entry for each part, ``name: text`` or
    ``name [notes]: text``, whose further lines are indented. Numbers stand in braces as in
    ``str.format``: metrics, settings, and what the study gives (`values`); ``{share:.0%}`` becomes
    ``34 %``, what is no number ``none``.

    * A metric's text is its description, its name ends in its unit. Its notes are, each after a
      semicolon, a target as `Target.parse` reads it, ``always`` if it applies to all settings,
      ``paper`` and a published number, ``unit`` and a unit its name does not end in, ``check`` if
      it checks the computation and is no number of the design.
    * A table's text is its caption. Its notes are the columns shown, in their order, each with its
      decimals in the report after a colon; ``*`` is all of them, such as in ``[*:4 eta:1]``.
    * A figure's first line is its title, the others are its caption.
    * A claim's first paragraph is its statement; the second one is why it should hold.
    * The first paragraph of an entry of operations is what is computed; the second one is what the
      general program has and this one does not.

    Args:
        spec: the run's settings, which decide whether targets apply
            (`designopt.study.settings.setting`); without them they do.
        words: the text.
        package: the package whose ``report.md`` is the text.

    Example:
        >>> words = '''
        ... # Metrics
        ... mean_mm [<= 2; paper 2.4]: mean error
        ... # Findings
        ... main: On average {mean_mm:.1f} mm, in {share:.0%} of the trials.
        ... # Tables
        ... errors: Errors by way
        ... '''
        >>> out = Report(words=words)
        >>> errors = Records({"way": ["a", "a", "b"], "error_mm": [1.0, -3.0, 0.5]})
        >>> out.metrics(mean_mm=errors.stat("mean_abs error_mm"))
        >>> out.table("errors", errors.summary("way", mean_mm="mean error_mm"))
        >>> out.say("main", share=0.5)
        >>> results = out.results()
        >>> results.findings, results.metrics[0].unit, results.metrics[0].met
        (['On average 1.5 mm, in 50 % of the trials.'], 'mm', True)
    """

    def __init__(
        self, spec: Spec | None = None, words: str = "", package: str | None = None
    ) -> None:
        if package is not None:
            words = (importlib.resources.files(package) / WORDS).read_text(encoding="utf-8")
        sections = re.split(r"^# (\w+)$", words, flags=re.MULTILINE)[1:]
        self._words = {
            (section, name): Entry(text, notes)
            for section, body in zip(sections[::2], sections[1::2], strict=True)
            for name, notes, text in _ENTRY.findall(body)
        }
        self.waived = "" if spec is None else targets_waived(spec)
        self._values: dict[str, Any] = {} if spec is None else dict(spec)
        self._findings: list[str] = []
        self._metrics: list[Metric] = []
        self._tables: list[Table] = []
        self._figures: list[Figure] = []
        self._files: list[SpecFile] = []
        self._precision: PrecisionStudy | None = None
        self._stability: list[StabilityRow] = []
        self._left_out: list[LeftOutRow] = []

    def __getitem__(self, name: str) -> Any:
        """The value of a metric, or of a setting."""
        return self._values[name]

    def values(self, **values: Any) -> None:
        """Values for braces, from here on."""
        self._values |= values

    def _fill(self, text: str, values: Mapping[str, Any] = NONE) -> str:
        return _Filler().vformat(" ".join(text.split()), (), {**self._values, **values})

    def metrics(self, **metrics: Any) -> None:
        """The numbers that the study stands for, by name.

        NaN is a number that was not found; ``None`` one that was not looked for, which misses no
        target.

        Raises:
            KeyError: a metric, or a value in its description, is unknown.
        """
        for name, value in metrics.items():
            self.metric(name, value)

    def metric(self, name: str, value: Any, entry: str | None = None, **values: Any) -> None:
        """One number, such as one of several that share their words.

        Args:
            name: its name.
            value: as `metrics` takes it.
            entry: where its words are, if not under its name.
            values: for braces in its words and notes.
        """
        text, notes = self._words["Metrics", entry or name]
        kinds = {note.split(" ")[0]: note.partition(" ")[2] for note in notes.split("; ")}
        kinds = {kind: self._fill(note, values) for kind, note in kinds.items()}
        relation = next((kind for kind in kinds if kind in ("=", "<=", ">=")), None)
        applies = value is not None and (not self.waived or "always" in kinds)
        target = Target.parse(f"{relation} {kinds[relation]}") if relation and applies else None
        paper = float(kinds["paper"]) if "paper" in kinds else None
        unit = kinds.get("unit", unit_of(name))
        number = math.nan if value is None else value
        number = number if isinstance(number, int) else float(number)
        self._values[name] = number
        text, is_check = self._fill(text, values), "check" in kinds
        self._metrics.append(Metric(name, number, unit, text, paper, target, is_check))

    def say(self, name: str, **values: Any) -> None:
        """A finding: its entry, filled."""
        self._findings.append(self._fill(self._words["Findings", name].text, values))

    def table(self, name: str, records: Records | None = None, /, **columns: Any) -> None:
        """A table, from records or from columns by name, arrays or sequences of one length."""
        text, notes = self._words["Tables", name]
        whole: Any = columns if records is None else records
        chosen: dict[str, str] = {}
        for column, _, decimals in (token.partition(":") for token in (notes or "*").split()):
            chosen |= dict.fromkeys(whole.keys() if column == "*" else [column], decimals)
        cells = {column: [_cell(value) for value in whole[column]] for column in chosen}
        places = {column: int(number) for column, number in chosen.items() if number}
        self._tables.append(Table.of_columns(name, self._fill(text), cells, places))

    def figure(self, name: str, drawing: MatplotlibFigure, *, most: int = 3, **values: Any) -> None:
        """A figure of any kind; `designopt.study.plots` draws the usual ones.

        Args:
            name: of its files and of its words.
            drawing: it; where it has no legend, one is put below its axes.
            most: columns of that legend, at most.
            values: for its title and caption.
        """
        labelled = any(one.get_legend_handles_labels()[1] for one in drawing.axes)
        if labelled and not (drawing.legends or any(one.get_legend() for one in drawing.axes)):
            from designopt.plot.figures import legend_below  # Matplotlib loads when it is needed

            legend_below(drawing, most=most)
        title, _, caption = self._words["Figures", name].text.partition("\n")
        self._figures.append(
            Figure(name, self._fill(title, values), self._fill(caption, values), drawing)
        )

    def claim(self, name: str, evidence: Sequence[str], holds: bool, **values: Any) -> Claim:
        """A claim of `precision`: its words, what this run measured, and whether it holds."""
        statement, _, mechanism = self._words["Claims", name].text.partition("\n\n")
        return Claim(self._fill(statement, values), self._fill(mechanism, values), evidence, holds)

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

    def operations(self, name: str, scene: int, general: int) -> None:
        """What a scene did not need: its words, and the operations of both programs.

        Args:
            name: of its words.
            scene: operations (`designopt.count_operations`) of the program for this scene.
            general: those of the general one.
        """
        asked, _, left_out = self._words["Operations", name].text.partition("\n\n")
        self._left_out.append(LeftOutRow(self._fill(asked), self._fill(left_out), scene, general))

    def left_out(self, rows: Sequence[LeftOutRow]) -> None:
        """What a scene did not need (`designopt.study.left_out`)."""
        self._left_out += rows

    def results(self) -> Results:
        """All of it."""
        return Results(
            self._findings,
            self._metrics,
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


def _cell(value: Any) -> Cell:
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and math.isnan(value) else value
