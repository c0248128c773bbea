"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from designopt.study.benchmark import BenchmarkMethod, benchmark, find_undominated
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.study import Context
from studies.benchmarks import chamber
from studies.benchmarks.measuring import keep_closest
from studies.benchmarks.solvers import SolverPrecisionSpec, box, grasp
from studies.models.grasp import cases
from studies.models.grasp.closing import close_all, there_and_back
from studies.models.grasp.spec import GraspSpec
from studies.models.soft_finger.imaging import printed_chamber
from studies.models.soft_finger.spec import ChamberSpec

OURS = "designopt"
OWN = (chamber.CLOSED_FORM, grasp.OURS, box.OURS)
REFERENCE = "joints in 36 digits (rad); Eqs. 1-3 in 50 digits (relative); the closed form of x₁, x₂"
COLUMNS = ("method", "setting", "error", "seconds")
NEAR = 10.0
"""Other methods are compared where their error is at most so many times ours."""


def run(spec: SolverPrecisionSpec, context: Context) -> Results:
    """Solve three problems with every method, and compare errors and run times.

    Raises:
        UserError: another float type than float64.
    """
    context.require_float64("solver-precision measures errors of 1e-15")
    out, rows, judged, table = Report(spec, package=__package__), [], [], Records()
    problems: dict[str, Callable[[], Iterable[BenchmarkMethod]]] = {
        "grasp": lambda: _grasp_methods(spec.minimizers),
        "eta": lambda: _chamber_methods(spec.angles, context.seed),
        "box": box.methods,
    }
    for name, make in problems.items():
        with context.step(f"Problem {name}"):
            found = benchmark([_named(one) for one in make()], repeats=spec.repeats)
        rows += found
        ours, *others = keep_closest([row for row in found if row.panel == found[-1].panel], OURS)
        if name != "box":
            judged += [ours, *others]
        closest = {row.method: row for row in sorted(others, key=lambda row: -row.error)}
        near = [row.seconds for row in closest.values() if row.error <= NEAR * ours.error]
        speedup = min(near, default=math.nan) / ours.seconds
        out.metrics(**{f"{name}_error": ours.error, f"{name}_speedup": speedup})
        for row in (ours, *closest.values()):
            columns = {column: getattr(row, column) for column in COLUMNS}
            table.add(problem=row.panel, times_ours=row.seconds / ours.seconds, **columns)
    out.say("main")
    out.table("closest", table)
    claim = out.claim("structure", *find_undominated(judged, OURS))
    out.precision(rows, "worst error", REFERENCE, claim)
    return out.results()


def _named(one: BenchmarkMethod) -> BenchmarkMethod:
    if one.method not in OWN:
        return one
    return replace(one, method=OURS, setting=", ".join(filter(None, (one.method, one.setting))))


def _grasp_methods(minimizers: bool) -> list[BenchmarkMethod]:
    spec = GraspSpec()
    finger = cases.finger_of(spec)
    circle = cases.touching(finger.body, *cases.check_touch(finger.body))
    motion = there_and_back(math.radians(spec.motor_end_deg))
    work = grasp.Workload.of(close_all([cases.problem_of(finger, circle)], motion[None])[0])
    assert work is not None
    made = grasp.newton(work) + grasp.optimistix_newton(work)
    return made + grasp.energy_minimizers(work) if minimizers else made


def _chamber_methods(angles: int, seed: int) -> Iterator[BenchmarkMethod]:
    for work in chamber.workloads(printed_chamber(ChamberSpec()), angles, seed):
        if work.dtype == "float64":
            panel = f"η of the chamber, {work.panel.removesuffix(', float64')}"
            yield from chamber.methods(work._replace(panel=panel))
