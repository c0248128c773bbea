"""The least variance that any estimate has: the Cramér–Rao bound of the joint angles.

Source: H. L. Van Trees, *Detection, Estimation, and Modulation Theory*, part I, §2.4: with prior
knowledge of nuisances, here the finger's errors and what corners are off by in all frames alike,
their information adds to that of the data.
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from perception.proprioception.corners import LOOSE, CornerModel, deviations, slopes_by_offset
from perception.proprioception.observation import Observation


class Bound(NamedTuple):
    """Least standard deviations of a frame's joint angles, rad.

    Attributes:
        finger_known: if the finger's errors, and what its corners are off by, were known.
        calibrated: if they are known as well as the calibration frames determine them.
    """

    finger_known: Float[np.ndarray, " joints"]
    calibrated: Float[np.ndarray, " joints"]


def compute_information_bound(
    model: CornerModel,
    errors: Float[np.ndarray, " errors"],
    frame: tuple[Observation, Float[np.ndarray, " joints"]],
    frames: tuple[Observation, Float[np.ndarray, "frames joints"]],
    label_deviation: float | None,
) -> Bound:
    """The bound for a frame of a finger that other frames have calibrated.

    Args:
        model: what predicts the corners.
        errors: the finger's true errors, in units of their deviations.
        frame: what is seen in it, and its true joint angles, rad.
        frames: the same of the calibration frames.
        label_deviation: standard deviation of their labels, rad; ``None`` without labels.

    Example:
        >>> from perception.proprioception import stack_observations
        >>> square = 100.0 * jnp.array([[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]])
        >>> predict = lambda errors, angles: (square + errors[0]) * (1 + angles[0])
        >>> model = CornerModel(predict, (("tip", "direct"),), (0,), 1, ("dip",), (-0.2, 1.2))
        >>> corners = np.asarray(predict(jnp.zeros(1), jnp.array([0.4])))
        >>> certain = np.tile(np.eye(2), (1, 4, 1, 1))
        >>> seen = Observation(corners, certain / 0.3, 0.3 * certain)
        >>> frames = stack_observations([seen]), np.array([[0.4]])
        >>> bound = compute_information_bound(
        ...     model, np.zeros(1), (seen, np.array([0.4])), frames, 1e-3
        ... )
        >>> bool(bound.finger_known[0] <= bound.calibrated[0] < 0.01)  # rad
        True
    """
    spread = LOOSE if label_deviation is None else label_deviation
    given = errors, frame, frames, spread
    bounds = _bound(model, *jax.tree.map(jnp.asarray, given))
    return Bound(*(np.sqrt(np.diagonal(np.asarray(bound))) for bound in bounds))


@eqx.filter_jit
def _bound(
    model: CornerModel,
    errors: Float[Array, " errors"],
    frame: tuple[Observation, Float[Array, " joints"]],
    frames: tuple[Observation, Float[Array, "frames joints"]],
    spread: Float[Array, ""],
) -> tuple[Array, Array]:
    def about_errors(seen: Observation, pose: Array) -> Array:
        """Information of a frame on these when its own angles are not asked for."""
        own, both, rest = frame_information(model, errors, seen, pose, spread)
        return rest - both.T @ jnp.linalg.solve(own, both)

    own, both, rest = frame_information(model, errors, *frame, LOOSE)
    rest = rest + jnp.eye(len(rest)) + jnp.sum(jax.vmap(about_errors)(*frames), axis=0)
    return jnp.linalg.inv(own), jnp.linalg.inv(own - both @ jnp.linalg.solve(rest, both.T))


def frame_information(
    model: CornerModel,
    errors: Float[Array, " errors"],
    seen: Observation,
    pose: Float[Array, " joints"],
    spread: Float[Array, ""] | float,
) -> tuple[
    Float[Array, "joints joints"], Float[Array, "joints causes"], Float[Array, "causes causes"]
]:
    """Information of a frame on its own angles, on both, and on errors and offsets.

    Args:
        model: what predicts the corners.
        errors: in units of their deviations.
        seen: the frame's corners.
        pose: its joint angles, rad.
        spread: standard deviation of these before anything is seen, rad.
    """
    offsets = jnp.zeros(seen.corners.shape)
    slopes = jax.jacfwd(lambda e, p: deviations(model, e, offsets, p, seen), (0, 1))
    by_error, by_angle = slopes(errors, pose)
    by_error = jnp.concatenate([by_error, slopes_by_offset(seen)], axis=1)
    own = by_angle.T @ by_angle + jnp.eye(len(pose)) / spread**2
    return own, by_angle.T @ by_error, by_error.T @ by_error
