"""The errors of one finger, from frames whose joint angles are known, or from any frames.

Errors, the angles of all frames, and what a corner is off by in every frame alike, are found
together: the maximum of their joint probability (bundle adjustment with priors; B. Triggs et al.,
*Bundle adjustment, a modern synthesis*, 2000).
A labelled frame has its label as a prior of its angles; an unlabelled one has none.
"""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.fitting import Fit, least_squares
from perception.proprioception.corners import LOOSE, CornerModel, deviations, softened
from perception.proprioception.observation import Observation

TOLERANCE = 1e-9

CONSTANT = 0.3
"""Standard deviation of what a corner is off by in every frame alike, px of any image,
beside what its own covariance tells: a pad's edge is always rough in the same places."""


@dataclass(frozen=True)
class Calibration:
    """What is known of a finger.

    Attributes:
        errors: in units of their deviations before.
        covariance: of these.
        angles: of the frames, rad.
        scatter: root mean square of the deviations of corners and of what was known before, in
            units of the expected; about 1 if both are as good as they were said to be.
        ok: whether the minimum was found.
    """

    errors: Float[np.ndarray, " errors"]
    covariance: Float[np.ndarray, "errors errors"]
    angles: Float[np.ndarray, "frames joints"]
    scatter: float
    ok: bool


def calibrate(
    model: CornerModel,
    seen: Observation,
    angles: Float[np.ndarray, "frames joints"],
    deviation: float | None = None,
    *,
    constant: float = CONSTANT,
) -> Calibration:
    """The errors of a finger from several frames.

    Args:
        model: what predicts the corners.
        seen: the corners, frames along the first axis.
        angles: the frames' labels, or rough angles to begin with, rad.
        deviation: standard deviation of the labels, rad; ``None`` if the angles are no labels.
        constant: that of what every corner is off by in all frames alike, px.

    Raises:
        ValueError: the deviation is not positive.
    """
    if deviation is not None and not deviation > 0:
        raise ValueError(f"labels have a positive deviation, not {deviation:g}")
    known = np.isfinite(angles) & (deviation is not None)
    spread = np.where(known, LOOSE if deviation is None else deviation, LOOSE)
    start = np.where(np.isfinite(angles), angles, np.mean(model.limits))
    fit, left = _calibrated(
        model,
        Observation(*map(jnp.asarray, seen)),
        jnp.asarray(start),
        jnp.asarray(spread),
        jnp.asarray(constant, float),
    )
    values, count = np.asarray(fit.solution.value), model.errors
    used = int(np.count_nonzero(np.asarray(left)))
    # With what priors are off by among the squares, only angles without a label are free.
    free = max(used - int(np.count_nonzero(~known)), 1)
    scatter = float(np.sqrt(float(fit.chi_squared) / free)) if used else 0.0
    return Calibration(
        values[:count],
        np.asarray(fit.covariance)[:count, :count],
        values[-start.size :].reshape(start.shape),
        scatter,
        bool(fit.solution.ok),
    )


@eqx.filter_jit
def _calibrated(
    model: CornerModel,
    seen: Observation,
    start: Float[Array, "frames joints"],
    spread: Float[Array, "frames joints"],
    constant: Float[Array, ""],
) -> tuple[Fit, Float[Array, " data"]]:
    # Errors and offsets, all of deviation 1, and then the angles.
    drawn = model.errors + seen.corners[0].size

    def corner_part(values: Float[Array, " values"]) -> Float[Array, " data"]:
        errors, angles = values[: model.errors], values[drawn:].reshape(start.shape)
        offsets = constant * values[model.errors : drawn].reshape(seen.corners[0].shape)

        def frame(pose: Array, one: Observation) -> Array:
            there = Observation(one.corners - offsets, one.whitening)
            return softened(deviations(model, errors, pose, there))

        return jax.vmap(frame)(angles, seen).reshape(-1)

    def residuals(values: Float[Array, " values"], _: None) -> Float[Array, " data"]:
        prior = ((values[drawn:].reshape(start.shape) - start) / spread).reshape(-1)
        return jnp.concatenate([corner_part(values), values[:drawn], prior])

    guess = jnp.concatenate([jnp.zeros(drawn), start.reshape(-1)])
    fit = least_squares(residuals, guess, tolerance=TOLERANCE, max_steps=64, differentiable=False)
    return fit, corner_part(fit.solution.value)
