"""Joint angles by all corners: least squares on a model that predicts where corners are."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.fitting import Fit, least_squares
from perception.proprioception.estimate import Estimate, undefined
from perception.proprioception.observation import Observation

Predict = Callable[[Float[Array, " errors"], Float[Array, " joints"]], Float[Array, "views 4 2"]]
"""Where corners are imaged, from the finger's errors in units of their deviations, and its pose."""

ROBUST = 3.0
"""Corners off by more deviations than this count less (pseudo-Huber loss)."""

LOOSE = 10.0
"""Standard deviation of a joint angle before anything is seen, rad: no information."""

SOLVED, STEPS = 1e-9, 128
"""Relative tolerance of a pose, far below the corners' noise, and a cap on iterations: with many
corners that count less it converges linearly only."""


class CornerModel(eqx.Module):
    """What predicts the corners.

    Attributes:
        predict: the corners; differentiable. As a pytree (an ``eqx.Module`` with ``__call__``) it
            is compiled once for all fingers and image sizes.
        views: pad and path of every view, in the order in which they are predicted.
        joints: of every view, the index of the joint that moves it, or ``None``.
        errors: number of the finger's errors.
        names: of the joints.
        limits: least and greatest angle of any joint for which the model holds, rad.
    """

    predict: Predict
    views: tuple[tuple[str, str], ...] = eqx.field(static=True)
    joints: tuple[int | None, ...] = eqx.field(static=True)
    errors: int = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    limits: tuple[float, float] = eqx.field(static=True)


def deviations(
    model: CornerModel,
    errors: Float[Array, " errors"],
    angles: Float[Array, " joints"],
    seen: Observation,
) -> Float[Array, " data"]:
    """What is left of every corner's column and row, in standard deviations."""
    off = model.predict(errors, angles) - jnp.asarray(seen.corners)
    return jnp.einsum("vcij,vcj->vci", jnp.asarray(seen.whitening), off).reshape(-1)


def softened(left: Float[Array, " data"]) -> Float[Array, " data"]:
    """Deviations whose squares are those of the pseudo-Huber loss: outliers count less.

    Source: P. Charbonnier et al., IEEE Trans. Image Process. 6 (1997) 298, with
    2 δ² (√(1 + r²/δ²) − 1) = r² · 2 / (1 + √(1 + r²/δ²)).
    """
    return left * jnp.sqrt(2 / (1 + jnp.sqrt(1 + (left / ROBUST) ** 2)))


class Pose(NamedTuple):
    """Joint angles of a frame.

    Attributes:
        estimates: for each joint.
        covariance: of the joint angles, rad²; infinite and by itself where one is undefined.
    """

    estimates: list[Estimate]
    covariance: Float[np.ndarray, "joints joints"]


def find_pose(
    model: CornerModel,
    seen: Observation,
    guess: Float[np.ndarray, " joints"],
    errors: Float[np.ndarray, " errors"] | None = None,
    spread: Float[np.ndarray, "errors errors"] | None = None,
) -> Pose:
    """The joint angles of a frame by all of its corners; the first one compiles.

    Args:
        model: what predicts the corners.
        seen: the corners.
        guess: rough joint angles, rad; NaN where there is none.
        errors: of the finger, in units of their deviations; none by default.
        spread: covariance of these; none by default.

    Returns:
        An angle is undefined where no complete view tells it, where no pose fits, or where it
        would be beyond its range.
    """
    count = model.errors
    angles, spreads, ok = _solve(
        model,
        Observation(*map(jnp.asarray, seen)),
        jnp.asarray(np.where(np.isfinite(guess), guess, np.mean(model.limits))),
        jnp.asarray(np.zeros(count) if errors is None else errors),
        jnp.asarray(np.zeros((count, count)) if spread is None else spread),
    )
    found, covariance = np.asarray(angles), np.array(spreads)
    told = {joint for joint, there in zip(model.joints, seen.seen, strict=True) if there}
    low, high = model.limits
    estimates = []
    for joint, name in enumerate(model.names):
        if joint not in told:
            estimates.append(undefined(f"no complete view tells {name}"))
        elif not bool(ok):
            estimates.append(undefined(f"no pose fits the corners that tell {name}"))
        elif not low <= found[joint] <= high:
            estimates.append(undefined(f"the corners would have {name} beyond its range"))
        else:
            deviation = float(np.sqrt(covariance[joint, joint]))
            estimates.append(Estimate(float(found[joint]), deviation, "all corners"))
        if not estimates[-1].defined:
            covariance[joint] = covariance[:, joint] = 0
            covariance[joint, joint] = np.inf
    return Pose(estimates, covariance)


@eqx.filter_jit
def _solve(
    model: CornerModel,
    seen: Observation,
    guess: Float[Array, " joints"],
    errors: Float[Array, " errors"],
    spread: Float[Array, "errors errors"],
) -> tuple[Array, Array, Array]:
    def residuals(angles: Float[Array, " joints"], _: None) -> Float[Array, " data"]:
        left = softened(deviations(model, errors, angles, seen))
        return jnp.concatenate([left, (angles - guess) / LOOSE])

    fit: Fit = least_squares(
        residuals, guess, tolerance=SOLVED, max_steps=STEPS, differentiable=False
    )
    angles = fit.solution.value
    # Errors of the finger move the answer: d angles = −(JᵀJ)⁻¹ Jᵀ J_e d errors.
    by_angle = jax.jacfwd(residuals)(angles, None)
    by_error = jax.jacfwd(lambda e: softened(deviations(model, e, angles, seen)))(errors)
    moved = -fit.covariance @ by_angle[: len(by_error)].T @ by_error
    return angles, fit.covariance + moved @ spread @ moved.T, fit.solution.ok
