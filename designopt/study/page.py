"""One self-contained page about a run, for the screen and for paper."""

from __future__ import annotations

import base64
import dataclasses
import io
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
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
        error = study.error[0].upper() + study.error[1:]
        words = {"error": error, "reference": study.reference, "largest": plots.LARGEST_ERROR}
        table = _table("precision", study.rows, workload="panel")
        words["timing"] = benchmark.timing(study)
        parts.append(_measurement(table, words, plots.precision(study), study.claims))
    if results.stability:
        tolerances = {"value": stability.VALUE_TOLERANCE, "gradient": stability.GRADIENT_TOLERANCE}
        table, words = _table("stability", results.stability), {"digits": stability.DIGITS}
        parts.append(_measurement(table, words | tolerances, plots.stability(results.stability)))
    if results.left_out:
        parts.append(_measurement(_table("left_out", results.left_out), {}))
    return parts


def _measurement(
    table: Table, values: Mapping[str, Any], drawing: Any = None, claims: Sequence[Claim] = ()
) -> Measurement:
    """A table and its figure, with their words, in which values are filled."""
    text = (files("designopt") / "templates" / "measurements.toml").read_text(encoding="utf-8")
    words = tomllib.loads(text)[table.name]
    words = {key: part.format(**values) for key, part in words.items()}
    drawn = [Figure(table.name, words["figure"], words["caption"], drawing)] if drawing else []
    titled = dataclasses.replace(table, title=words["table"])
    return Measurement(words["title"], words["lead"], claims, drawn, [titled])


def _table(name: str, rows: Sequence[Any], **renamed: str) -> Table:
    """Rows of a dataclass: columns under another name, then the others but for single samples."""
    left_out = {*renamed.values(), "samples"}
    named = [field.name for field in dataclasses.fields(rows[0])]
    fields = renamed | {column: column for column in named if column not in left_out}
    cells = [[getattr(row, field) for field in fields.values()] for row in rows]
    return Table(name, "", list(fields), cells)


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

    template = _environment(source, MOST_ROWS).get_template("report.html.j2")
    settings = list(_flat(record.spec))
    return template.render(
        record=record,
        results=results,
        measured=measured,
        settings=settings,
        is_folded=bool(results.specs) and _all_checks_hold(results),
    )


def _all_checks_hold(results: Results) -> bool:
    """Whether a reader of a design may pass over its checks."""
    claims = results.precision.claims if results.precision else ()
    return not (
        any(metric.met is False for metric in results.checks)
        or any(not claim.holds for claim in claims)
        or any(row.failures or row.non_finite for row in results.stability)
    )


def render_results(results: Results) -> str:
    """Results as a piece of HTML, for a notebook: findings, metrics, figures and tables."""

    def source(figure: Figure) -> str:
        picture = io.BytesIO()
        with figures.style():
            figure.drawing.savefig(picture, format="png", dpi=110)
        return _data("png", picture.getvalue())

    tables, drawn = tables_and_figures(results, measurements(results))
    template = _environment(source, NOTEBOOK_ROWS).get_template("results.html.j2")
    return template.render(results=results, drawn=drawn, tables=tables)


def tables_and_figures(
    results: Results, measured: Sequence[Measurement]
) -> tuple[list[Table], list[Figure]]:
    """Those of a study, and those of its measurements."""
    tables = [*results.tables, *(table for part in measured for table in part.tables)]
    return tables, [*results.figures, *(figure for part in measured for figure in part.figures)]


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
