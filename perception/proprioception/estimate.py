"""One shape for the answer of every way to estimate a joint angle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from designopt.solution import Solution
from perception.proprioception.corners import JointAngles


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


def make_undefined(reason: str) -> Estimate:
    """No angle, and why.

    Example:
        >>> make_undefined("no view is complete").defined
        False
    """
    return Estimate(math.nan, math.inf, reason)


def select_defined(*estimates: Estimate) -> Estimate:
    """The first of several estimates that is defined: each is the fall-back of the one before.

    Example:
        >>> select_defined(make_undefined("no gap"), Estimate(0.5, 0.01, "edge")).angle
        0.5
    """
    return next((estimate for estimate in estimates if estimate.defined), estimates[0])


def split_estimates(solution: Solution[JointAngles]) -> list[Estimate]:
    """The answer of `find_pose` in the shape of every other method, one element for each joint.

    Example:
        >>> import jax.numpy as jnp
        >>> from perception.proprioception import CornerModel, Observation, find_pose
        >>> square = 100.0 * jnp.array([[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]])
        >>> predict = lambda errors, angles: (square + errors[0]) * (1 + angles[0])
        >>> model = CornerModel(predict, (("tip", "direct"),), (0,), 1, ("dip",), (-0.2, 1.2))
        >>> corners = np.asarray(predict(jnp.zeros(1), jnp.array([0.4])))
        >>> certain = np.tile(np.eye(2), (1, 4, 1, 1))
        >>> seen = Observation(corners, certain / 0.3, 0.3 * certain)
        >>> [round(one.angle, 4) for one in split_estimates(find_pose(model, seen, np.zeros(1)))]
        [0.4]
    """
    numbers = map(np.asarray, (solution.ok, solution.value.angles, solution.value.deviations))
    return [
        Estimate(float(angle), float(deviation), "all corners") if ok else make_undefined(message)
        for ok, angle, deviation, message in zip(*numbers, solution.messages(), strict=True)
    ]
