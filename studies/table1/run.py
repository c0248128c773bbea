"""The study itself: from its spec to its results."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from designopt.study import benchmark as run_time
from designopt.study.left_out import count_operations
from designopt.study.results import LeftOutRow, PrecisionStudy, Results
from designopt.study.stability import DIGITS, assess
from designopt.study.study import Context
from optics.chamber.chamber import Chamber
from optics.chamber.ratio import SolveMethod, solve_dimension_for_ratio
from optics.scene.thin_lens import ThinLens
from studies.models.soft_finger import paper
from studies.table1 import drawings, precision, stability, statements, tables
from studies.table1.analysis import analyze
from studies.table1.spec import Table1Spec


def run(spec: Table1Spec, context: Context) -> Results:
    """Table I with the printed and with identified constants, the choice of η, the measurements."""
    with context.step("Table I, identification and the choice of η"):
        analysis = analyze(spec)
    rows = assess(stability.nominal(), (context.dtype,))
    if spec.stability:
        with context.step("Stiff and extreme cases"):
            for family in stability.families(context.seed):
                rows += assess(family, ("float64", "float32"))
    precision_study = None
    if spec.precision:
        with context.step("Error against run time"):
            precision_study = measure_precision(analysis.imaging.identified.chamber, spec, context)
    with context.step("Operations left out"):
        left_out = operations(analysis.imaging.chosen)
    return Results(
        findings=statements.findings(spec, analysis),
        metrics=statements.metrics(spec, analysis, rows),
        tables=tables.tables(analysis),
        figures=[
            drawings.line_figure(analysis.imaging, spec.clearance),
            drawings.section_figure(analysis.imaging.chosen),
        ],
        precision=precision_study,
        stability=rows,
        left_out=left_out,
    )


def measure_precision(chamber: Chamber, spec: Table1Spec, context: Context) -> PrecisionStudy:
    """Error against run time of solving for η from θ_CD."""
    fields = {name: float(getattr(chamber, name)) for name in precision.FIELDS}
    rows = []
    for work in precision.workloads(fields, spec.precision_problems, context.seed):
        with jax.enable_x64(work.dtype == "float64"):
            rows += [
                run_time.measure(contender, repeats=spec.precision_repeats)
                for contender in precision.contenders(fields, work)
            ]
    return PrecisionStudy(
        rows,
        error="worst relative error of η",
        reference=f"Eqs. 1-3 as printed, in {DIGITS} digits, for θ_CD and dimensions in double "
        "precision (so float32 answers for the rounding of its inputs, too)",
        claims=[precision.claim(rows)],
    )


def operations(chamber: Chamber) -> list[LeftOutRow]:
    """Operation counts of this scene's programs beside the general ones."""
    ratios = jnp.asarray(paper.ETA)

    def offsets(chamber: Chamber, ratios: jax.Array, method: SolveMethod) -> jax.Array:
        return jax.vmap(
            lambda ratio: solve_dimension_for_ratio(chamber, "offset_d", ratio, method=method).value
        )(ratios)

    def everything(chamber: Chamber, lens: ThinLens) -> tuple:
        return (
            chamber.imaging_ratio(),
            chamber.image_heights(),
            chamber.ring_widths(),
            jax.vmap(lens.image)(chamber.depths),
        )

    lens = ThinLens(chamber.focal_length, chamber.focal_length, chamber.image_distance)
    return [
        LeftOutRow(
            "Δl_D for the table's six η",
            "the iteration: a closed form exists",
            count_operations(lambda c, r: offsets(c, r, "closed form"), chamber, ratios),
            count_operations(lambda c, r: offsets(c, r, "newton"), chamber, ratios),
        ),
        LeftOutRow(
            "η of the chamber",
            "image heights, ring widths and the real lens: η needs none of them",
            count_operations(lambda c, _: c.imaging_ratio(), chamber, lens),
            count_operations(everything, chamber, lens),
        ),
    ]
