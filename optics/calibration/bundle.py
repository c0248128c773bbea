"""Bundle adjustment on rays: one lens, and a pose of the board in every picture.

Source: B. Triggs et al., *Bundle adjustment, a modern synthesis*, 2000, §4 and §6: least squares
over all unknowns together, a Jacobian of which most entries are 0, and robust weights; each picture
by its own QR factorisation.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from designopt.fitting import Fit, least_squares, robust_residuals
from optics.calibration.fisheye import Fisheye

Parameters = Float[Array, " parameters"]
"""Of a lens: focal length, principal point, k₁, k₂, …, e₂, e₄."""

POSE = 6
"""Parameters of a board's pose: a turn after that of its start, and a translation."""

TOLERANCE, STEPS = 1e-9, 20
"""Of the search, and a cap on its steps: ten or so find a minimum; then rounding turns residuals
about where pictures do not determine the lens, and the search may not see that it has ended."""

BOLD = 1e3
"""First steps are nearly those of Gauss and Newton: from a fit to other corners 9 are enough, not
30, and from a rough start they are as many."""

POSE_STEPS = 30
"""Cap on the steps of the search for a single pose."""

BLOCK = 128
"""Rows that are factorised at once. OpenBLAS gives matrices of more than 8192 numbers to threads,
for which those of XLA do not make room: on two cores it took a hundred times as long."""

FIELD = np.linspace(0.1, 1.0, 10)
"""Angles of the field at which image heights are looked at, over the widest at which a point is."""

LOOSE = 1e3
"""Standard deviation of a pose before anything is seen, rad and mm: no information."""


class Sightings(eqx.Module):
    """Where points of a plane board are seen in several pictures, filled up to one number.

    Attributes:
        points: in the board's plane, mm.
        places: column and row.
        deviations: standard deviation of either, px; infinite where nothing is seen.
    """

    points: Float[Array, "pictures most 2"]
    places: Float[Array, "pictures most 2"]
    deviations: Float[Array, "pictures most"]

    @property
    def used(self) -> Bool[Array, "pictures most"]:
        """What is seen."""
        return jnp.isfinite(self.deviations)


class Poses(eqx.Module):
    """From boards to the camera frame: x ↦ turn (x, y, 0) + shift (mm)."""

    turns: Float[Array, "*pictures 3 3"]
    shifts: Float[Array, "*pictures 3"]


class Prior(NamedTuple):
    """What is known of the lens before: a normal distribution of its parameters, in their order.

    Attributes:
        mean: the expected parameters.
        root: of their covariance, root rootᵀ; a row of zeros holds a parameter where it is. The
            search is in units of its columns, so these should be as independent in pictures as may
            be.
    """

    mean: Float[np.ndarray, " parameters"]
    root: Float[np.ndarray, "parameters parameters"]


class Bundle(NamedTuple):
    """What a bundle adjustment found.

    Attributes:
        lens: the lens.
        poses: of the board.
        residuals: found minus seen places, px, used or not; 0 where there is none.
        covariance: of the lens's parameters, by the stated deviations.
        solved: whether the search ended at a minimum.
        scatter: mean square of what pictures contradict each other by, in the lens's parameters or
            in its image heights, where it is more, in units of what the stated deviations let
            expect: above 1, corners of one picture are off together, or no lens of this kind is
            right.
    """

    lens: Fisheye
    poses: Poses
    residuals: Float[np.ndarray, "pictures most 2"]
    covariance: Float[np.ndarray, "parameters parameters"]
    solved: bool
    scatter: float


def parameters_of(lens: Fisheye) -> Float[np.ndarray, " parameters"]:
    """Focal length, principal point, k₁, k₂, …, e₂ and e₄."""
    parts = lens.focal[None], lens.principal, lens.coefficients, lens.pupil_shift
    return np.concatenate([np.asarray(part) for part in parts])


def lens_of(parameters: Parameters | Float[np.ndarray, " parameters"]) -> Fisheye:
    """The lens of these parameters; inverts `parameters_of`."""
    return Fisheye(parameters[0], parameters[1:3], parameters[3:-2], parameters[-2:])


def adjust(
    sightings: Sightings, lens: Fisheye, poses: Poses, prior: Prior, *, robust: bool
) -> Bundle:
    """Lens and poses with the least squared residuals, or the least pseudo-Huber loss.

    Args:
        sightings: of the board.
        lens: where to start.
        poses: where to start.
        prior: of the lens.
        robust: whether corners off by many deviations count less.
    """
    off = parameters_of(lens) - prior.mean
    # Of a parameter that is held, the column of zeros has the coordinate 0.
    start = jnp.asarray(np.linalg.lstsq(prior.root, off)[0])
    mean, root = jnp.asarray(prior.mean), jnp.asarray(prior.root)
    found = _adjusted(sightings, start, poses, mean, root, jnp.asarray(robust))
    parameters, moved, left, solved, covariance, scatter = found
    arrays = np.asarray(left), np.asarray(covariance)
    return Bundle(lens_of(parameters), moved, *arrays, bool(solved), float(scatter))


def turn(vector: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The rotation matrix of a rotation vector (rad; Rodrigues' formula)."""
    square = jnp.sum(vector * vector)
    small = square < 1e-12
    angle = jnp.sqrt(jnp.where(small, 1.0, square))
    first = jnp.where(small, 1.0 - square / 6, jnp.sin(angle) / angle)
    second = jnp.where(small, 0.5 - square / 24, (1 - jnp.cos(angle)) / (angle * angle))
    x, y, z = vector
    zero = jnp.zeros_like(x)
    cross = jnp.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
    return jnp.eye(3) + first * cross + second * cross @ cross


def board_points(
    poses: Poses, points: Float[Array, "pictures most 2"]
) -> Float[Array, "pictures most 3"]:
    """Points of the board in the camera frame, mm."""
    return jnp.einsum("pij,pnj->pni", poses.turns[..., :2], points) + poses.shifts[:, None]


def place_errors(
    lens: Parameters,
    pose: Float[Array, "6"],
    base: tuple[Float[Array, "3 3"], Float[Array, "3"]],
    points: Float[Array, "most 2"],
    places: Float[Array, "most 2"],
) -> Float[Array, "most 2"]:
    """Predicted minus seen places of one picture, px, with a pose moved from its base."""
    rotation = turn(pose[:3]) @ base[0]
    return lens_of(lens).places(points @ rotation[:, :2].T + (base[1] + pose[3:])[None]) - places


@eqx.filter_jit
def _adjusted(
    sightings: Sightings,
    start: Parameters,
    poses: Poses,
    mean: Parameters,
    root: Float[Array, "parameters parameters"],
    robust: Bool[Array, ""],
) -> tuple[Array, Poses, Array, Array, Array, Array]:
    (count, _), own = sightings.deviations.shape, len(start)
    weights = jnp.where(sightings.used, 1 / sightings.deviations, 0.0)
    there = jnp.isfinite(sightings.places)
    places = jnp.where(there, sightings.places, 0.0)

    def pictures(values: Array) -> tuple[Array, Array]:
        return values[:own], values[own:].reshape(count, POSE)

    def weighted(lens: Array, pose: Array, *one: Array) -> Array:
        turns, shifts, points, seen, weight = one
        off = place_errors(mean + root @ lens, pose, (turns, shifts), points, seen)
        off *= weight[:, None]
        # What is not seen may have no place.
        off = jnp.where(weight[:, None] > 0, off, 0.0).reshape(-1)
        return jnp.where(robust, robust_residuals(off), off)

    given = poses.turns, poses.shifts, sightings.points, places, weights

    def condensed(lens: Array, pose: Array, *one: Array) -> tuple[Array, Array]:
        """One picture in as few numbers as it has parameters, with the same squares and slopes.

        An orthogonal map leaves sums of squares, gradients and normal equations as they are: to
        hundreds of corners belong as many residuals that depend on parameters, and the norm of what
        does not. Poses come first, so that the last rows are free of them.
        """
        by_lens, by_pose = jax.jacfwd(weighted, (0, 1))(lens, pose, *one)
        triangle = _triangle(jnp.column_stack([by_pose, by_lens, weighted(lens, pose, *one)]))
        return triangle[:, -1], triangle[:, :-1]

    @jax.jit  # traced once, in whatever it is called from
    def every_picture(lens: Array, poses: Array) -> tuple[Array, Array]:
        # One after the other: jaxlib factorises a batch in threads, and two batches at a time, of
        # residuals and of slopes, wait for each other's threads for ever.
        return jax.lax.map(lambda one: condensed(lens, *one), (poses, *given))

    def residuals(values: Array, _: None) -> Array:
        lens, pose = pictures(values)
        seen = every_picture(lens, pose)[0]
        return jnp.concatenate([seen.reshape(-1), lens, pose.reshape(-1) / LOOSE])

    def jacobian(values: Array, _: None) -> Array:
        triangles = every_picture(*pictures(values))[1]
        # The norm of what does not depend on parameters has no slope.
        by_pose, by_lens = triangles[..., :POSE], triangles[..., POSE:].reshape(-1, own)
        apart = by_pose[:, :, None, :] * jnp.eye(count)[:, None, :, None]
        seen = jnp.concatenate([by_lens, apart.reshape(-1, count * POSE)], axis=1)
        before = jnp.concatenate([jnp.ones(own), jnp.full(count * POSE, 1 / LOOSE)])
        return jnp.concatenate([seen, jnp.diag(before)])

    # A step of one in any direction changes the residuals alike: Marquardt's scaling. Damping
    # begins as the square of one over `BOLD`.
    begin = jnp.concatenate([start, jnp.zeros(count * POSE)])
    size = jnp.linalg.norm(residuals(begin, None))
    unit = BOLD * size / jnp.linalg.norm(jacobian(begin, None), axis=0)
    fit: Fit = least_squares(
        lambda z, _: residuals(begin + unit * z, None),
        jnp.zeros_like(begin),
        jacobian=lambda z, _: jacobian(begin + unit * z, None) * unit[None],
        tolerance=TOLERANCE,
        max_steps=STEPS,
        differentiable=False,
    )
    values = begin + unit * fit.solution.value
    lens, pose = pictures(values)
    found = mean + root @ lens
    left = jax.vmap(place_errors, (None, 0, 0, 0, 0))(found, pose, given[:2], *given[2:4])
    left = jnp.where(there, left, 0.0)
    moved = Poses(jax.vmap(turn)(pose[:, :3]) @ poses.turns, poses.shifts + pose[:, 3:])
    covariance = (fit.covariance * unit[None] * unit[:, None])[:own, :own]
    seen, triangles = every_picture(lens, pose)
    lower, slopes = seen[:, POSE:-1], triangles[:, POSE:-1, POSE:]
    spread = jnp.einsum("pij,jk,plk->pil", slopes, covariance, slopes)
    # A picture of few corners restricts fewer parameters of the lens.
    corners = jnp.sum(weights > 0, axis=1, dtype=weights.dtype)
    numbers = jnp.clip(2 * corners - POSE, 0, own)
    shown = corners > 0
    expected = jnp.where(shown, numbers - jnp.trace(spread, axis1=1, axis2=2), 0.0)
    scatter = jnp.sum(jnp.where(shown[:, None], lower**2, 0.0))
    scatter /= jnp.maximum(jnp.sum(expected), 1.0)
    # Corners that are off together, as neighbors are whose windows share pixels, move smooth image
    # heights more than the many parameters that stand for finer waves.
    angles = lens_of(found).angles(board_points(moved, sightings.points))
    widest = jnp.max(jnp.where(sightings.used, angles, 0.0))

    def heights(lens: Array) -> Array:
        one = lens_of(mean + root @ lens)
        return one.focal * one.projection.height(widest * FIELD)

    rows = jax.jacfwd(heights)(lens)
    rows /= jnp.sqrt(jnp.einsum("hi,ij,hj->h", rows, covariance, rows))[:, None]
    pulls = jnp.einsum("hi,ij,pkj->phk", rows, covariance, slopes)
    expected = jnp.sum(pulls**2) - jnp.einsum("phi,pij,phj->", pulls, spread, pulls)
    pulled = jnp.sum(jnp.einsum("phk,pk->ph", pulls, lower) ** 2)
    scatter = jnp.maximum(scatter, pulled / jnp.maximum(expected, TOLERANCE))
    return found, moved, left, fit.solution.ok, root @ covariance @ root.T, scatter


def _triangle(matrix: Float[Array, "rows columns"]) -> Float[Array, "columns columns"]:
    """The triangular factor of a tall matrix, block by block.

    Source: J. Demmel et al., *Communication-optimal parallel and sequential QR and LU
    factorizations*, SIAM J. Sci. Comput. 34 (2012), which is not read.
    """
    rows, columns = matrix.shape
    blocks = jnp.pad(matrix, ((0, -rows % BLOCK), (0, 0))).reshape(-1, BLOCK, columns)

    def with_block(triangle: Array, block: Array) -> tuple[Array, None]:
        return jnp.linalg.qr(jnp.concatenate([triangle, block]), mode="r"), None

    begin = jnp.zeros((columns, columns), matrix.dtype)
    return jax.lax.scan(with_block, begin, blocks)[0]


def find_poses(
    lens: Fisheye, sightings: Sightings, poses: Poses
) -> tuple[Poses, Float[np.ndarray, "pictures most 2"]]:
    """The pose of the board in every picture by itself, with a lens that is known.

    Args:
        lens: of the camera.
        sightings: of the board.
        poses: where to start.

    Returns:
        Poses of the least pseudo-Huber loss, and found minus seen place of every corner, px, of
        those that have a place, used or not.
    """
    found, left = _posed(jnp.asarray(parameters_of(lens)), sightings, poses)
    return found, np.asarray(left)


@eqx.filter_jit
def _posed(lens: Parameters, sightings: Sightings, poses: Poses) -> tuple[Poses, Array]:
    def one(base: tuple[Array, Array], points: Array, places: Array, weight: Array) -> Any:
        def residuals(values: Array, _: None) -> Array:
            off = place_errors(lens, values, base, points, places) * weight[:, None]
            off = jnp.where(weight[:, None] > 0, off, 0.0)
            return jnp.concatenate([robust_residuals(off).reshape(-1), values / LOOSE])

        fit = least_squares(
            residuals,
            jnp.zeros(POSE),
            tolerance=TOLERANCE,
            max_steps=POSE_STEPS,
            differentiable=False,
        )
        pose = fit.solution.value
        left = place_errors(lens, pose, base, points, places)
        return Poses(turn(pose[:3]) @ base[0], base[1] + pose[3:]), left

    weights = jnp.where(sightings.used, 1 / sightings.deviations, 0.0)
    there = jnp.isfinite(sightings.places)
    places = jnp.where(there, sightings.places, 0.0)
    found, left = jax.vmap(one)((poses.turns, poses.shifts), sightings.points, places, weights)
    return found, jnp.where(there, left, 0.0)
