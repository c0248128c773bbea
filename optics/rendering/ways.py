"""Rays of an image's pixels on their way in space, all at once: over flat and bowed mirrors.

A flat mirror turns all rays as it turns the camera (the method of images), so only the camera's
axes are mirrored; from a bowed one on, every ray has its own start and direction. Rays are kept in
the axes of the camera, or of the bowed mirror that they come from, as arrays for each coordinate;
coordinates that all rays share are numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from optics.scene.imaging import Imaging
from optics.visibility.corners_in_space import SpatialCamera, SpatialMirror

Coordinates = tuple[Any, Any, Any]
"""Along three axes, for each an array over pixels or a number."""

TINY = 1e-9


class Rays(NamedTuple):
    """Rays of pixels in the camera's own axes; their directions are of length 1 in the section.

    Attributes:
        ahead: along the optical axis.
        above: towards lesser rows.
        slope: towards greater columns.
        pupil: where they start on the optical axis, mm; ``None`` if all start at the pinhole.
        per_pixel: by how much the section angle changes from pixel to pixel, rad.
    """

    ahead: Float[np.ndarray, "rows columns"]
    above: Float[np.ndarray, "rows columns"]
    slope: Float[np.ndarray, "rows columns"]
    pupil: Float[np.ndarray, "rows columns"] | None
    per_pixel: Float[np.ndarray, "rows columns"]

    @classmethod
    def of(cls, imaging: Imaging, scale: float = 1.0) -> Rays:
        """Those of all pixels of an image that is larger by a factor."""
        angle, slope = np.moveaxis(imaging.ray_map(scale), -1, 0)
        ahead, above = np.cos(angle), np.sin(angle)
        steps = np.array([*np.gradient(ahead), *np.gradient(above)])
        per_pixel = np.maximum(np.sqrt(np.sum(steps**2, axis=0)), TINY)
        pupil = None
        if imaging.camera.pupil_shift is not None:
            theta = np.arccos(np.clip(ahead.astype(float) / np.sqrt(1 + slope**2), -1, 1))
            pupil = np.asarray(imaging.camera.pupil_at(jnp.asarray(theta)), np.float32)
        return cls(ahead, above, np.ascontiguousarray(slope), pupil, per_pixel)

    def at(self, window: tuple[slice, slice]) -> Rays:
        """Those of a part of the image."""
        pupil = None if self.pupil is None else self.pupil[window]
        ahead, above, slope, per_pixel = (
            part[window] for part in (self.ahead, self.above, self.slope, self.per_pixel)
        )
        return Rays(ahead, above, slope, pupil, per_pixel)


class Leg(NamedTuple):
    """Rays between two mirrors, before the first, or after the last.

    Attributes:
        turn: the axes in which they are given, as columns.
        shift: origin of these, mm.
        start: places on the rays, mm.
        way: their directions.
    """

    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, "3"]
    start: Coordinates
    way: Coordinates

    @classmethod
    def first(cls, camera: SpatialCamera, rays: Rays) -> Leg:
        """Rays as they leave the camera."""
        turn, shift = axes_of(camera)
        start = (0.0 if rays.pupil is None else rays.pupil, 0.0, 0.0)
        return cls(turn, shift, start, rays[:3])

    def within(self, origin: np.ndarray, axes: np.ndarray) -> tuple[Coordinates, Coordinates]:
        """Places on the rays, and their directions, in other axes, given as rows."""
        turn, shift = axes @ self.turn, axes @ (self.shift - origin)
        start = tuple(float(s) + _sum(row, self.start) for s, row in zip(shift, turn, strict=True))
        return start, tuple(_sum(row, self.way) for row in turn)

    def reflected(self, mirror: SpatialMirror) -> Leg:
        """The rays after one mirror."""
        normal, middle = np.asarray(mirror.normal), np.asarray(mirror.middle)
        if mirror.bow is None or not float(mirror.bow):
            turn, shift = mirrored(self.turn, self.shift, mirror)
            return Leg(turn, shift, self.start, self.way)
        along, bow = np.asarray(mirror.along), float(mirror.bow)
        axes = np.stack([along, normal, np.cross(along, normal)])
        (u, v, w), (du, dv, dw) = self.within(middle, axes)
        # notation: the mirror is v = bow - bend · u²; the ray meets it after the part that is
        # nearest to where it meets the chord.
        bend = bow / float(mirror.half) ** 2
        square, slope, rest = bend * du * du, dv + 2 * bend * u * du, v - bow + bend * u * u
        root = np.sqrt(np.maximum(slope * slope - 4 * square * rest, 0))
        below = slope + np.copysign(root, slope)
        part = -2 * rest / np.where(below == 0, TINY, below)
        u, v, w = u + part * du, v + part * dv, w + part * dw
        lean = 2 * bend * u
        toward = 2 * (lean * du + dv) / (1 + lean * lean)
        return Leg(axes.T, middle, (u, v, w), (du - toward * lean, dv - toward, dw))

    def past(self, place: Float[np.ndarray, "2"]) -> Float[np.ndarray, "rows columns"]:
        """How far rays pass to the left of a line across the section, at a place in it, mm.

        Seen along the rays, and over their length in the section.
        """
        off, turn = place - self.shift[:2], self.turn
        passed = _sum(off[0] * turn[1] - off[1] * turn[0], self.way)
        if all(np.isscalar(part) and part == 0 for part in self.start):
            return passed
        start, way = ([_sum(row, of) for row in turn[:2]] for of in (self.start, self.way))
        return passed - (start[0] * way[1] - start[1] * way[0])


def legs_of(
    camera: SpatialCamera, rays: Rays, mirrors: SpatialMirror, word: Sequence[int]
) -> list[Leg]:
    """Rays on all legs of a path.

    Args:
        camera: the camera.
        rays: in its axes.
        mirrors: all mirrors.
        word: those along the path.
    """
    legs = [Leg.first(camera, rays)]
    for number in word:
        legs.append(legs[-1].reflected(one_of(mirrors, number)))
    return legs


def axes_of(
    camera: SpatialCamera, mirrors: SpatialMirror | None = None, word: Sequence[int] = ()
) -> tuple[Any, Any]:
    """The camera's axes, as columns, and its position, mirrored in the chords of mirrors."""
    turn = np.stack([camera.axis, camera.up, camera.across], axis=1).astype(float)
    shift = np.asarray(camera.position, float)
    for number in word:
        assert mirrors is not None
        turn, shift = mirrored(turn, shift, one_of(mirrors, number))
    return turn, shift


def one_of(parts: Any, index: int) -> Any:
    """One of several parts along a first axis, such as a mirror of all."""
    return jax.tree.map(lambda leaf: leaf[index], parts)


def mirrored(
    turn: np.ndarray, shift: np.ndarray, mirror: SpatialMirror
) -> tuple[np.ndarray, np.ndarray]:
    """Axes and their origin, mirrored in the plane of a mirror's chord."""
    normal, middle = np.asarray(mirror.normal), np.asarray(mirror.middle)
    off = (shift - middle) @ normal
    return turn - 2 * np.outer(normal, normal @ turn), shift - 2 * off * normal


def _sum(weights: np.ndarray, parts: Coordinates) -> Any:
    """A weighed sum; a part of no weight costs nothing."""
    terms = [float(weight) * part for weight, part in zip(weights, parts, strict=True) if weight]
    return sum(terms[1:], terms[0]) if terms else 0.0
