"""The study itself: from its spec to its results."""

from __future__ import annotations

import jax

from designopt.study.results import PrecisionStudy, Results
from designopt.study.stability import DIGITS
from designopt.study.study import Context
from studies.benchmarks.visibility import left_out, statements, tables
from studies.benchmarks.visibility.measuring import measure_all
from studies.benchmarks.visibility.spec import VisibilityPrecisionSpec

ERROR = "worst error"


def run(spec: VisibilityPrecisionSpec, context: Context) -> Results:
    """Measure everything in float64, and say what it shows."""
    with jax.enable_x64(True):
        found = measure_all(spec, context)
        operations = []
        if spec.left_out:
            with context.step("Operations left out"):
                operations = left_out.operations()
    reference = (
        f"coverage in one pose: {spec.reference_rays:,} rays in plain NumPy, themselves right to "
        f"{found.fan_error:.0e}; all else: {DIGITS} digits. A coverage's error is that of the "
        "worst pad; a gradient's that of its worst entry over its largest one"
    )
    return Results(
        findings=statements.findings(spec, found),
        metrics=statements.metrics(spec, found),
        tables=tables.tables(found),
        precision=PrecisionStudy(found.rows, ERROR, reference, statements.claims(spec, found)),
        left_out=operations,
    )
