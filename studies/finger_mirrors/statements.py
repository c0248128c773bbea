"""What the study says: its metrics, findings and claim."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from designopt.study.results import Claim, Metric, Target
from studies.finger_mirrors.findings import GIVEN, Case, Found
from studies.finger_mirrors.solvers import EVOLUTION, HELD, OURS, Run, best_objective
from studies.models.body import BodySpec
from studies.models.mirror_design.percent import percent_at_least
from studies.models.mirror_design.spec import (
    FLOOR,
    CameraSpec,
    FingerMirrorsSpec,
    RoomSpec,
    ToleranceSpec,
)

STATED_YIELD = 0.92
STATED_DRAWS = 2000
STATED_RAYS = 200_000

START_COVERAGE = 0.6
"""The search is to begin with less than this part of all pads seen."""

ROW_ROUNDING = 1e-12
"""A larger deviation of all pairs of angles from the row for them is no rounding."""

RAY_STEP = 5e-4
"""What a fan of `STATED_RAYS` may leave of a pad because of the distance between its rays: a ray's
share of the field of view, 14 µrad, is 3 µm of a pad 80 mm away under 20°, of 26.5 mm, at either
end, and a hand-over between two views has two ends more."""


def metrics(spec: FingerMirrorsSpec, found: Found) -> list[Metric]:
    """The numbers that the study stands for; targets belong to the finger that they speak of."""
    stated = (
        spec.body == BodySpec()
        and spec.tolerances == ToleranceSpec()
        and spec.camera == CameraSpec()
        and spec.room == RoomSpec()
        and spec.floor == FLOOR
    )
    counted = stated and spec.draws >= STATED_DRAWS
    traced = stated and spec.rays >= STATED_RAYS

    def target(asked: bool, relation: str, value: float, tolerance: float = 0.0) -> Target | None:
        if not asked:
            return None
        return Target(relation, value, tolerance)  # type: ignore[arg-type]

    after, share = found.after, found.after.yields
    square = next(reversed(found.squares.values()))
    reached = [found.design.meets(number, spec.floor) for number in range(len(found.design.trials))]
    made = [
        Metric(
            "start_coverage",
            found.before.verdict.mean_coverage,
            "",
            "part of all pads that the poor start shows, on average over postures and pads",
            None,
            target(stated, "<=", START_COVERAGE),
        ),
        Metric(
            "worst_coverage",
            min(after.verdict.worst_coverage, _one(float(np.min(square.coverage)))),
            "",
            f"least coverage of any pad over the 1° square ({square.square_poses:,} postures); 1 "
            "if less than 1e-9 is missing",
            None,
            target(stated, "=", 1.0),
        ),
        Metric(
            "worst_coverage_rays",
            float(np.min(found.checks[0][1].coverage)),
            "",
            f"the same by {spec.rays:,} rays in plain NumPy at the {spec.ray_poses} postures in "
            "which errors hide something most often",
            None,
            target(traced, "=", 1.0, RAY_STEP),
        ),
        Metric(
            "worst_px_per_mm",
            after.verdict.worst_px_per_mm,
            "px/mm",
            "least resolution of any pad over the 1° square, each place in its best view",
            None,
            target(stated, ">=", FLOOR),
        ),
        Metric(
            "yield",
            share.value,
            "",
            f"part of {share.draws:,} draws of all errors that show every pad in every posture "
            f"(95 %: {share.low:.3f} to {share.high:.3f})",
            STATED_YIELD,
            target(counted, ">=", STATED_YIELD),
        ),
        Metric("yield_low", share.low, "", "lower limit of its 95 % confidence interval (Wilson)"),
        Metric("yield_high", share.high, "", "upper limit of the same"),
        Metric(
            "mirror_mm",
            sum(after.mirror_lengths),
            "mm",
            "both mirrors' lengths together",
        ),
        Metric(
            "single_view_postures",
            float(np.mean(np.all(after.verdict.single >= 1 - 1e-9, axis=1))),
            "",
            "part of the postures in which every pad is whole in one view",
        ),
        Metric(
            "starts_reached",
            sum(reached[1:]),
            "",
            f"random starts, of {len(reached) - 1}, that led to full coverage with the resolution",
        ),
        Metric(
            "row_disagreement",
            square.disagreement,
            "",
            f"largest deviation of {square.square_poses:,} postures from the {square.row_poses} "
            "that stand for them",
            None,
            target(True, "<=", ROW_ROUNDING),
        ),
        Metric(
            "row_speedup",
            square.square_seconds / square.row_seconds,
            "",
            "run time of all postures over that of those which stand for them",
        ),
    ]
    for case in (case for case in found.cases if case.name == GIVEN):
        made += [
            Metric(
                "yield_given_layout",
                case.yields.value,
                "",
                f"yield of the reference layout, same draws (95 %: {case.yields.low:.3f} to "
                f"{case.yields.high:.3f})",
                STATED_YIELD,
            ),
            Metric(
                "mirror_given_layout_mm",
                sum(case.mirror_lengths),
                "mm",
                "its mirrors' lengths together",
            ),
        ]
    if found.thin is not None and found.thin_square is not None:
        thin = found.thin
        asked = stated and spec.thin == FingerMirrorsSpec().thin
        made += [
            Metric(
                "worst_coverage_thin",
                min(thin.verdict.worst_coverage, _one(float(np.min(found.thin_square.coverage)))),
                "",
                f"least coverage over the 1° square at T = {thin.thickness:g} mm",
                None,
                target(asked, "=", 1.0),
            ),
            Metric(
                "worst_coverage_thin_rays",
                float(np.min(found.checks[1][1].coverage)),
                "",
                "the same by rays at its worst postures",
                None,
                target(asked and traced, "=", 1.0, RAY_STEP),
            ),
            Metric(
                "worst_px_per_mm_thin",
                thin.verdict.worst_px_per_mm,
                "px/mm",
                "its least resolution",
            ),
            Metric(
                "yield_thin",
                thin.yields.value,
                "",
                f"its yield (95 %: {thin.yields.low:.3f} to {thin.yields.high:.3f})",
            ),
        ]
    return made


def _one(coverage: float) -> float:
    return 1.0 if coverage >= 1 - 1e-9 else coverage


def findings(spec: FingerMirrorsSpec, found: Found) -> list[str]:
    """Plain sentences, most important first."""
    said = [_main(found), _given(found), _starts(spec, found), _tolerances(spec, found)]
    said += [_thin(spec, found), _row(found), _definitions(spec)]
    return [sentence for sentence in said if sentence]


def _percent(case: Case) -> str:
    one = case.yields
    return f"{100 * one.value:.1f} % ({100 * one.low:.1f} to {100 * one.high:.1f} %)"


def _main(found: Found) -> str:
    after, before = found.after, found.before
    whole = after.verdict.worst_coverage == 1.0
    return (
        f"At T = {after.thickness:g} mm the optimum shows "
        + (
            "all of every pad"
            if whole
            else f"{percent_at_least(after.verdict.worst_coverage)} or more"
        )
        + f" in every posture, with at least {after.verdict.worst_px_per_mm:.2f} px/mm and "
        f"{sum(after.mirror_lengths):.1f} mm of mirror; of "
        f"{after.yields.draws:,} fingers assembled with the stated errors {_percent(after)} still "
        f"show everything. The start showed {100 * before.verdict.mean_coverage:.0f} % of the pads."
    )


def _given(found: Found) -> str:
    for case in found.cases:
        if case.name == GIVEN:
            length = sum(case.mirror_lengths)
            return (
                f"The reference layout has {length:.1f} mm of mirror, "
                f"{case.verdict.worst_px_per_mm:.2f} px/mm and, over the same draws, a yield of "
                f"{_percent(case)}."
            )
    return ""


def _starts(spec: FingerMirrorsSpec, found: Found) -> str:
    design = found.design
    reached = [design.meets(number, spec.floor) for number in range(len(design.trials))]
    whole = [verdict.worst_coverage == 1.0 for verdict in design.verdicts]
    return (
        f"From the poor start the search {'reached' if whole[0] else 'did not reach'} full "
        f"coverage, with {design.verdicts[0].worst_px_per_mm:.2f} px/mm where {spec.floor:g} are "
        f"asked for; from {len(reached) - 1} random starts "
        f"{sum(whole[1:])} reached full coverage, {sum(reached[1:])} of them with the resolution."
    )


def _tolerances(spec: FingerMirrorsSpec, found: Found) -> str:
    doubled = found.sensitivity.doubled
    worst = min(doubled, key=lambda name: doubled[name].value)
    return (
        f"The yield depends most on {worst}: with twice that tolerance it falls from "
        f"{100 * found.sensitivity.base.value:.1f} to {100 * doubled[worst].value:.1f} %."
    )


def _thin(spec: FingerMirrorsSpec, found: Found) -> str:
    if found.thin is None:
        return ""
    thin = found.thin
    whole = thin.verdict.worst_coverage == 1.0
    return (
        f"At T = {thin.thickness:g} mm "
        + ("all of every pad is seen in every posture" if whole else "not all is seen")
        + f", with at least {thin.verdict.worst_px_per_mm:.2f} px/mm and a yield of "
        f"{_percent(thin)}; the search asks for {min(spec.floor, spec.thin_floor):g} px/mm there, "
        "for a lower camera looks along the outer pads more flatly."
    )


def _row(found: Found) -> str:
    square = next(reversed(found.squares.values()))
    if square.disagreement > ROW_ROUNDING:
        return (
            "Both joints change the view of one pad: over all pairs of angles coverage deviates by "
            f"{square.disagreement:.2g} from that of both joints bent alike, on which the search, "
            "the yield and the resolution rest."
        )
    return (
        f"PIP changes only the view of the proximal pad and DIP only that of the distal one: over "
        f"{square.square_poses:,} postures the largest deviation from the {square.row_poses} that "
        f"stand for them is {square.disagreement:.1g}, and these take "
        f"{square.square_seconds / square.row_seconds:.0f} times less time."
    )


def _definitions(spec: FingerMirrorsSpec) -> str:
    return (
        "Mirror ends lie inside their phalanges' sections, "
        f"{spec.room.clearance:g} mm from faces and end walls; beyond their joint's axis they may "
        f"reach by {spec.room.overhang:g} mm, {spec.room.clearance:g} mm beside the camera's body. "
        "Errors are independent and normal, each mirror's about its middle and along its normal."
    )


def claim(runs: Sequence[Run]) -> Claim:
    """That the graduated search beats differential evolution on time and objective."""
    best = best_objective(runs)
    ours = [run for run in runs if run.method == OURS and run.violation <= HELD]
    yardstick = [run for run in runs if run.method == EVOLUTION]
    ahead = [
        run
        for run in ours
        if all(run.seconds <= other.seconds and run.objective < other.objective
               for other in yardstick[-1:])
    ]  # fmt: skip
    last = yardstick[-1]
    first = ahead[0] if ahead else None

    def told(run: Run) -> str:
        if run.violation > HELD:
            return f"violation {run.violation:.2g} after {run.seconds:.0f} s"
        return f"gap {(run.objective - best) / 100:.3g} pads after {run.seconds:.0f} s"

    evidence = (
        f"differential evolution: {told(last)}; graduated search: "
        f"{f'{told(first)} ({first.setting})' if first else 'never ahead within that time'}"
    )
    return Claim(
        "The graduated search reaches a lower objective than differential evolution within its "
        "time.",
        "It follows exact slopes, and what is wholly hidden has one, too: the angle by which the "
        "nearest view misses it.",
        [evidence],
        bool(ahead) and math.isfinite(best),
    )
