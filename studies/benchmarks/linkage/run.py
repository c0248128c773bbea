"""The study itself: from its spec to its results."""

from __future__ import annotations

from designopt.study.results import PrecisionStudy, Results
from designopt.study.stability import DIGITS
from designopt.study.study import Context
from studies.benchmarks.linkage import drawings, left_out, statements, tables
from studies.benchmarks.linkage.measuring import Measured, measure_all
from studies.benchmarks.linkage.spec import LinkagePrecisionSpec

ERROR = "worst error over the linkage's size"
REFERENCE = (
    f"trigonometry in {DIGITS} digits for dimensions and angles in double precision, on evenly "
    "spaced poses; a gradient's error is that of its worst entry over its largest one"
)


def run(spec: LinkagePrecisionSpec, context: Context) -> Results:
    """Time and check everything on one core, and say what it shows."""
    found = measure_all(spec, context)
    with context.step("Operations left out"):
        operations = left_out.operations()
    # The report's figure holds the longest sweep in float64; the other rows have their own.
    main = [m.row for m in found.rows if m.work.every and m.work.dtype == "float64"]
    return Results(
        findings=statements.findings(spec, found),
        metrics=statements.metrics(spec, found),
        tables=tables.tables(found),
        figures=[
            drawings.throughput(found.rows),
            *drawings.further(_further(found.rows), ERROR, REFERENCE),
        ],
        precision=PrecisionStudy(main, ERROR, REFERENCE, statements.claims(spec, found)),
        left_out=operations,
    )


def _further(rows: list[Measured]) -> dict[str, list[Measured]]:
    return {
        "float32": [m for m in rows if m.work.every and m.work.dtype == "float32"],
        "short": [m for m in rows if not m.work.every and m.work.poses < 1000],
    }
