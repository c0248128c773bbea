"""How well a calibrated lens predicts images, and which pictures of the board would help most.

The lens's covariance becomes deviations of image places; what a small motion of the camera explains
does not count, for the camera's own pose is found anew wherever it is built in. A picture of the
board adds the information that its corners have on the lens while its pose is not known. That with
the least mean variance over the image is chosen (A. Atkinson, A. Donev, R. Tobias, *Optimum
Experimental Designs, with SAS*, 2007, ch. 10: V-optimality), one picture after the other.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.spatial.transform import Rotation

from designopt.fitting import add_information
from optics.calibration.bundle import POSE, Parameters, lens_of, parameters_of, turn
from optics.calibration.calibrated import CalibratedLens

GRID = (32, 24)
"""Places along and down the image at which deviations are predicted."""

FIELD_SHARES = (0.35, 0.6, 0.8, 0.95)
"""Where boards are tried beside the axis: the angle of their middle from it, as a part of the
widest angle in the image."""

AZIMUTHS = 8
"""Directions from the axis in which boards are tried."""

BEYOND = 1.15
"""The image is supposed to go on to so many times the angle of the farthest corner, if its size
allows: what lies farther out may be dark, and will be reached by the pictures after the next."""

TILT = math.radians(40)
"""Of boards that are tried, about each of two axes and either way, beside those that face the
camera."""

LEAST_SHARE = 0.4
"""Of a board's points that must be in the image."""

MARGIN = 4.0
"""So near the image's border no corner is found, px."""

MOST = 3
"""Pictures that are suggested at a time."""

WORTH, ENOUGH_PX = 0.9, 0.01
"""A picture that leaves more than this part of the deviation is not worth taking, and none is where
the deviation is below that of any corner."""


class DeviationMap(NamedTuple):
    """How far predicted places are off, without what a motion of the camera explains.

    Attributes:
        places: columns and rows, shape (down, along, 2).
        deviations: of column or row, root mean square of both, px; NaN where nothing is imaged.
        reached: whether there have been corners as far from the axis.
    """

    places: Float[np.ndarray, "down along 2"]
    deviations: Float[np.ndarray, "down along"]
    reached: Bool[np.ndarray, "down along"]

    @property
    def rms(self) -> float:
        """Of the places that corners have reached, px."""
        return float(np.sqrt(np.mean(self.deviations[self.reached] ** 2)))


class Suggestion(NamedTuple):
    """A picture to take.

    Attributes:
        distance: of the board's middle from the pupil, mm.
        angle: of the middle from the optical axis, rad.
        place: column and row at which it is imaged.
        tilt: between the board's normal and the line of sight, rad.
        outline: columns and rows of the board's points, NaN where they are not imaged.
        deviation: root mean square over the image, also where no corner has been, after this
            picture and the suggestions before it, px.
    """

    distance: float
    angle: float
    place: tuple[float, float]
    tilt: float
    outline: Float[np.ndarray, "points 2"]
    deviation: float


def predict_deviations(lens: CalibratedLens, distance: float) -> DeviationMap:
    """Deviations of where points are imaged that are as far away as stated (mm)."""
    places, slopes = _slopes_over_image(lens, distance)
    variances = np.einsum("nci,ij,ncj->n", slopes, lens.covariance, slopes) / 2
    deviations = np.full(places.shape[:2], np.nan)
    deviations[np.isfinite(places[..., 0])] = np.sqrt(np.maximum(variances, 0.0))
    rays, _ = lens.lens.rays(jnp.asarray(_grid(lens)))
    reached = np.arccos(np.asarray(rays)[..., 2]) <= lens.widest
    return DeviationMap(_grid(lens), deviations, reached & np.isfinite(deviations))


def suggest_pictures(
    lens: CalibratedLens,
    points: Float[np.ndarray, "points 2"],
    distances: tuple[float, float],
) -> list[Suggestion]:
    """Pictures of the board that lower the deviations most, one after the other.

    Args:
        lens: as it is known so far.
        points: of the board, mm.
        distances: nearest and farthest at which the board may be held, mm.

    Returns:
        At most `MOST`, and no more than are worth it.
    """
    middle = math.sqrt(distances[0] * distances[1])
    _, slopes = _slopes_over_image(lens, middle)
    wanted = np.einsum("nci,ncj->ij", slopes, slopes) / (2 * len(slopes))
    tried = list(_boards(lens, (distances[0], middle, distances[1])))
    turns, shifts = (np.array([getattr(one, name) for one in tried]) for name in ("turn", "shift"))
    centered = points - (points.min(axis=0) + points.max(axis=0)) / 2
    given = parameters_of(lens.lens), turns, shifts, centered
    places, angles, by_lens, by_pose = map(np.asarray, _board_slopes(*map(jnp.asarray, given)))
    seen = _is_imaged(lens, places, angles)
    useful = np.flatnonzero(seen.mean(axis=1) >= LEAST_SHARE)
    information = [
        _information(by_lens[i, seen[i]], by_pose[i, seen[i]]) / lens.noise**2 for i in useful
    ]
    covariance, found = lens.covariance, list[Suggestion]()
    before = float(np.sqrt(np.trace(wanted @ covariance)))
    while len(found) < MOST and len(useful) and before > ENOUGH_PX:
        after = [add_information(covariance, one) for one in information]
        deviations = [float(np.sqrt(np.trace(wanted @ one))) for one in after]
        best = int(np.argmin(deviations))
        if deviations[best] > WORTH * before:
            break
        covariance, before, index = after[best], deviations[best], int(useful[best])
        board, outline = tried[index], np.where(seen[index, :, None], places[index], np.nan)
        place = np.asarray(lens.lens.places(jnp.asarray(board.shift)))
        found.append(
            Suggestion(board.distance, board.angle, (float(place[0]), float(place[1])),
                       board.tilt, outline, before)
        )  # fmt: skip
    return found


class _Board(NamedTuple):
    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, "3"]
    distance: float
    angle: float
    tilt: float


def _boards(lens: CalibratedLens, distances: tuple[float, float, float]) -> Iterator[_Board]:
    """Boards that may be held before the camera."""
    rays, _ = lens.lens.rays(jnp.asarray(_grid(lens)))
    widest = float(np.arccos(np.asarray(rays)[..., 2][_has_image(lens)]).max())
    directions = [(0.0, 0.0)] + [
        (share * widest, 2 * math.pi * i / AZIMUTHS)
        for share, i in itertools.product(FIELD_SHARES, range(AZIMUTHS))
    ]
    tilts = [np.zeros(3)] + [sign * TILT * axis for sign in (-1, 1) for axis in np.eye(3)[:2]]
    for distance, (angle, azimuth), tilt in itertools.product(distances, directions, tilts):
        # About the axis towards the azimuth, by the angle: the board faces the pupil there.
        about = angle * np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        facing, leaning = Rotation.from_rotvec([about, tilt]).as_matrix()
        shift, lean = distance * facing[:, 2], float(np.abs(tilt).max())
        yield _Board(facing @ leaning, shift, distance, angle, lean)


def _grid(lens: CalibratedLens) -> Float[np.ndarray, "down along 2"]:
    sides = [(np.arange(n) + 0.5) / n * size - 0.5 for n, size in zip(GRID, lens.size, strict=True)]
    return np.stack(np.meshgrid(*sides), axis=-1)


def _slopes_over_image(
    lens: CalibratedLens, distance: float
) -> tuple[Float[np.ndarray, "down along 2"], Float[np.ndarray, "places 2 parameters"]]:
    """Places with NaN where nothing is imaged; and of the others, derivatives by the lens.

    What a motion of the camera does to all places together is taken out.
    """
    places, imaged = _grid(lens), _has_image(lens)
    rays, before = map(np.asarray, lens.lens.rays(jnp.asarray(places)))
    points = distance * rays + before[..., None] * np.array([0.0, 0.0, 1.0])
    given = parameters_of(lens.lens), points[imaged]
    by_lens, by_motion = map(np.asarray, _slopes(*map(jnp.asarray, given)))
    columns = by_motion.reshape(-1, POSE)
    basis = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]
    flat = by_lens.reshape(len(columns), -1)
    left = flat - basis @ (basis.T @ flat)
    return np.where(imaged[..., None], places, np.nan), left.reshape(by_lens.shape)


@eqx.filter_jit
def _slopes(
    lens: Parameters, points: Float[Array, "places 3"]
) -> tuple[Float[Array, "places 2 parameters"], Float[Array, "places 2 6"]]:
    """Derivatives of places by the lens, and by a motion of the points."""

    def place(lens: Array, motion: Array, point: Array) -> Array:
        return lens_of(lens).places(turn(motion[:3]) @ point + motion[3:])

    slopes = jax.vmap(jax.jacfwd(place, (0, 1)), (None, None, 0))
    return slopes(lens, jnp.zeros(POSE), points)


@eqx.filter_jit
def _board_slopes(
    lens: Parameters,
    turns: Float[Array, "boards 3 3"],
    shifts: Float[Array, "boards 3"],
    points: Float[Array, "points 2"],
) -> tuple[Array, Array, Array, Array]:
    """Places and angles of points of boards, and derivatives by the lens and the board's pose."""
    seen = jnp.einsum("bij,nj->bni", turns[..., :2], points) + shifts[:, None]
    by_lens, by_pose = jax.vmap(_slopes, (None, 0))(lens, seen)
    return lens_of(lens).places(seen), lens_of(lens).angles(seen), by_lens, by_pose


def _is_imaged(
    lens: CalibratedLens,
    places: Float[np.ndarray, "*points 2"],
    angles: Float[np.ndarray, "*points"],
) -> np.ndarray:
    """Whether corners can be found there."""
    within = np.all((places >= MARGIN) & (places <= np.array(lens.size) - 1 - MARGIN), axis=-1)
    return within & (angles < _supposed(lens))


def _has_image(lens: CalibratedLens) -> Bool[np.ndarray, "down along"]:
    """Whether anything is imaged at the places of the grid: farther out they have no ray."""
    away = np.linalg.norm(_grid(lens) - np.asarray(lens.lens.principal), axis=-1)
    return away <= float(lens.lens.focal * lens.lens.projection.height(jnp.array(_supposed(lens))))


def _supposed(lens: CalibratedLens) -> float:
    """Angle from the axis up to which there is an image, rad."""
    return min(BEYOND * lens.widest, 0.999 * lens.lens.projection.widest)


def _information(
    by_lens: Float[np.ndarray, "points 2 parameters"], by_pose: Float[np.ndarray, "points 2 6"]
) -> Float[np.ndarray, "parameters parameters"]:
    """On the lens, of corners of deviation 1 whose board's pose is not known."""
    slopes, pose = by_lens.reshape(-1, by_lens.shape[-1]), by_pose.reshape(-1, POSE)
    left = slopes - pose @ np.linalg.lstsq(pose, slopes)[0]
    return left.T @ left
