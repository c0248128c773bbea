"""One shape for the answer of every way to estimate a joint angle."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """A joint angle, or that it is undefined, which is never a number.

    Attributes:
        angle: rad; NaN where it is undefined.
        deviation: predicted standard deviation, rad; infinite where it is undefined.
        reason: why it is undefined, or by what it was found.
    """

    angle: float
    deviation: float
    reason: str

    @property
    def defined(self) -> bool:
        """Whether there is an angle."""
        return math.isfinite(self.angle)


def undefined(reason: str) -> Estimate:
    """No angle, and why."""
    return Estimate(math.nan, math.inf, reason)


def first_defined(*estimates: Estimate) -> Estimate:
    """The first of several estimates that is defined: each is the fall-back of the one before."""
    return next((estimate for estimate in estimates if estimate.defined), estimates[0])
