"""The grasp of a found design in a few numbers, for studies that look for designs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from studies.models.grasp.analysis import (
    Analysis,
    formula_error,
    retrace_error,
    straight_until,
    touching_dip,
)


@dataclass(frozen=True)
class GraspCheck:
    """What a design does when it closes.

    Attributes:
        free_closing_pip_deg: PIP flexion up to which free closing keeps DIP on its stop, degrees.
        adaptive_dip_deg: DIP when the distal pad touches the circle of the check, degrees; NaN
            where it never does.
        virtual_work_error: largest difference of forces by virtual work and by every link's
            balance, relative.
        formula_error: largest difference to the two-phalanx formulas, relative.
        pinch_violations: pinches whose limit is not where the formula puts it.
        pinches: how many were loaded as far as the formula says that they hold.
        retrace_error_deg: largest difference between closing and opening, degrees.
        least_f1_n: smallest force on the intermediate pad in the adaptive closing after both pads
            touch, N; NaN where they never do.
        states: equilibria that were solved.
        unconverged: states without an equilibrium; none of them enters the numbers above.
        worst_residual: largest residual of a state that does.
        ratio_low, ratio_high: range of φ₂/φ₁ over all postures.
    """

    free_closing_pip_deg: float
    adaptive_dip_deg: float
    virtual_work_error: float
    formula_error: float
    pinch_violations: int
    pinches: int
    retrace_error_deg: float
    least_f1_n: float
    states: int
    unconverged: int
    worst_residual: float
    ratio_low: float
    ratio_high: float


def summary(found: Analysis) -> GraspCheck:
    """The few numbers of an analysis."""
    paths = list(found.paths().values())
    there_and_back = [found.adaptive, found.loaded, *found.circles]
    ok = found.adaptive.ok & (found.adaptive.gaps < 1e-7).all(axis=1)
    errors = [formula_error(path) for path in (found.adaptive, *found.circles)]
    return GraspCheck(
        free_closing_pip_deg=math.degrees(straight_until(found.free)),
        adaptive_dip_deg=math.degrees(touching_dip(found.adaptive)),
        virtual_work_error=max(compared.error for compared in found.compared.values()),
        formula_error=max((e for e in errors if not math.isnan(e)), default=math.nan),
        pinch_violations=sum(shown.agrees is False for _, _, shown in found.pinches),
        pinches=sum(shown.agrees is not None for _, _, shown in found.pinches),
        retrace_error_deg=math.degrees(max(retrace_error(path) for path in there_and_back)),
        least_f1_n=float(found.adaptive.push(0)[ok].min()) if ok.any() else math.nan,
        states=sum(len(path.ok) for path in paths),
        unconverged=sum(int((~path.ok).sum()) for path in paths),
        worst_residual=max(float(path.residual[path.ok].max(initial=0.0)) for path in paths),
        ratio_low=float(np.nanmin(found.relative_pull)),
        ratio_high=float(np.nanmax(found.relative_pull)),
    )
