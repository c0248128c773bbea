"""What numbers over a few seeds do and do not show."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from scipy.stats import studentized_range

from studies.bending_posture.found import AtEta
from studies.models.soft_finger.chamber_spec import CLEARANCE

MARGIN = 1.2
"""A tip error that is larger by this at every seed is called worse."""

SURE = 0.95

ROOM_MM = CLEARANCE
"""What |Δl_D| is to leave inside Δl_A: the paper's "room to spare", as `table1` states it, mm."""


def judged(ratios: Sequence[float]) -> str:
    """What tip errors over others, seed by seed, say of the first."""
    if min(ratios) >= MARGIN:
        return "worse"
    if max(ratios) <= 1 / MARGIN:
        return "better"
    return "no different"


@dataclass(frozen=True)
class Comparison:
    """Mean tip errors of several chambers, beside what seeds alone do.

    Attributes:
        difference: between the largest and the least mean, mm.
        error: standard error of a mean over the seeds, pooled over the chambers, mm.
        limit: as many of these the difference would exceed in 5 % of the cases if all chambers were
            alike (Tukey's studentised range).
    """

    difference: float
    error: float
    limit: float

    @property
    def told(self) -> bool:
        """Whether the chambers differ by more than their seeds explain."""
        return self.difference > self.limit * self.error

    @property
    def errors(self) -> float:
        """The difference in standard errors."""
        if self.error == 0:
            return math.inf if self.difference else 0.0
        return self.difference / self.error


def compared(etas: Sequence[AtEta]) -> Comparison | None:
    """Whether one chamber reads the posture better than another; None if too few are known.

    Means over seeds of as many chambers are compared at once, for the best and the worst of several
    lie apart even if all are alike.
    """
    seeds = min((len(one.tip_errors) for one in etas), default=0)
    if len(etas) < 2 or seeds < 2:
        return None
    means = [statistics.mean(one.tip_errors) for one in etas]
    pooled = statistics.mean(statistics.variance(one.tip_errors) for one in etas)
    limit = float(studentized_range.ppf(SURE, len(etas), len(etas) * (seeds - 1)))
    return Comparison(max(means) - min(means), math.sqrt(pooled / seeds), limit)


def roomy(etas: Sequence[AtEta]) -> AtEta | None:
    """The chamber of the largest η that leaves the stated room; None if none does."""
    enough = [one for one in etas if one.clearance >= ROOM_MM]
    return max(enough, key=lambda one: one.eta, default=None)
