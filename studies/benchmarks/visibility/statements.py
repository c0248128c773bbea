"""What the study says: findings in sentences, metrics with targets, claims with evidence."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

from designopt.study.benchmark import Ratio, find_dominating
from designopt.study.results import Claim, Metric, PrecisionRow, Target
from studies.benchmarks.visibility.contenders import BEST, EDGES, OURS
from studies.benchmarks.visibility.finger_grid import GRADIENT, STEPS, VALUE
from studies.benchmarks.visibility.measuring import ACCURACY, Measurements, Rival
from studies.benchmarks.visibility.spec import STATED_RAYS, STATED_SAMPLES, VisibilityPrecisionSpec
from studies.benchmarks.visibility.tracers import (
    MIRRORS,
    NUMPY,
    OPTILAND,
    RAYOPTICS,
    intersections_per_ray,
)
from studies.benchmarks.visibility.tracers import OURS as OUR_TRACER

COVERAGE_TARGET = 1e-5
GRADIENT_TARGET = 1e-9
SPEED_TARGET = 100.0
GRID_TARGET_S = 1.0
COMPILE_TARGET_S = 5.0
AGREEMENT_TARGET = 1e-12
OPTILAND_TARGET = 2.5
NUMPY_TARGET = 1.5


def metrics(spec: VisibilityPrecisionSpec, found: Measurements) -> list[Metric]:
    """The study's numbers; a target belongs to the stated sizes and to what was measured."""
    stated = (spec.reference_rays, spec.samples) == (STATED_RAYS, STATED_SAMPLES)
    made: list[Metric] = []

    def add(
        name: str, value: float | None, unit: str, description: str, target: Target | None = None
    ) -> None:
        number = math.nan if value is None else value
        asked = target if stated and math.isfinite(number) else None
        made.append(Metric(name, number, unit, description, None, asked))

    for method, name in ((OURS, "exact"), (EDGES, "edge_refined")):
        off = [scene.coverage for scene in found.deviations if scene.method == method]
        add(
            f"gallery_{name}_deviation",
            max(off, default=None),
            "",
            f"worst deviation of a coverage by {method} from {spec.reference_rays:,} rays, gallery",
            Target("<=", COVERAGE_TARGET),
        )
    ours = [row for row in found.rows if row.method == OURS]
    for row in ours:
        add(
            f"exact_error_{_key(row.panel)}",
            row.error,
            "",
            f"worst error of the {OURS}, {row.panel}",
            Target("<=", GRADIENT_TARGET if _is_gradient(row) else COVERAGE_TARGET),
        )
    for row in ours:
        if _is_gradient(row):
            rival = _rival(found, row.panel)
            add(
                f"sigmoid_over_exact_{_key(row.panel)}",
                rival and rival.ratio.value,
                "",
                f"run time of the fastest sigmoid sampling with an error up to {ACCURACY:g} over "
                f"that of the {OURS}, {row.panel}",
                Target(">=", SPEED_TARGET),
            )
    if found.grid is not None:
        for panel, poses in (("grid", f"{STEPS} × {STEPS}"), ("sweeps", f"{STEPS} + {STEPS}")):
            for asked, name in ((VALUE, "coverage"), (GRADIENT, "gradient")):
                add(
                    f"finger_{panel}_{name}_s",
                    found.grid.seconds(asked, panel),
                    "s",
                    f"{asked} of paper B's finger in {poses} poses, once compiled",
                    Target("<=", GRID_TARGET_S),
                )
        add(
            "finger_grid_compile_s",
            statistics.median(found.grid.compile_seconds),
            "s",
            f"tracing, lowering and compiling {GRADIENT} with respect to all dimensions and angles "
            f"over {STEPS} × {STEPS} poses, median of fresh processes",
            Target("<=", COMPILE_TARGET_S),
        )
        add(
            "finger_grid_disagreement",
            found.grid.disagreement,
            "",
            "largest deviation of a view over the grid from that of the sweep of its own joint",
            Target("<=", AGREEMENT_TARGET),
        )
    for legs in dict.fromkeys(legs for legs, _ in found.traced):
        over_numpy = found.over_tracers[legs, NUMPY]
        add(
            f"tracer_over_numpy_{_key(_legs(legs))}",
            1 / over_numpy.value,
            "",
            f"run time of `trace_rays` over that of a tracer in NumPy by hand, {_legs(legs)}",
            Target("<=", NUMPY_TARGET),
        )
    if found.traced:
        add(
            "throughput_over_optiland",
            throughput_over(OPTILAND, found.over_tracers),
            "",
            "intersections of rays with surfaces per second by `trace_rays` over those by "
            f"optiland, {MIRRORS} mirrors",
            Target(">=", OPTILAND_TARGET),
        )
    return made


def throughput_over(method: str, ratios: dict[tuple[int, str], Ratio]) -> float | None:
    """Intersections per second by `trace_rays` over those by another tracer."""
    ratio = ratios.get((MIRRORS, method))
    if ratio is None:
        return None
    return (
        ratio.value
        * intersections_per_ray(OUR_TRACER, MIRRORS)
        / intersections_per_ray(method, MIRRORS)
    )


def findings(spec: VisibilityPrecisionSpec, found: Measurements) -> list[str]:
    """Plain sentences, most important first."""
    said = []
    for row in (row for row in found.rows if row.method == OURS):
        others = [other for other in found.rows if other.panel == row.panel and other is not row]
        said.append(_beside(row, others))
    gradients = [row for row in found.rows if _is_gradient(row)]
    said += [_rivalry(found, row.panel) for row in gradients]
    if len(gradients) > 1:
        one, many = gradients[0], gradients[-1]
        said.append(
            f"The {OURS} take {many.seconds / one.seconds:.2g} times as long for '{many.panel}' "
            f"as for '{one.panel}': part of a call's time is its start."
        )
    if found.deviations:
        worst = max(found.deviations, key=lambda scene: scene.coverage)
        said.append(
            f"In {len(found.deviations)} scenes of the gallery no coverage deviates by more than "
            f"{worst.coverage:.1e} ({worst.scene}) from that by {spec.reference_rays:,} rays in "
            "plain NumPy."
        )
    if found.grid is not None:
        said.append(
            f"Paper B's finger in {STEPS} × {STEPS} poses takes "
            f"{found.grid.seconds(VALUE, 'grid'):.2g} s, with the gradient "
            f"{found.grid.seconds(GRADIENT, 'grid'):.2g} s; the {STEPS} + {STEPS} poses that say "
            f"the same {found.grid.seconds(VALUE, 'sweeps'):.2g} s and "
            f"{found.grid.seconds(GRADIENT, 'sweeps'):.2g} s: views deviate by no more than "
            f"{found.grid.disagreement:.0e} from those of their own joint's sweep."
        )
    said += _tracing(found)
    said.append(
        "Run times are those of one core; compiling uses all of them."
        if found.pinned
        else "This system cannot hold threads on one core, so these are not one core's times."
    )
    return said


def claims(spec: VisibilityPrecisionSpec, found: Measurements) -> list[Claim]:
    """What the study says, each with what would prove it wrong."""
    said = [_speed_claim(found, rival) for rival in found.rivals]
    said.append(undominated_claim(found.rows))
    if found.deviations:
        said.append(
            Claim(
                f"No coverage in the gallery deviates by more than {COVERAGE_TARGET:g} from that "
                f"by {spec.reference_rays:,} rays.",
                "Straight mirrors are unfolded and every end of a view is one quotient; in curved "
                "ones every edge is found to rounding.",
                [
                    f"{scene.scene}, {scene.method}: {scene.coverage:.1e}"
                    for scene in found.deviations
                ],
                all(scene.coverage <= COVERAGE_TARGET for scene in found.deviations),
            )
        )
    if found.grid is not None:
        compiled = statistics.median(found.grid.compile_seconds)
        times = [row.seconds for row in found.grid.rows]
        said.append(
            Claim(
                f"Paper B's finger in {STEPS} × {STEPS} poses, with its gradient with respect to "
                f"all dimensions and angles, takes at most {GRID_TARGET_S:g} s, and compiling it "
                f"at most {COMPILE_TARGET_S:g} s; {STEPS} + {STEPS} poses say the same.",
                "All paths are one program, whatever their number, and no view is sampled; "
                "each joint moves one pad and one mirror.",
                [
                    *(f"{r.panel}, {r.method}: {r.seconds:.2g} s" for r in found.grid.rows),
                    "compiling: " + ", ".join(f"{s:.1f} s" for s in found.grid.compile_seconds),
                    f"largest deviation of the two: {found.grid.disagreement:.0e}",
                ],
                max(times) <= GRID_TARGET_S
                and compiled <= COMPILE_TARGET_S
                and found.grid.disagreement <= AGREEMENT_TARGET,
            )
        )
    if found.traced:
        said.append(_tracer_claim(found))
    return said


def undominated_claim(rows: Sequence[PrecisionRow]) -> Claim:
    """Whether anything on the same workload is both faster and closer."""
    beaten = []
    for row in (row for row in rows if row.method == OURS):
        beaten += find_dominating(row, rows)
    return Claim(
        f"Nothing that was measured is both faster and closer than the {OURS}.",
        "Their number of operations is that of a few hundred points, and they leave no step.",
        [
            f"both faster and closer: {other.method}, {other.setting}, {other.panel}: "
            f"{other.seconds:.2g} s, error {other.error:.1e}"
            for other in beaten
        ]
        or [
            f"{row.panel}: {row.seconds:.2g} s, error {row.error:.1e}"
            for row in rows
            if row.method == OURS
        ],
        not beaten,
    )


def _speed_claim(found: Measurements, rival: Rival) -> Claim:
    panel = rival.row.panel
    best = min(
        (row for row in found.rows if row.panel == panel and row.method == BEST),
        key=lambda row: row.error,
    )
    return Claim(
        f"At a gradient error of at most {ACCURACY:g} the {OURS} are at least {SPEED_TARGET:g} "
        f"times as fast as pad points softened by a sigmoid, whatever its α ({panel}).",
        "A steep sigmoid needs points close to each other, a gentle one is wrong: it sees through "
        "what is nearly in the way.",
        [
            _rivalry(found, panel),
            f"its least error, for the best α of each number of points: {best.error:.1e} "
            f"({best.setting}, {best.seconds:.2g} s)",
        ],
        rival.ratio.value >= SPEED_TARGET,
    )


def _tracer_claim(found: Measurements) -> Claim:
    numpy = {legs: 1 / r.value for (legs, name), r in found.over_tracers.items() if name == NUMPY}
    optiland = throughput_over(OPTILAND, found.over_tracers)
    faster = f"intersects at least {OPTILAND_TARGET:g} times as many rays and surfaces as optiland"
    return Claim(
        "In float64 `trace_rays` takes at most "
        f"{NUMPY_TARGET:g} times as long as a tracer written by hand in NumPy for the same scene"
        + (f", and {faster}." if optiland is not None else "."),
        "All surfaces are met in one fused loop over the rays; what is not asked for is not "
        "computed.",
        _tracing(found),
        all(ratio <= NUMPY_TARGET for ratio in numpy.values())
        and (optiland is None or optiland >= OPTILAND_TARGET),
    )


def _is_gradient(row: PrecisionRow) -> bool:
    """One row for each workload that asks for a gradient."""
    return row.method == OURS and row.panel.startswith("gradient")


def _rival(found: Measurements, panel: str) -> Rival | None:
    return next((rival for rival in found.rivals if rival.row.panel == panel), None)


def _rivalry(found: Measurements, panel: str) -> str:
    rival = _rival(found, panel)
    if rival is None:
        return f"{panel}: no sigmoid sampling has an error of at most {ACCURACY:g}."
    row, ratio = rival
    return (
        f"{panel}: of the sigmoid samplings with an error of at most {ACCURACY:g} the fastest "
        f"({row.setting}, error {row.error:.1e}) takes {ratio.value:.3g} times as long as the "
        f"{OURS} ({ratio.low:.3g} to {ratio.high:.3g})."
    )


def _beside(row: PrecisionRow, others: Sequence[PrecisionRow]) -> str:
    """The exact intervals and the best that each other kind of method reaches."""
    parts = []
    for method in dict.fromkeys(other.method for other in others):
        mine = [other for other in others if other.method == method]
        best = min(mine, key=lambda other: (other.error, other.seconds))
        parts.append(f"{method} {best.error:.1e} in {_time(best.seconds)}")
    return (
        f"{row.panel}: {OURS} {row.error:.1e} in {_time(row.seconds)}; least errors of the others: "
        + "; ".join(parts)
        + "."
    )


def _tracing(found: Measurements) -> list[str]:
    said = []
    for (legs, method), ratio in found.over_tracers.items():
        times = f"{method}, {_legs(legs)}: {ratio.value:.3g} times the run time of `trace_rays`"
        told = method in (OPTILAND, RAYOPTICS)
        rate = throughput_over(method, found.over_tracers)
        said.append(
            f"{times}, which intersects {rate:.3g} times as many rays and surfaces per second; "
            f"{method} is told which mirror comes next, `trace_rays` finds it among {MIRRORS}."
            if told
            else f"{times} ({ratio.low:.3g} to {ratio.high:.3g})."
        )
    return said


def _legs(count: int) -> str:
    return "1 leg" if count == 1 else f"{count} legs"


def _key(panel: str) -> str:
    return panel.replace(", ", "_").replace(" ", "_")


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms"
