"""The errors of one finger, from frames whose joint angles are known, or from any frames.

Errors, and the angles of all frames, are found together: the maximum of their joint probability
(bundle adjustment with priors; B. Triggs et al., *Bundle adjustment, a modern synthesis*, 2000).
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


@dataclass(frozen=True)
class Calibration:
    """What is known of a finger.

    Attributes:
        errors: in units of their deviations before.
        covariance: of these.
        angles: of the frames, rad.
        scatter: root mean square of the corners' deviations, in units of the expected; about 1 if
            the corners are as good as they were said to be.
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
) -> Calibration:
    """The errors of a finger from several frames.

    Args:
        model: what predicts the corners.
        seen: the corners, frames along the first axis.
        angles: the frames' labels, or rough angles to begin with, rad.
        deviation: standard deviation of the labels, rad; ``None`` if the angles are no labels.

    Raises:
        ValueError: the deviation is not positive.
    """
    if deviation is not None and not deviation > 0:
        raise ValueError(f"labels have a positive deviation, not {deviation:g}")
    known = np.isfinite(angles) & (deviation is not None)
    spread = np.where(known, LOOSE if deviation is None else deviation, LOOSE)
    start = np.where(np.isfinite(angles), angles, np.mean(model.limits))
    fit, left = _calibrated(
        model, Observation(*map(jnp.asarray, seen)), jnp.asarray(start), jnp.asarray(spread)
    )
    values, count = np.asarray(fit.solution.value), model.errors
    used = np.asarray(left) != 0
    free = max(int(used.sum()) - values.size + count, 1)
    scatter = float(np.sqrt(np.sum(np.asarray(left) ** 2) / free))
    return Calibration(
        values[:count],
        np.asarray(fit.covariance)[:count, :count],
        values[count:].reshape(start.shape),
        scatter,
        bool(fit.solution.ok),
    )


@eqx.filter_jit
def _calibrated(
    model: CornerModel,
    seen: Observation,
    start: Float[Array, "frames joints"],
    spread: Float[Array, "frames joints"],
) -> tuple[Fit, Float[Array, " data"]]:
    def corner_part(values: Float[Array, " values"]) -> Float[Array, " data"]:
        errors, angles = values[: model.errors], values[model.errors :].reshape(start.shape)

        def frame(pose: Array, one: Observation) -> Array:
            return softened(deviations(model, errors, pose, one))

        return jax.vmap(frame)(angles, seen).reshape(-1)

    def residuals(values: Float[Array, " values"], _: None) -> Float[Array, " data"]:
        angles = values[model.errors :].reshape(start.shape)
        prior = ((angles - start) / spread).reshape(-1)
        return jnp.concatenate([corner_part(values), values[: model.errors], prior])

    guess = jnp.concatenate([jnp.zeros(model.errors), start.reshape(-1)])
    fit = least_squares(residuals, guess, tolerance=TOLERANCE, max_steps=64, differentiable=False)
    return fit, corner_part(fit.solution.value)
