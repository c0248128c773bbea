"""A toy finger for corners: two hinged pads, a mirror and a pad that stays, before a pinhole.

All that is compared with what perception makes of it is done here in NumPy alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from perception.matching import Sighting, View
from perception.proprioception import CornerModel, Observation
from perception.quality import Quality

VIEWS = (("low", "direct"), ("low", "mirror:low"), ("high", "direct"), ("still", "direct"))
MOVED_BY = (0, 0, 1, None)
LOW = (0, 1)
"""Views that the first joint moves."""

JOINTS, ERRORS = 2, 4
ZERO = 3
"""Which of the errors only labels give: the zero of the low joint."""

LIMITS = (-0.2, 1.2)
NOISE = 0.3
"""Standard deviation of a column and of a row, px."""

FOCAL = 150.0
MADE = np.array([0.8, -1.1, 0.6, -0.5])
"""Errors of a finger."""

POSE = np.array([0.7, 0.4])


class Toy(eqx.Module):
    """Corners of all views, from the errors and the angles of both joints.

    Errors, in units of their deviations, are the camera's place up and forward, its magnification
    and the zero of the low joint. To the corners, or in their stead, may come others that move in
    proportion: of one kind, both are compiled once.
    """

    focal: Float[Array, ""]
    hinged: Float[Array, ""]
    middle: Float[Array, "views 4 2"]
    by_error: Float[Array, "views 4 2 errors"]
    by_angle: Float[Array, "views 4 2 joints"]

    def __call__(
        self, errors: Float[Array, " errors"], angles: Float[Array, " joints"]
    ) -> Float[Array, "views 4 2"]:
        """A sum of parts."""
        straight = self.middle + self.by_error @ errors + self.by_angle @ angles
        return self.hinged * self._turned(errors, angles) + straight

    def _turned(
        self, errors: Float[Array, " errors"], angles: Float[Array, " joints"]
    ) -> Float[Array, "views 4 2"]:
        """Sections first; every end is then imaged at both of its sides."""
        up, forward, magnified, zero = errors * jnp.array([0.3, 0.5, 0.01, 0.02])
        reach = jnp.array([2.0, 12.0])
        low, high = angles[0] + zero, angles[1]
        lower = jnp.stack([22 - reach * jnp.sin(low), -2 - reach * jnp.cos(low)])
        image = lower * jnp.array([[1.0], [-1.0]]) - jnp.array([[0.0], [32.0]])
        upper = jnp.stack([24 - reach * jnp.sin(high), 3 + reach * jnp.cos(high)])
        still = jnp.array([[20.0, 20.0], [-1.5, 2.5]])
        sections = jnp.stack([lower, image, upper, still])[:, :, jnp.array([0, 1, 1, 0])]
        depth, height = sections[:, 0] - forward, sections[:, 1] - up
        beside = jnp.broadcast_to(jnp.array([[-4.0, -4.0, 4.0, 4.0]]), depth.shape)
        focal = self.focal * (1 + magnified)
        places = jnp.stack([beside, -height], axis=-1) * (focal / depth)[..., None]
        return places + jnp.array([[[320.0, 240.0]]])


def model_of(predict: Toy) -> CornerModel:
    return CornerModel(predict, VIEWS, MOVED_BY, ERRORS, ("bend", "curl"), LIMITS)


def hinged(focal: float = FOCAL) -> Toy:
    """Pads that turn about their hinges."""
    corners = (len(VIEWS), 4, 2)
    parts = [np.zeros((*corners, *more)) for more in ((), (ERRORS,), (JOINTS,))]
    return Toy(jnp.asarray(focal), jnp.asarray(1.0), *map(jnp.asarray, parts))


def straight(middle: np.ndarray, by_error: np.ndarray, by_angle: np.ndarray) -> Toy:
    """Corners that move in proportion, and nothing else."""
    parts = map(jnp.asarray, (middle, by_error, by_angle))
    return Toy(jnp.asarray(FOCAL), jnp.asarray(0.0), *parts)


HINGED = hinged()
MODEL = model_of(HINGED)

LOST = 1
"""A view that has no corners, where..."""

LOSING = model_of(eqx.tree_at(lambda toy: toy.middle, HINGED, HINGED.middle.at[LOST].set(jnp.nan)))
"""...the model has none for it either: they are no numbers."""

_predicted = jax.jit(lambda errors, angles: HINGED(errors, angles))


def corners_of(errors: np.ndarray, angles: np.ndarray) -> np.ndarray:
    return np.asarray(_predicted(jnp.asarray(errors), jnp.asarray(angles)))


def frame(
    errors: np.ndarray,
    angles: np.ndarray,
    *,
    generator: np.random.Generator | None = None,
    without: tuple[int, ...] = (),
    stated: float = NOISE,
    alike: np.ndarray | float = 0.0,
) -> Observation:
    """What is seen of a finger in a pose; with a generator its corners have `NOISE`.

    In all frames alike they may be off by as much as is stated by ``alike``.
    """
    corners = corners_of(errors, angles)
    if generator is not None:
        corners = corners + generator.normal(0, NOISE, corners.shape)
    whitening = np.broadcast_to(np.eye(2) / stated, (*corners.shape, 2)).copy()
    whitening[list(without)] = 0
    return Observation(corners, whitening, alike * np.broadcast_to(np.eye(2), whitening.shape))


def off_by(seen: Observation, place: Any, pixels: Any) -> Observation:
    """The same with some corners moved."""
    corners = np.array(seen.corners)
    corners[place] += pixels
    return seen._replace(corners=corners)


def pixels_of(offsets: np.ndarray, seen: Observation) -> np.ndarray:
    """What corners are off by in a frame, by what all frames have alike, px."""
    both = zip(np.reshape(seen.common, (-1, 2, 2)), offsets.reshape(-1, 2), strict=True)
    return np.reshape([common @ own for common, own in both], seen.corners.shape)


def uneven(seen: Observation, scales: np.ndarray | float = 1.0) -> Observation:
    """The same with weights that are full matrices."""
    turn = np.array([[1.0, 0.4], [-0.3, 0.8]])
    return seen._replace(whitening=np.asarray(seen.whitening) @ turn * scales)


def whitened(corners: np.ndarray, seen: Observation) -> np.ndarray:
    """Deviations of corners from what is seen, one product after the other."""
    left = np.zeros(corners.shape)
    for index in np.ndindex(*corners.shape[:-1]):
        off = corners[index] - np.asarray(seen.corners)[index]
        for row in range(2):
            left[*index, row] = np.sum(np.asarray(seen.whitening)[*index, row] * off)
    return left.ravel()


def differences(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Slopes by central differences, one column for each value: good to some 1e-9 of the slopes."""
    steps = 1e-5 * np.eye(at.size)
    return np.stack([(function(at + s) - function(at - s)) / 2e-5 for s in steps], axis=-1)


def view_of(
    pad: str,
    path: str,
    angles: tuple[float, float],
    *,
    shown: tuple[bool, bool] = (True, True),
    quality: Quality = Quality.COMPLETE,
) -> View:
    """A view whose two ends lie at section angles, both a little aslant."""
    aslant = np.array([0.01, -0.02, 0.02, -0.01])
    sections = np.array(angles)[[0, 1, 1, 0]] + aslant
    rays = np.stack([sections, np.array([-0.2, -0.2, 0.2, 0.2])], axis=-1)
    covariance = np.broadcast_to(0.01 * np.eye(2), (4, 2, 2)).copy()
    roughness = covariance / 4
    return View(pad, path, 0, quality, shown, 100 * rays, rays, covariance, roughness, 1000.0)


def missing(pad: str, path: str) -> View:
    nothing, unknown = np.full((4, 2), np.nan), np.full((4, 2, 2), np.nan)
    found = Quality.MISSING, (False, False), nothing, nothing
    return View(pad, path, 0, *found, unknown, unknown, 0.0)


def sighting_of(*views: View) -> Sighting:
    return Sighting(views, (), np.full(2, np.nan))
