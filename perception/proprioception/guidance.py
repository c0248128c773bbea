"""Which frames to label next: those after which joint angles are known best.

A labelled frame adds information on the finger's errors. Of several, that is chosen which leaves
the least mean variance of joint angles over all poses (V-optimality; A. Atkinson, A. Donev,
R. Tobias, *Optimum Experimental Designs, with SAS*, 2007, ch. 10), one after the other.
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.fitting import add_information
from perception.proprioception.bounds import frame_information
from perception.proprioception.corners import LOOSE, CornerModel, FingerErrors
from perception.proprioception.observation import Observation

MOST = 3
"""Frames that are suggested at a time."""

WORTH = 0.9
"""A label that leaves more than this part of the deviation is not worth the effort."""

KNOWN = 0.5
"""Joint angles with a larger deviation are not seen in a frame, rad."""


class LabelAdvice(NamedTuple):
    """Frames to label.

    Attributes:
        before: root mean square deviation of joint angles over all poses without more labels, rad.
        poses: numbers of the poses to label.
        after: deviations after each of these and those before it, rad.
    """

    before: float
    poses: list[int]
    after: list[float]


def suggest_labels(
    model: CornerModel,
    errors: FingerErrors,
    seen: Observation,
    angles: Float[np.ndarray, "poses joints"],
    deviation: float,
) -> LabelAdvice:
    """The poses whose labels lower deviations of joint angles most.

    Args:
        model: what predicts the corners.
        errors: as far as they are known.
        seen: what is seen of the finger in many poses, spread over its ranges.
        angles: of these, rad.
        deviation: standard deviation of a label, rad.

    Returns:
        At most `MOST` poses, and no more than are worth it.

    Example:
        >>> from perception.proprioception import stack_observations
        >>> square = 100.0 * jnp.array([[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]])
        >>> predict = lambda errors, angles: square * (1 + angles[0] * (1 + errors[0]))
        >>> model = CornerModel(predict, (("tip", "direct"),), (0,), 1, ("dip",), (-0.2, 1.2))
        >>> certain, poses = np.tile(np.eye(2), (1, 4, 1, 1)), np.array([[0.1], [0.5], [0.9]])
        >>> corners = [np.asarray(predict(jnp.zeros(1), jnp.asarray(pose))) for pose in poses]
        >>> seen = stack_observations(
        ...     [Observation(frame, certain / 0.3, 0.3 * certain) for frame in corners]
        ... )
        >>> advice = suggest_labels(model, FingerErrors.of(model), seen, poses, 1e-3)
        >>> advice.after[0] < 0.5 * advice.before
        True
    """
    arrays = jax.tree.map(jnp.asarray, (seen, angles, deviation))
    found = map(np.asarray, _information(model, errors.mean, errors.scale, *arrays))
    own, both, rest, labels = found
    covariance = np.asarray(errors.covariance)
    known = _deviations(own, both, rest, covariance) < KNOWN
    before = _rms(own, both, rest, covariance, known)
    advice = LabelAdvice(before, [], [])
    while len(advice.poses) < MOST:
        tried = [add_information(covariance, one) for one in labels]
        after = [_rms(own, both, rest, one, known) for one in tried]
        best = int(np.argmin(after))
        if after[best] > WORTH * before:
            break
        covariance, before = tried[best], after[best]
        advice.poses.append(best)
        advice.after.append(before)
    return advice


@eqx.filter_jit
def _information(
    model: CornerModel,
    errors: Float[Array, " errors"],
    scale: Float[Array, ""],
    seen: Observation,
    angles: Float[Array, "poses joints"],
    deviation: Float[Array, ""],
) -> tuple[Array, Array, Array, Array]:
    """Of every pose on its angles, on both and on errors; and of its label on errors."""
    weighted = seen._replace(whitening=seen.whitening / scale)

    def one(seen: Observation, pose: Array) -> tuple[Array, Array, Array, Array]:
        own, both, rest = frame_information(model, errors, seen, pose, LOOSE)
        labelled = own + jnp.eye(len(pose)) / deviation**2
        return own, both, rest, rest - both.T @ jnp.linalg.solve(labelled, both)

    return jax.vmap(one)(weighted, angles)


def _deviations(
    own: np.ndarray, both: np.ndarray, rest: np.ndarray, covariance: np.ndarray
) -> Float[np.ndarray, "poses joints"]:
    """Of the joint angles of every pose, whose corners determine errors as well."""
    left = np.stack([add_information(covariance, one) for one in rest])
    shared = both @ left @ both.swapaxes(1, 2)
    return np.sqrt(np.diagonal(np.linalg.inv(own - shared), axis1=1, axis2=2))


def _rms(
    own: np.ndarray, both: np.ndarray, rest: np.ndarray, covariance: np.ndarray, known: np.ndarray
) -> float:
    squares = _deviations(own, both, rest, covariance)[known] ** 2
    return float(np.sqrt(np.mean(squares))) if known.any() else float("inf")
