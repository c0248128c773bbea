"""What is asked of the optics, line by line: limit, what is achieved, margin and price."""

from __future__ import annotations

from typing import TYPE_CHECKING

from designopt.study.records import Records
from designopt.study.report import Report
from studies.models.checks import Check, requirement_rows
from studies.models.finger import Finger
from studies.models.mirror_design.clearances import clearance_checks
from studies.models.mirror_design.postures import lost_strips
from studies.models.mirror_design.problem import CLEARANCE_SCALE, HIDDEN_SCALE, clearance_names
from studies.models.mirror_design.spec import MirrorSpec
from studies.models.mirror_design.yields import Yield

if TYPE_CHECKING:
    from studies.models.mirror_design.design import MirrorDesign
    from studies.models.mirror_design.judging import Verdict

COVERAGE, SHARPNESS, SPARE = "coverage", "px/mm", "degrees to spare"
MEMBRANE = "membrane"

SIDES = ("towards the root", "towards the tip")
"""Of the field of view, in the straight finger."""


def optical_checks(
    finger: Finger, verdict: Verdict, share: Yield, spec: MirrorSpec
) -> tuple[Check, ...]:
    """Every requirement on camera, mirrors and pads, over all postures.

    Args:
        finger: with its camera and mirrors.
        verdict: on it, over all pairs of angles.
        share: its yield.
        spec: what is asked for.
    """
    worst = verdict.worst
    assert worst is not None  # as it is over all pairs of angles
    checks = [
        Check(COVERAGE, 1.0, verdict.worst_coverage, ""),
        Check(SHARPNESS, spec.floor, verdict.worst_px_per_mm, "px/mm"),
    ]
    if (blur := worst.largest_blur_px) is not None:
        checks.append(Check("blur", spec.camera.max_blur_px, blur, "px", at_least=False))
    if worst.transmission is not None:
        checks.append(Check("transmission", spec.pads.min_transmission, worst.transmission, ""))
    checks += [
        Check("yield", spec.least_yield, share.value, ""),
        Check(MEMBRANE, spec.least_membrane, float(finger.body.membrane)),
        *clearance_checks(finger, spec.room.clearance),
    ]
    # Reported: what is needed lies inside the field of view by itself.
    spare = zip(SIDES, worst.spare_deg, strict=True)
    checks += [Check(f"{SPARE} {side}", 0.0, one.value, "°") for side, one in spare]
    return tuple(checks)


def prices(design: MirrorDesign, spec: MirrorSpec) -> dict[str, tuple[float, str]]:
    """By how much the objective would fall for one unit less asked, to first order, and per what.

    They are the multipliers at the end of the search (J. Nocedal, S. J. Wright, *Numerical
    Optimization* (2006), chapter 12.9), whose objective is in % of a pad that is not seen.
    """
    if not design.trials:
        return {}
    held = design.trials[design.chosen].multipliers
    found = {
        COVERAGE: (float(held["coverage"].sum()) / HIDDEN_SCALE, "% of a pad per 1"),
        SHARPNESS: (float(held["resolution"].sum()) / spec.floor, "% of a pad per px/mm"),
    }
    names = clearance_names(design.finger)
    for name, multiplier in zip(names, held["clearance"].tolist(), strict=True):
        found[name] = multiplier / CLEARANCE_SCALE, "% of a pad per mm"
    return found


def optical_requirements(design: MirrorDesign, share: Yield, spec: MirrorSpec) -> Records:
    """The table of `optical_checks` of a design, with `prices`."""
    checks = optical_checks(design.finger, design.verdict, share, spec)
    return requirement_rows(checks, prices(design, spec))


def add_requirements(out: Report, design: MirrorDesign, share: Yield, spec: MirrorSpec) -> None:
    """The table, and which strip is lost, where one is."""
    worst = design.verdict.worst
    assert worst is not None  # of a design
    out.table("optics", optical_requirements(design, share, spec))
    if worst.least_coverage < 1:
        least = min(worst.coverage, key=lambda one: one.value)
        out.say("lost", strips="; ".join(lost_strips(design.finger, least)))
