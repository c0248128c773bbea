"""One self-contained page about a run, for the screen and for paper."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
from markupsafe import Markup

from designopt.plot import figures
from designopt.plot.typesetting import as_html, heading
from designopt.study import benchmark, left_out, stability
from designopt.study.results import Cell, Claim, Figure, Results, Table

MOST_ROWS, NOTEBOOK_ROWS = 200, 20
"""Rows of a table in a report and in a notebook; the others are in its file."""

LARGEST_SVG = 300_000
"""Bytes of a drawing in a report; a larger one is shown by its pixels."""


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
    parts = []
    if results.precision:
        parts.append(
            Measurement(
                "Error against run time",
                f"{results.precision.error[0].upper()}{results.precision.error[1:]}, against "
                f"{results.precision.reference}. {benchmark.timing(results.precision)}",
                results.precision.claims,
                [benchmark.figure(results.precision)],
                [benchmark.table(results.precision)],
            )
        )
    if results.stability:
        parts.append(
            Measurement(
                "Stability",
                "Stiff and extreme cases, each judged against the exact answer for the same "
                f"floating-point inputs in {stability.DIGITS} digits. A case fails if feasibility "
                f"is misjudged, if its value is off by more than {stability.VALUE_TOLERANCE:g} "
                f"units of rounding, or a gradient by more than {stability.GRADIENT_TOLERANCE:g}, "
                "on the scale of the case's conditioning.",
                [],
                [stability.figure(results.stability)],
                [stability.table(results.stability)],
            )
        )
    if results.left_out:
        parts.append(
            Measurement(
                "What was left out",
                "Structure is analysed before compiling, so what a scene does not use is never "
                "part of its program. Operations are those of the optimised program; a loop's "
                "body counts once.",
                [],
                [],
                [left_out.table(results.left_out)],
            )
        )
    return parts


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
        if svg.stat().st_size <= LARGEST_SVG:
            return _data("svg+xml", svg.read_bytes())
        return _data("png", svg.with_suffix(".png").read_bytes())

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
