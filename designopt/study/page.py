"""One self-contained page about a run, for the screen and for paper."""

from __future__ import annotations

import base64
import dataclasses
import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
from markupsafe import Markup
from PIL import Image

from designopt.plot import figures
from designopt.plot.typesetting import as_html, heading
from designopt.study import benchmark, plots, stability
from designopt.study.results import Cell, Claim, Figure, Results, Table

MOST_ROWS, NOTEBOOK_ROWS = 200, 20
"""Rows of a table in a report and in a notebook; the others are in its file."""

LARGEST_FILE = 300_000
"""Bytes of a figure in a report: a larger drawing is shown by its pixels, which are compressed."""


class RunRecord(NamedTuple):
    """How a study was run, beside what it found.

    Attributes:
        study: its name.
        purpose: its one line.
        spec: every setting as run.
        seed: seed of every random draw.
        dtype: float type.
        device: what it ran on, in words.
        versions: of Python and of the packages that shape the numbers.
        seconds: run time of the study itself, without writing its results.
    """

    study: str
    purpose: str
    spec: dict[str, Any]
    seed: int
    dtype: str
    device: str
    versions: dict[str, str]
    seconds: float


class Measurement(NamedTuple):
    """A part of the report that every study shows in the same way.

    Attributes:
        title: heading.
        lead: what was measured, in a sentence or two.
        claims: of the study, where it has any.
        figures: its figures.
        tables: its tables.
    """

    title: str
    lead: str
    claims: Sequence[Claim]
    figures: Sequence[Figure]
    tables: Sequence[Table]


def measurements(results: Results) -> list[Measurement]:
    """The measurements among ``results``: run time, stability and what was left out."""
    parts, study = [], results.precision
    if study:
        figure = Figure(
            "precision",
            "Error against run time",
            "Each point is one setting of one method at its median run time; the bar spans its "
            "fastest to slowest repeat. Lower left is better. An error of exactly 0 is drawn at "
            f"half the least other one, one above {plots.LARGEST_ERROR:g} there.",
            plots.precision(study),
        )
        lead = (
            f"{study.error[0].upper()}{study.error[1:]}, against {study.reference}. "
            f"{benchmark.timing(study)}"
        )
        caption = f"Error against run time; reference: {study.reference}"
        table = _table("precision", caption, study.rows, workload="panel")
        parts.append(Measurement("Error against run time", lead, study.claims, [figure], [table]))
    if results.stability:
        figure = Figure(
            "stability",
            "Worst error in stiff and extreme cases",
            "Errors are scaled by the conditioning of each case. The dotted lines mark the "
            "rounding of each float type, below which nothing can be asked; an error far below it "
            "is drawn at an eighth of it. Inputs are rounded to the float type first, so the "
            "cases of the two differ.",
            plots.stability(results.stability),
        )
        lead = (
            "Stiff and extreme cases, each judged against the exact answer for the same "
            f"floating-point inputs in {stability.DIGITS} digits. A case fails if feasibility "
            f"is misjudged, if its value is off by more than {stability.VALUE_TOLERANCE:g} "
            f"units of rounding, or a gradient by more than {stability.GRADIENT_TOLERANCE:g}, "
            "on the scale of the case's conditioning."
        )
        caption = f"Stiff and extreme cases against {stability.DIGITS}-digit arithmetic"
        table = _table("stability", caption, results.stability)
        parts.append(Measurement("Stability", lead, [], [figure], [table]))
    if results.left_out:
        lead = (
            "Structure is analysed before compiling, so what a scene does not use is never part "
            "of its program. Operations are those of the optimised program; a loop's body counts "
            "once."
        )
        caption = "Operations in the compiled programs: for this scene, and in general"
        table = _table("left_out", caption, results.left_out)
        parts.append(Measurement("What was left out", lead, [], [], [table]))
    return parts


def _table(name: str, title: str, rows: Sequence[Any], **renamed: str) -> Table:
    """Rows of a dataclass: columns under another name, then the others but for single samples."""
    left_out = {*renamed.values(), "samples"}
    named = [field.name for field in dataclasses.fields(rows[0])]
    fields = renamed | {column: column for column in named if column not in left_out}
    cells = [[getattr(row, field) for field in fields.values()] for row in rows]
    return Table(name, title, list(fields), cells)


def render_report(
    record: RunRecord, results: Results, measured: Sequence[Measurement], folder: Path
) -> str:
    """The report as one HTML text, with every figure inside it.

    Names and symbols in it are typeset: see `designopt.plot.typesetting`.

    Args:
        record: how the study was run.
        results: what it found.
        measured: `measurements` of the same results.
        folder: where the figures have been written (``figures/<name>.svg`` and ``.png``).
    """

    def source(figure: Figure) -> str:
        svg = folder / "figures" / f"{figure.name}.svg"
        if svg.stat().st_size <= LARGEST_FILE:
            return _data("svg+xml", svg.read_bytes())
        png = svg.with_suffix(".png")
        if png.stat().st_size <= LARGEST_FILE:
            return _data("png", png.read_bytes())
        compressed = io.BytesIO()
        Image.open(png).convert("RGB").save(compressed, "JPEG", quality=90)
        return _data("jpeg", compressed.getvalue())

    return (
        _environment(source, MOST_ROWS)
        .get_template("report.html.j2")
        .render(
            record=record, results=results, measured=measured, settings=list(_flat(record.spec))
        )
    )


def render_results(results: Results) -> str:
    """Results as a piece of HTML, for a notebook: findings, metrics, figures and tables."""

    def source(figure: Figure) -> str:
        picture = io.BytesIO()
        with figures.style():
            figure.drawing.savefig(picture, format="png", dpi=110)
        return _data("png", picture.getvalue())

    measured = measurements(results)
    return (
        _environment(source, NOTEBOOK_ROWS)
        .get_template("results.html.j2")
        .render(
            results=results,
            drawn=[*results.figures, *(figure for part in measured for figure in part.figures)],
            tables=[*results.tables, *(table for part in measured for table in part.tables)],
        )
    )


def _environment(source: Callable[[Figure], str], most: int) -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("designopt"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["most"] = most
    environment.filters |= {
        "typeset": lambda text: Markup(as_html(text)),
        "heading": heading,
        "source": source,
        "width": lambda figure: 100 * figure.drawing.get_figwidth() / figures.TEXT_WIDTH,
        "number": _number,
        "cell": _cell,
    }
    return environment


def _data(kind: str, content: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _flat(spec: dict[str, Any], prefix: str = "") -> Any:
    for key, value in spec.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if math.isfinite(value) else "none"


def _cell(table: Table, column: int, value: Cell) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, (int, float)):
        return str(value)
    places = table.places.get(table.columns[column])
    if places is not None:
        return f"{value:.{places}f}"
    return str(value) if isinstance(value, int) else f"{value:.4g}"
