"""A camera's lens from pictures of a board: its model chosen by pictures that were held out."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from designopt.errors import UserError
from optics.calibration.bundle import (
    POSE,
    Bundle,
    Poses,
    Prior,
    Sightings,
    adjust,
    board_points,
    find_poses,
)
from optics.calibration.calibrated import CalibratedLens
from optics.calibration.prior import prior_of
from optics.calibration.starts import AHEAD, LEAST_POINTS, find_starts, start_poses
from optics.scene.camera import turning_point

LEAST_PICTURES = 3
"""Of a plane board that determine a lens: with two, the focal length hangs on few corners."""

FOLDS = 5
"""Parts of the pictures, each of which is held out once."""

TRIED = 3
"""Starts that are tried until one ends in a lens that fits."""

FITS_PX = 2.0
"""Median error of a search that has ended near the lens and not in another minimum."""

EXPECTED_PX = 0.3
"""Deviation of a corner while nothing is known of it: what is off by many of these counts less."""

LEAST_PX = 0.003
"""Deviation of a corner below which rounding, not pictures, would decide on what a minimum is."""

OUTLIER = 5.0
"""A corner off by more deviations, in column or row, is wrong: none of 10⁶ right ones is."""

ROUNDS = 6
"""Of leaving wrong corners out and fitting anew; two or three leave nothing to change."""

MULTIPLE = 4
"""Numbers of pictures for which programs are compiled."""


class PupilModel(enum.Enum):
    """How the entrance pupil depends on the angle from the axis; values are words for a person."""

    FIXED = "fixed"
    MOVING = "moving"


class HeldOut(NamedTuple):
    """Errors at corners of pictures that a fit has not been given.

    Each picture's pose is that of one half of its corners, and the other half is compared.

    Attributes:
        median: distance between predicted and seen corner, px.
        squares: mean of its square in every picture with corners, px².
    """

    median: float
    squares: Float[np.ndarray, " pictures"]

    @property
    def rms(self) -> float:
        """Root mean square distance, of all pictures alike, px."""
        return float(np.sqrt(np.mean(self.squares)))


@dataclass(frozen=True)
class LensFit:
    """A lens as pictures of a board have it, and what is left of them.

    Attributes:
        calibrated: the lens.
        pupil: how its pupil moves.
        held_out: errors at held-out corners, of every model of the pupil.
        pictures: which of the given pictures show enough of the board.
        poses: of the board in each of these.
        sightings: in each of these, with infinite deviations where a corner is not used: it is not
            seen, or off by more than `OUTLIER` deviations.
        residuals: predicted minus seen places, px; 0 where nothing is seen.
    """

    calibrated: CalibratedLens
    pupil: PupilModel
    held_out: dict[PupilModel, HeldOut]
    pictures: Int[np.ndarray, " pictures"]
    poses: Poses
    sightings: Sightings
    residuals: Float[np.ndarray, "pictures most 2"]

    @property
    def used(self) -> Bool[np.ndarray, "pictures most"]:
        """Which corners have been used."""
        return np.asarray(self.sightings.used)

    def distances(self) -> Float[np.ndarray, " pictures"]:
        """From the pupil to the middle of what is seen of every board, mm; NaN where nothing is."""
        return _distances(self.poses, self.sightings)

    def angles(self) -> Float[np.ndarray, "pictures most"]:
        """From the axis to every point of the boards, rad."""
        points = board_points(self.poses, self.sightings.points)
        return np.asarray(self.calibrated.lens.angles(points))


def calibrate_lens(sightings: Sightings, size: tuple[int, int], name: str = "camera") -> LensFit:
    """The lens that shows a plane board where it is seen.

    The pupil moves if that lowers the mean of squared errors at held-out corners, or that of their
    logarithms, by more than its standard error over pictures (the rule of L. Breiman et al.,
    *Classification and Regression Trees*, 1984, §3.4.3).

    Args:
        sightings: of the board; stated deviations count against each other only, for their scale
            follows from the residuals.
        size: columns and rows of the images.
        name: of the camera.

    Raises:
        UserError: too few pictures show enough of the board, or no lens fits them.
    """
    seen = np.asarray(sightings.used)
    enough = np.flatnonzero(seen.sum(axis=1) >= LEAST_POINTS)
    if len(enough) < LEAST_PICTURES:
        raise UserError(
            f"{len(enough)} of {len(seen)} pictures show at least {LEAST_POINTS} corners of the "
            f"board, and a lens takes {LEAST_PICTURES} or more; take pictures of more of it, sharp "
            "and evenly lit, and check that the board is the stated one"
        )
    shown = _filled_up(jax.tree.map(lambda leaf: np.asarray(leaf)[enough], sightings))
    first, prior = _first_fit(shown, size)
    best, kept, noise = _without_outliers(shown, first, prior)
    held = _with_fixed_pupil(prior)
    held_out = {
        PupilModel.FIXED: _held_out(kept, best, held, noise),
        PupilModel.MOVING: _held_out(kept, best, prior, noise),
    }
    pupil = _simplest(held_out)
    if pupil is PupilModel.FIXED:
        best, kept, noise = _without_outliers(shown, best, held)
    own = slice(len(enough))
    poses, kept = (jax.tree.map(lambda leaf: leaf[own], one) for one in (best.poses, kept))
    points, used = np.asarray(board_points(poses, kept.points)), np.asarray(kept.used)
    widest = float(np.max(np.asarray(best.lens.angles(jnp.asarray(points)))[used]))
    if turning_point(np.asarray(best.lens.coefficients)) <= widest:
        raise UserError(
            "no lens fits the pictures: image heights would not grow with the angle all over the "
            "image; take more pictures with the board near the image's edge"
        )
    away = _distances(poses, kept)
    away = away[np.isfinite(away)]
    calibrated = CalibratedLens(
        lens=best.lens,
        size=size,
        covariance=best.covariance,
        noise=noise * float(np.median(np.asarray(kept.deviations)[used])),
        held_out=held_out[pupil].median,
        widest=widest,
        distances=(float(away.min()), float(away.max())),
        pictures=len(away),
        name=name,
    )
    return LensFit(calibrated, pupil, held_out, enough, poses, kept, best.residuals[own])


def _filled_up(shown: Sightings) -> Sightings:
    """With pictures that show nothing, to a number for which a program is already compiled."""
    more = -len(shown.deviations) % MULTIPLE
    one = jax.tree.map(lambda leaf: leaf[-1:], shown)
    empty = eqx.tree_at(lambda one: one.deviations, one, np.full_like(one.deviations, np.inf))
    parts = shown, *more * [empty]
    return jax.tree.map(lambda *leaves: jnp.asarray(np.concatenate(leaves)), *parts)


def locate_boards(
    lens: CalibratedLens, sightings: Sightings
) -> tuple[Poses, Float[np.ndarray, "pictures most 2"]]:
    """The pose of the board in every picture of a calibrated camera.

    Args:
        lens: of the camera.
        sightings: of the board, at least `LEAST_POINTS` in each picture; those that are not used
            count nothing.

    Returns:
        Poses, and predicted minus seen places of all corners that have one, px.

    Example:
        >>> from optics.calibration import Fisheye
        >>> square = 10.0 * jnp.array([[[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [0, 2.0]]])
        >>> fisheye = Fisheye(400.0, jnp.array([639.5, 479.5]), jnp.zeros(4), jnp.zeros(2))
        >>> lens = CalibratedLens(
        ...     fisheye, (1280, 960), np.eye(9), 0.05, 0.05, 1.2, (20.0, 40.0), 10
        ... )
        >>> points = jnp.concatenate([square, jnp.full((1, 6, 1), 30.0)], axis=-1)
        >>> seen = Sightings(square, fisheye.places(points), jnp.ones((1, 6)))
        >>> poses, left = locate_boards(lens, seen)
        >>> [round(float(one), 3) for one in jnp.abs(poses.shifts[0])]
        [0.0, 0.0, 30.0]
    """
    there = np.isfinite(np.asarray(sightings.places))
    rays, _ = lens.lens.rays(jnp.where(there, sightings.places, 0.0))
    parts = (sightings.points, rays, sightings.used)
    begin, _ = start_poses(*map(np.asarray, parts))
    return find_poses(lens.lens, sightings, begin)


def _first_fit(shown: Sightings, size: tuple[int, int]) -> tuple[Bundle, Prior]:
    """A fit in which wrong corners count little, from the likeliest start that ends in one."""
    found = []
    # In px: how corners compare with each other matters once most of them fit.
    alike = eqx.tree_at(lambda one: one.deviations, shown, jnp.where(shown.used, 1.0, jnp.inf))
    for lens, poses, error in find_starts(shown, size)[:TRIED]:
        prior = prior_of(lens, size)
        # While all corners are far off, none of them is wrong against the others.
        near = adjust(_weighted(alike, max(error, EXPECTED_PX)), lens, poses, prior, robust=True)
        bundle = adjust(_weighted(alike, EXPECTED_PX), near.lens, near.poses, prior, robust=True)
        error = float(np.median(np.abs(bundle.residuals[np.asarray(shown.used)])))
        found.append((error, bundle, prior))
        if error < FITS_PX:
            break
    error, bundle, prior = min(found, key=lambda one: one[0])
    if error >= FITS_PX:
        raise UserError(
            f"no lens fits the pictures: half of the corners are off by more than {error:.3g} px; "
            "check that all pictures are of one camera at one focus and zoom, and that the board "
            "is flat and the stated one"
        )
    return bundle, prior


def _without_outliers(
    shown: Sightings, bundle: Bundle, prior: Prior
) -> tuple[Bundle, Sightings, float]:
    """The least-squares fit to all corners but those that it is off from, and their deviation."""
    seen = np.asarray(shown.used)
    stated = np.where(seen, np.asarray(shown.deviations), 1.0)
    least = LEAST_PX / float(np.median(stated[seen]))
    used, own, noise = seen, shown, EXPECTED_PX
    for _ in range(ROUNDS):
        relative = np.abs(bundle.residuals) / stated[..., None]
        # The median of what is left of a normal distribution, which outliers do not move.
        noise = max(float(np.median(relative[used])) / 0.6745, least)
        kept = seen & np.all(relative < OUTLIER * noise, axis=-1)
        kept &= kept.sum(axis=1, keepdims=True) >= LEAST_POINTS
        own = eqx.tree_at(lambda one: one.deviations, shown, np.where(kept, stated, np.inf))
        bundle = adjust(_weighted(own, noise), bundle.lens, bundle.poses, prior, robust=False)
        unchanged, used = np.array_equal(kept, used), kept
        if unchanged:
            break
    if not bundle.solved or used.any(axis=1).sum() < LEAST_PICTURES:
        raise UserError(
            "no lens fits the pictures: the search did not end at a minimum; take more pictures of "
            "the board, tilted and in all parts of the image"
        )
    left = (bundle.residuals / stated[..., None])[used]
    free = left.size - len(prior.mean) - POSE * int(used.any(axis=1).sum())
    scatter = float(np.sqrt(np.sum(left**2) / free))
    # Corners of one picture may be off together, and the lens may be no polynomial: then the
    # corners' deviation explains only a part of what pictures contradict each other by.
    scale = max((scatter / noise) ** 2, bundle.scatter)
    covariance = bundle.covariance * scale
    return bundle._replace(covariance=covariance), own, scatter


def _held_out(shown: Sightings, bundle: Bundle, prior: Prior, noise: float) -> HeldOut:
    """Errors at corners of pictures that the fit has not been given, fold by fold."""
    deviations = np.asarray(shown.deviations)
    count, most = deviations.shape
    folds = min(FOLDS, int(np.isfinite(deviations).any(axis=1).sum()))
    halves = np.arange(most) % 2
    distance = np.zeros((count, most))
    for fold in range(folds):
        out = np.arange(count) % folds == fold
        given = np.where(out[:, None], np.inf, deviations)
        without = eqx.tree_at(lambda one: one.deviations, shown, given)
        lens = adjust(
            _weighted(without, noise), bundle.lens, bundle.poses, prior, robust=False
        ).lens
        for half in range(2):
            own = np.where(halves == half, deviations, np.inf)
            some = eqx.tree_at(lambda one: one.deviations, shown, own)
            _, left = find_poses(lens, _weighted(some, noise), bundle.poses)
            other = out[:, None] & np.isfinite(deviations) & (halves != half)
            distance[other] = np.hypot(*np.moveaxis(left, -1, 0))[other]
    seen = np.isfinite(deviations)
    squares = [
        np.mean(one[which] ** 2) for one, which in zip(distance, seen, strict=True) if any(which)
    ]
    return HeldOut(float(np.median(distance[seen])), np.array(squares))


def _simplest(held_out: dict[PupilModel, HeldOut]) -> PupilModel:
    """The fixed pupil, unless its squared errors are a standard error above the moving one's.

    Or their logarithms are, by which a picture far outside of the others counts no more than these.
    """
    fixed, moving = (held_out[model].squares for model in PupilModel)
    for worse in (fixed - moving, np.log(fixed) - np.log(moving)):
        if float(np.mean(worse)) > float(np.std(worse)) / math.sqrt(len(worse)):
            return PupilModel.MOVING
    return PupilModel.FIXED


def _with_fixed_pupil(prior: Prior) -> Prior:
    """The prior with the pupil's shift held at 0."""
    mean, root = prior.mean.copy(), prior.root.copy()
    mean[-2:] = root[-2:] = 0.0
    return Prior(mean, root)


def _weighted(shown: Sightings, noise: float) -> Sightings:
    """Sightings whose deviations are multiplied."""
    return eqx.tree_at(lambda one: one.deviations, shown, shown.deviations * noise)


def _distances(poses: Poses, shown: Sightings) -> Float[np.ndarray, " pictures"]:
    points = np.asarray(board_points(poses, shown.points))
    pairs = zip(points, np.asarray(shown.used), strict=True)
    middles = [np.mean(one[used], axis=0) if any(used) else AHEAD * np.nan for one, used in pairs]
    return np.linalg.norm(middles, axis=-1)
