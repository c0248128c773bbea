"""The study itself: from its spec to its results."""

from __future__ import annotations

from designopt.study.results import Results
from designopt.study.study import Context
from optics.visibility.coverage import find_views
from studies.stability.visibility import drawings, statements
from studies.stability.visibility.answers import Asked
from studies.stability.visibility.comparing import compare
from studies.stability.visibility.judging import Judged, judge_families
from studies.stability.visibility.spec import StabilitySpec


def run(spec: StabilitySpec, context: Context) -> Results:
    """Compare random scenes, then judge every family in both float types."""
    compared = compare(find_views, spec, context)
    judged: list[Judged] = []
    for dtype in ("float64", "float32")[: 1 + spec.float32]:
        with context.step(f"Extreme scenes, {dtype}"):
            judged += judge_families(Asked(find_views, spec.bounces), dtype, spec.family_cases)
    return Results(
        findings=statements.findings(spec, compared, judged),
        metrics=statements.metrics(spec, compared, judged),
        tables=[statements.random_table(compared), statements.verdicts(judged)],
        figures=[drawings.rays_figure(spec, compared), drawings.approach_figure(judged)],
        stability=[family.row for family in judged],
    )
