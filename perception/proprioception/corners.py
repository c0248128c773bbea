"""Joint angles by all corners: least squares on a model that predicts where corners are."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Bool, Float

from designopt.fitting import Fit, least_squares, robust_residuals
from designopt.solution import Solution
from perception.proprioception.misfit import SIGNIFICANCE, Misfit, chi_squared_limits, find_misfit
from perception.proprioception.observation import Observation

Predict = Callable[[Float[Array, " errors"], Float[Array, " joints"]], Float[Array, "views 4 2"]]
"""Where corners are imaged, from the finger's errors in units of their deviations, and its pose."""

LOOSE = 10.0
"""Standard deviation of a joint angle before anything is seen, rad: no information."""

NEAR, STEPS = 1e-3, 128
"""Relative tolerance of the pose that is refined then, and a cap on iterations of the search for
it: with many corners that count less it converges linearly only."""

REFINED, SETTLED, STILL = 32, 1e-4, 0.01
"""Cap on steps with the covariance of all that may move corners: where all corners fit a few are
enough, where many count less it takes tens. No more are needed after one below `SETTLED`; a pose
whose last step is not below `STILL` is no solution (both in standard deviations of the angles)."""

USUAL = 0.05
"""Part of the right frames whose χ² is beyond what is usual: it makes their deviations larger."""


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


class FingerErrors(eqx.Module):
    """What is known of one finger: nothing but its tolerances, or what a calibration found.

    Attributes:
        mean: errors in units of their standard deviations as fabricated.
        offsets: what every corner is off by in all frames alike, in units of the deviations of that
            in each (`Observation.common`).
        covariance: of errors and offsets together.
        scale: of the corners' stated standard deviations, at least 1: how much more the frames of
            a calibration scatter than these explain.
    """

    mean: Float[Array, " errors"]
    offsets: Float[Array, "views 4 2"]
    covariance: Float[Array, "causes causes"]
    scale: Float[Array, ""]

    @classmethod
    def of(
        cls,
        model: CornerModel,
        mean: Float[np.ndarray, " errors"] | None = None,
        covariance: Float[np.ndarray, "errors errors"] | None = None,
    ) -> FingerErrors:
        """Errors as they are stated; by default those of fabrication.

        Args:
            model: of the finger.
            mean: of the errors; 0 by default.
            covariance: of the errors; the identity by default, and 0 if they are known exactly.
        """
        mean = np.zeros(model.errors) if mean is None else mean
        own = np.eye(model.errors) if covariance is None else covariance
        offsets = np.zeros((len(model.views), 4, 2))
        both = scipy.linalg.block_diag(own, np.eye(offsets.size))
        return cls(
            mean=jnp.asarray(mean),
            offsets=jnp.asarray(offsets),
            covariance=jnp.asarray(both),
            scale=jnp.asarray(1.0, float),
        )


class JointAngles(eqx.Module):
    """Joint angles of a frame.

    Attributes:
        angles: rad.
        covariance: of these, rad²: corners, the finger's errors and constant corner errors.
        misfit: of all corners of the frame.
        own_misfit: of the corners of every joint's own views: an error of one joint alone stands
            out there, and would be lost among the other corners.
    """

    angles: Float[Array, " joints"]
    covariance: Float[Array, "joints joints"]
    misfit: Misfit
    own_misfit: Misfit

    @property
    def deviations(self) -> Float[Array, " joints"]:
        """Standard deviations of the angles, rad."""
        return jnp.sqrt(jnp.diagonal(self.covariance))


class JointAngleResult(eqx.Enumeration):
    """How the search for a joint angle ended."""

    successful = ""
    not_seen = "No complete view shows a pad that this joint moves: turn on more light, or move it."
    unsolved = "No pose fits the corners: the search for one did not end at a minimum."
    contradicted = (
        "The corners contradict the model of the finger at every pose: calibrate the finger "
        "(again), and check that the image is of this finger and camera and neither mirrored, "
        "scaled nor moved."
    )
    out_of_range = "The corners would place this joint beyond its range."


def deviations(
    model: CornerModel,
    errors: Float[Array, " errors"],
    offsets: Float[Array, "views 4 2"],
    angles: Float[Array, " joints"],
    seen: Observation,
) -> Float[Array, " data"]:
    """What is left of every corner's column and row, in standard deviations."""
    off = model.predict(errors, angles) - jnp.asarray(seen.corners)
    # A view that is not there may have no corners: not a number times no weight is not a number.
    off = jnp.where(seen.used, off, 0.0)
    off += jnp.einsum("vcij,vcj->vci", jnp.asarray(seen.common), offsets)
    return jnp.einsum("vcij,vcj->vci", jnp.asarray(seen.whitening), off).reshape(-1)


def slopes_by_offset(seen: Observation) -> Float[Array, "data data"]:
    """The derivative of `deviations` by the offsets."""
    slopes = jnp.asarray(seen.whitening) @ jnp.asarray(seen.common)
    return jax.scipy.linalg.block_diag(*slopes.reshape(-1, 2, 2))


def find_pose(
    model: CornerModel,
    seen: Observation,
    guess: Float[np.ndarray, " joints"],
    errors: FingerErrors | None = None,
    *,
    significance: float = SIGNIFICANCE,
) -> Solution[JointAngles]:
    """The joint angles of a frame by all of its corners; the first one compiles.

    Corners have the covariance C = s² N + J Σ Jᵀ of all that may move them: N of the corners, s
    their ``scale``, Σ of the finger's errors and constant offsets, J the derivative by these
    (linear model error; A. Tarantola, *Inverse Problem Theory*, 2005, §3.2). Angles have the least
    pseudo-Huber loss, of the corners by themselves at first and then of what has this covariance
    (generalized least squares). Whether corners agree with the finger at that pose is a χ² test of
    their raw residuals, of all views and of each joint's own. Of what is not refused, a χ² beyond
    that of 19 right frames of 20 makes the stated deviations larger, by its excess per degree of
    freedom.

    Args:
        model: what predicts the corners.
        seen: the corners.
        guess: rough joint angles, rad; NaN where there is none.
        errors: of the finger, from its calibration; by default those of fabrication.
        significance: probability at which a frame of the right finger is refused.

    Returns:
        One element for each joint. ``margin`` is the lesser of 1 − χ² / its limit and of the
        distance from the nearer end of the range over that range, −1 where nothing is found;
        ``residual`` is the last step, in standard deviations, and 1 where nothing is found.

    Raises:
        ValueError: the significance does not lie between 0 and 1.

    Example:
        >>> square = 100.0 * jnp.array([[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]])
        >>> predict = lambda errors, angles: (square + errors[0]) * (1 + angles[0])
        >>> model = CornerModel(predict, (("tip", "direct"),), (0,), 1, ("dip",), (-0.2, 1.2))
        >>> corners = np.asarray(predict(jnp.zeros(1), jnp.array([0.4])))
        >>> certain = np.tile(np.eye(2), (1, 4, 1, 1))
        >>> seen = Observation(corners, certain / 0.3, 0.3 * certain)
        >>> found = find_pose(model, seen, np.zeros(1))
        >>> bool(found.ok[0]), round(float(found.value.angles[0]), 4)
        (True, 0.4)
    """
    data, levels = 8 * len(model.views), (float(significance), USUAL)
    limits, usual = (chi_squared_limits(data, level) for level in levels)
    start = np.where(np.isfinite(guess), guess, np.mean(model.limits))
    errors = FingerErrors.of(model) if errors is None else errors
    # By NumPy: JAX would move each by a program of its own, which takes longer.
    return _solve(model, *jax.tree.map(np.asarray, (seen, start, errors, limits, usual)))


@eqx.filter_jit
def _solve(
    model: CornerModel,
    seen: Observation,
    guess: Float[Array, " joints"],
    errors: FingerErrors,
    limits: Float[Array, " counts"],
    usual: Float[Array, " counts"],
) -> Solution[JointAngles]:
    def left_at(own: Float[Array, " errors"], pose: Float[Array, " joints"]) -> Array:
        return deviations(model, own, errors.offsets, pose, seen)

    def residuals(angles: Float[Array, " joints"], _: None) -> Float[Array, " data"]:
        return jnp.concatenate(
            [robust_residuals(left_at(errors.mean, angles)), (angles - guess) / LOOSE]
        )

    fit: Fit = least_squares(
        residuals, guess, tolerance=NEAR, max_steps=STEPS, differentiable=False
    )
    noise, by_offset = errors.scale**2, slopes_by_offset(seen)

    def refined(angles: Float[Array, " joints"]) -> _Linear:
        """One Gauss-Newton step: corners that the finger's errors may move count less."""
        raw = left_at(errors.mean, angles), *jax.jacfwd(left_at, (0, 1))(errors.mean, angles)
        known = jnp.all(jnp.array([jnp.all(jnp.isfinite(one)) for one in raw]))
        left, by_error, by_angle = (jnp.where(known, one, 0.0) for one in raw)
        by_cause = jnp.concatenate([by_error, by_offset], axis=1)
        total = jnp.eye(left.size) + by_cause @ (errors.covariance / noise) @ by_cause.T
        whitened, slopes = _whitened(total, left, by_angle)
        slopes *= jax.vmap(jax.grad(robust_residuals))(whitened)[:, None]
        covariance = jnp.linalg.inv(slopes.T @ slopes + jnp.eye(len(angles)) / LOOSE**2)
        step = -covariance @ (slopes.T @ robust_residuals(whitened))
        covariances = noise * total, noise * covariance
        return _Linear(angles + step, left, by_angle, *covariances, step, known)

    # Where the refinement begins, by an infinite step, and what there is where it does not end.
    start = jax.tree.map(jnp.zeros_like, jax.eval_shape(refined, guess))._replace(
        angles=fit.solution.value,
        total=jnp.eye(seen.corners.size),
        covariance=LOOSE**2 * jnp.eye(len(guess)),
        step=jnp.full_like(guess, jnp.inf),
    )
    _, last = jax.lax.while_loop(
        lambda state: (state[0] < REFINED) & (state[1].moved > SETTLED),
        lambda state: (state[0] + 1, refined(state[1].angles)),
        (0, start),
    )
    found = last.known & jnp.all(jnp.isfinite(left_at(errors.mean, last.angles)))
    found &= last.moved < STILL
    last = last._replace(left=last.left + last.by_angle @ last.step)
    angles, left, by_angle, total, covariance, *_ = jax.tree.map(
        lambda end, begin: jnp.where(found, end, begin), last, start
    )

    def misfit_of(views: Bool[Array, " views"]) -> Misfit:
        """The misfit of some views by themselves, whatever the others show."""
        used = (jnp.asarray(seen.used) & views[:, None, None]).reshape(-1)
        both = used[:, None] & used[None, :]
        part = jnp.where(both, total, jnp.eye(left.size))
        own = jnp.where(used, left, 0), jnp.where(used[:, None], by_angle, 0)
        return find_misfit(*_whitened(part, *own), used)

    moves = np.array([[j == joint for j in model.joints] for joint in range(len(model.names))])
    misfit = misfit_of(jnp.ones(len(model.views), bool))
    own_misfit = jax.vmap(misfit_of)(jnp.asarray(moves))

    # Corners that scatter more than chance has it give larger deviations than stated.
    excess = jnp.sqrt(jnp.maximum(_excess(misfit, usual), _excess(own_misfit, usual)))
    covariance = covariance * jnp.outer(excess, excess)

    shown = jnp.any(moves & seen.seen[None, :], axis=1)
    low, high = model.limits
    agreement = jnp.minimum(_agreement(misfit, limits), _agreement(own_misfit, limits))
    room = jnp.minimum(angles - low, high - angles) / (high - low)

    def ended(
        shown: Bool[Array, ""], agreement: Float[Array, ""], room: Float[Array, ""]
    ) -> JointAngleResult:
        code = JointAngleResult
        result = code.where(room >= 0, code.successful, code.out_of_range)
        result = code.where(agreement >= 0, result, code.contradicted)
        result = code.where(found, result, code.unsolved)
        return code.where(shown, result, code.not_seen)

    margin = jnp.where(shown & found, jnp.minimum(agreement, room), -1.0)
    residual = jnp.broadcast_to(jnp.where(found, last.moved, 1.0), margin.shape)
    pose = JointAngles(angles, covariance, misfit, own_misfit)
    return Solution(pose, margin, residual, jax.vmap(ended)(shown, agreement, room))


class _Linear(NamedTuple):
    """What is left of the corners at some angles, and a step from there.

    Attributes:
        angles: that it leads to.
        left: in the corners' standard deviations.
        by_angle: its derivative.
        total: its covariance, by corners and by what the finger may be off.
        covariance: of the angles.
        step: of these.
        known: whether all that these follow from is finite.
    """

    angles: Float[Array, " joints"]
    left: Float[Array, " data"]
    by_angle: Float[Array, "data joints"]
    total: Float[Array, "data data"]
    covariance: Float[Array, "joints joints"]
    step: Float[Array, " joints"]
    known: Bool[Array, ""]

    @property
    def moved(self) -> Float[Array, ""]:
        """The step, in standard deviations."""
        return jnp.max(jnp.abs(self.step) / jnp.sqrt(jnp.diagonal(self.covariance)))


def _whitened(
    covariance: Float[Array, "data data"],
    left: Float[Array, " data"],
    slopes: Float[Array, "data joints"],
) -> tuple[Float[Array, " data"], Float[Array, "data joints"]]:
    """Numbers of a covariance, and their derivative, as independent ones of variance 1."""
    root = jnp.linalg.cholesky(covariance)
    both = jnp.concatenate([left[:, None], slopes], axis=1)
    found = jax.scipy.linalg.solve_triangular(root, both, lower=True)
    return found[:, 0], found[:, 1:]


def _excess(misfit: Misfit, usual: Float[Array, " counts"]) -> Float[Array, "*joints"]:
    """1, and what χ² per degree of freedom has beyond what is usual."""
    free = misfit.degrees_of_freedom
    return 1 + jnp.maximum(misfit.chi_squared - usual[free.astype(int)], 0.0) / jnp.maximum(free, 1)


def _agreement(misfit: Misfit, limits: Float[Array, " counts"]) -> Float[Array, "*joints"]:
    """1 − χ² over its limit."""
    return 1 - misfit.chi_squared / limits[misfit.degrees_of_freedom.astype(int)]
