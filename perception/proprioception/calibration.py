"""The errors of one finger, from frames whose joint angles are known, or from any frames.

Errors, the angles of all frames, and what a corner is off by in every frame alike, are found
together: the maximum of their joint probability (bundle adjustment with priors; B. Triggs et al.,
*Bundle adjustment, a modern synthesis*, 2000).
A labelled frame has its label as a prior of its angles; an unlabelled one has none.
"""

from __future__ import annotations

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from designopt.fitting import Fit, least_squares, robust_residuals
from designopt.solution import Solution
from perception.proprioception.corners import (
    LOOSE,
    CornerModel,
    FingerErrors,
    deviations,
)
from perception.proprioception.misfit import Misfit, find_misfit
from perception.proprioception.observation import Observation

TOLERANCE, STEPS = 1e-9, 256
"""Of the search, and a cap on its steps: with many corners that count less it converges linearly
only."""

MOST_SCATTER = 1.5
"""Frames that scatter more, in units of their stated deviations, are no calibration."""


class Calibration(eqx.Module):
    """What frames reveal of a finger.

    Attributes:
        errors: of the finger and its corners, with their covariance by the frames, times the square
            of the scatter where this is above 1.
        angles: of the frames, rad.
        misfit: of all corners, labels and fabrication tolerances together.
    """

    errors: FingerErrors
    angles: Float[Array, "frames joints"]
    misfit: Misfit

    @property
    def scatter(self) -> Float[Array, ""]:
        """Root mean square of all deviations per degree of freedom, in units of the stated."""
        return self.misfit.rms


class CalibrationResult(eqx.Enumeration):
    """How a calibration ended."""

    successful = ""
    unsolved = "No errors of the finger fit the frames: the search did not end at a minimum."
    scattered = (
        "The frames scatter more than 1.5 times as much as corners, labels and fabrication "
        "tolerances allow: the finger has an error that the model lacks, a label or a view is "
        "wrong, or a stated deviation is too small."
    )


def calibrate(
    model: CornerModel,
    seen: Observation,
    angles: Float[np.ndarray, "frames joints"],
    deviation: float | None = None,
    before: FingerErrors | None = None,
) -> Solution[Calibration]:
    """The errors of a finger from several frames.

    The scatter is the square root of χ² over its degrees of freedom, as in the test of
    `find_pose`. Where it is above 1, stated deviations are too small by that factor, and all
    deviations that are derived from them are scaled by it (R. T. Birge, Phys. Rev. 40 (1932) 207).

    Args:
        model: what predicts the corners.
        seen: the corners, frames along the first axis.
        angles: the frames' labels, or rough angles to begin with, rad.
        deviation: standard deviation of the labels, rad; ``None`` if the angles are no labels.
        before: what is known of the finger; nothing but its tolerances by default.

    Returns:
        ``margin`` is 1 − scatter / 1.5, and −1 where no minimum was found.

    Raises:
        ValueError: the deviation is not positive.

    Example:
        >>> from perception.proprioception import stack_observations
        >>> square = 100.0 * jnp.array([[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]])
        >>> predict = lambda errors, angles: (square + errors[0]) * (1 + angles[0])
        >>> model = CornerModel(predict, (("tip", "direct"),), (0,), 1, ("dip",), (-0.2, 1.2))
        >>> certain, labels = np.tile(np.eye(2), (1, 4, 1, 1)), np.array([[0.1], [0.5], [0.9]])
        >>> corners = [
        ...     np.asarray(predict(jnp.array([2.0]), jnp.asarray(angles))) for angles in labels
        ... ]
        >>> seen = stack_observations(
        ...     [Observation(frame, certain / 0.3, 0.3 * certain) for frame in corners]
        ... )
        >>> found = calibrate(model, seen, labels, 1e-3)
        >>> bool(found.ok), round(float(found.value.errors.mean[0]), 1)
        (True, 2.0)
    """
    if deviation is not None and not deviation > 0:
        raise ValueError(f"labels have a positive deviation, not {deviation:g}")
    labelled = np.isfinite(angles) & (deviation is not None)
    spread = np.where(labelled, LOOSE if deviation is None else deviation, LOOSE)
    start = np.where(np.isfinite(angles), angles, np.mean(model.limits))
    before = FingerErrors.of(model) if before is None else before
    arrays = jax.tree.map(jnp.asarray, (seen, start, spread, labelled, before))
    return _calibrated(model, *arrays)


@eqx.filter_jit
def _calibrated(
    model: CornerModel,
    seen: Observation,
    start: Float[Array, "frames joints"],
    spread: Float[Array, "frames joints"],
    labelled: Bool[Array, "frames joints"],
    before: FingerErrors,
) -> Solution[Calibration]:
    # Errors and offsets, and then the angles.
    drawn = model.errors + seen.corners[0].size
    mean = jnp.concatenate([before.mean, before.offsets.reshape(-1)])
    root = jnp.linalg.cholesky(before.covariance)

    def corner_part(values: Float[Array, " values"]) -> Float[Array, " data"]:
        errors, angles = values[: model.errors], values[drawn:].reshape(start.shape)
        offsets = values[model.errors : drawn].reshape(seen.corners[0].shape)
        frame = partial(deviations, model, errors, offsets)
        return jax.vmap(frame)(angles, seen).reshape(-1)

    def prior_part(values: Float[Array, " values"]) -> Float[Array, " values"]:
        off = (values[drawn:] - start.reshape(-1)) / spread.reshape(-1)
        known = jax.scipy.linalg.solve_triangular(root, values[:drawn] - mean, lower=True)
        return jnp.concatenate([known, off])

    def residuals(values: Float[Array, " values"], _: None) -> Float[Array, " data"]:
        return jnp.concatenate([robust_residuals(corner_part(values)), prior_part(values)])

    guess = jnp.concatenate([mean, start.reshape(-1)])
    fit: Fit = least_squares(
        residuals, guess, tolerance=TOLERANCE, max_steps=STEPS, differentiable=False
    )
    values, found = fit.solution.value, fit.solution.ok

    def raw(values: Float[Array, " values"]) -> tuple[Array, Array]:
        left = jnp.concatenate([corner_part(values), prior_part(values)])
        return left, left

    jacobian, left = jax.jacfwd(raw, has_aux=True)(values)
    used = jnp.concatenate([seen.used.reshape(-1), jnp.ones(drawn, bool), labelled.reshape(-1)])
    misfit = find_misfit(jnp.where(found, left, 0.0), jnp.where(found, jacobian, 0.0), used)
    scale = jnp.maximum(misfit.rms, 1.0)
    errors = FingerErrors(
        values[: model.errors],
        values[model.errors : drawn].reshape(seen.corners[0].shape),
        scale**2 * fit.covariance[:drawn, :drawn],
        scale,
    )
    code = CalibrationResult
    result = code.where(misfit.rms <= MOST_SCATTER, code.successful, code.scattered)
    result = code.where(found, result, code.unsolved)
    margin = jnp.where(found, 1 - misfit.rms / MOST_SCATTER, -1.0)
    calibration = Calibration(errors, values[drawn:].reshape(start.shape), misfit)
    return Solution(calibration, margin, fit.solution.residual, result)
