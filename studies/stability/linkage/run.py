"""The study itself: from its spec to its results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from designopt.study.results import Results
from designopt.study.study import Context
from studies.stability.linkage import cases, drawings, mechanisms, statements, triad
from studies.stability.linkage.cases import Cases
from studies.stability.linkage.judging import Family, judge
from studies.stability.linkage.mechanisms import Mechanism
from studies.stability.linkage.spec import StabilitySpec

DTYPES = ("float64", "float32")


def run(spec: StabilitySpec, context: Context) -> Results:
    """Solve and judge every family in both float types."""
    found: list[Family] = []
    for dtype in DTYPES:
        for mechanism, batches in _workload(spec, context.seed, dtype):
            with context.step(f"{mechanism.name}, {dtype}"):
                found += assess(mechanism, batches)
    return Results(
        findings=statements.findings(found),
        metrics=statements.metrics(found),
        tables=[statements.verdicts(found)],
        figures=[drawings.approach_figure(found), drawings.random_figure(found)],
        stability=[family.judged.row(family.case) for family in found],
    )


def _workload(
    spec: StabilitySpec, seed: int, dtype: str
) -> Iterator[tuple[Mechanism, list[Cases]]]:
    """Every mechanism with its families; those of one mechanism are solved in one call."""
    count, random = spec.family_cases, (spec.random_cases, spec.decades, seed)
    yield (
        mechanisms.four_bar(),
        [*cases.four_bars(dtype, count), cases.random_four_bars(dtype, *random)],
    )
    yield (
        mechanisms.slider_crank(),
        [*cases.slider_cranks(dtype, count), cases.random_slider_cranks(dtype, *random)],
    )
    if spec.triad:
        yield triad.six_bar()[0], list(triad.families(dtype))


def assess(mechanism: Mechanism, batches: Sequence[Cases]) -> list[Family]:
    """Solve families of one mechanism in one call, and judge each."""
    inputs = np.concatenate([batch.inputs for batch in batches])
    sides = np.concatenate([batch.sides for batch in batches])
    judged = judge(mechanism, inputs, sides, mechanisms.solve(mechanism, inputs, sides))
    families, start = [], 0
    for batch in batches:
        end = start + len(batch.sides)
        families.append(Family(batch.case, judged.part(slice(start, end))))
        start = end
    return families
