"""The study itself: from its spec to its results."""

from __future__ import annotations

from designopt.study import benchmark as run_time
from designopt.study.results import PrecisionStudy, Results
from designopt.study.study import Context
from studies.finger_grasp import precision, stability, statements, tables
from studies.finger_grasp.left_out import operations
from studies.models.grasp import figures as drawings
from studies.models.grasp.analysis import Analysis, analyze
from studies.models.grasp.cases import finger_of
from studies.models.grasp.check import summary
from studies.models.grasp.spec import GraspSpec
from studies.oracles.grasp import DIGITS


def run(spec: GraspSpec, context: Context) -> Results:
    """Close the design on everything, check its forces, and measure the solvers.

    Raises:
        UserError: another float type than float64.
    """
    context.require_float64("finger-grasp compares forces to 1e-8")
    with context.step("Closing, opening and pinching"):
        found = analyze(finger_of(spec), spec)
    check = summary(found)
    rows = []
    if spec.stability:
        end = float(found.adaptive.commands.max())
        with context.step("Stiff and extreme cases"):
            for family in stability.families(found.finger, end, context.seed):
                rows.append(stability.assess(family))
    precision_study = None
    if spec.precision:
        with context.step("Error against run time"):
            precision_study = measure_precision(found, spec)
    with context.step("Operations left out"):
        left_out = operations(found.finger)
    return Results(
        findings=statements.findings(spec, found, check),
        metrics=statements.metrics(spec, check, rows),
        tables=tables.tables(found),
        figures=drawings.figures(found),
        precision=precision_study,
        stability=rows,
        left_out=left_out,
    )


def measure_precision(found: Analysis, spec: GraspSpec) -> PrecisionStudy | None:
    """Error against run time over the check's closing; ``None`` if no state is determined."""
    rows = run_time.benchmark(
        list(precision.contenders(found.adaptive)), repeats=spec.precision_repeats
    )
    if not rows:
        return None
    return PrecisionStudy(
        rows,
        error="worst error of a joint (rad)",
        reference=f"the equations of what holds, in {DIGITS} digits",
        claims=[precision.claim(rows)],
    )
