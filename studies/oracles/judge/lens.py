"""The camera: which ray belongs to a place of the image; projections as textbooks have them."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

HEIGHTS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "pinhole": np.tan,
    "equidistant": lambda angle: angle,
    "equisolid": lambda angle: 2 * np.sin(angle / 2),
    "stereographic": lambda angle: 2 * np.tan(angle / 2),
    "orthographic": np.sin,
}
"""Image height in focal lengths at an angle from the axis."""

ANGLES = np.linspace(0, math.pi, 200_001)
"""At which heights are tabulated; linear between them, their inverse is right to 1e-9 rad."""


class Lens(NamedTuple):
    """A camera whose image line is the image's middle column.

    Attributes:
        position: of the entrance pupil for rays along the axis, (x, y, z).
        axis: unit vector of the optical axis.
        up: unit vector across it, towards lesser rows.
        right: unit vector towards greater columns.
        pupil: how far before the position rays at an angle θ (rad) from the axis pass it: e₂ and e₄
            of e₂ θ² + e₄ θ⁴, mm.
        focal: focal length, px.
        rows: of the image, which the field of view fills.
        columns: of the image.
        offset: of the optical axis from the image's middle, columns and rows.
        heights: image heights at `ANGLES`, as far as they grow.
    """

    position: np.ndarray
    axis: np.ndarray
    up: np.ndarray
    right: np.ndarray
    pupil: tuple[float, float]
    focal: float
    rows: int
    columns: int
    offset: tuple[float, float]
    heights: np.ndarray

    @classmethod
    def of(cls, camera: Mapping[str, Any], motion: tuple[complex, complex], aspect: float) -> Lens:
        """That of ``[camera]``, carried by a motion p ↦ a p + b of its frame."""
        heights = _heights(camera.get("projection", "equidistant"))
        heights = heights[: 1 + int(np.argmin(np.append(np.diff(heights) > 0, False)))]
        rows, half = int(camera["pixels"]), math.radians(camera["fov_deg"] / 2)
        focal = rows / 2 / float(np.interp(half, ANGLES[: len(heights)], heights))
        focal *= camera.get("scale", 1.0)
        turn, shift = motion
        place = turn * complex(*camera["position"]) + shift
        toward = turn * cmath.exp(1j * math.radians(camera["direction_deg"]))
        axis, up = (np.array([one.real, one.imag, 0.0]) for one in (toward, 1j * toward))
        right = np.array([0.0, 0.0, 1.0])
        axis, right = _turned(axis, right, camera.get("yaw", 0.0))
        up, right = _turned(up, right, camera.get("roll", 0.0))
        position = np.array([place.real, place.imag, camera.get("lateral", 0.0)])
        first, second = camera.get("pupil_shift") or (0.0, 0.0)
        columns, offset = round(aspect * rows), camera.get("axis_offset_px") or (0.0, 0.0)
        place = position, axis, up, right
        return cls(*place, (first, second), focal, rows, columns, offset, heights)

    @property
    def middle(self) -> tuple[float, float]:
        """Column and row of the optical axis; whole numbers are the middles of pixels."""
        return (self.columns - 1) / 2 + self.offset[0], (self.rows - 1) / 2 + self.offset[1]

    def rays(self, places: np.ndarray) -> np.ndarray:
        """Unit vectors (x, y, z) of places (column, row), shape (places, 2).

        Rows grow clockwise in the section, columns along z. Places beyond the lens's largest image
        have NaN.
        """
        across, down = (places - self.middle).T
        radius, angle = np.hypot(across, down), self._angles(places)
        share = np.sin(angle) / np.where(radius > 0, radius, 1.0)
        return (
            np.cos(angle)[:, None] * self.axis
            + (share * across)[:, None] * self.right
            - (share * down)[:, None] * self.up
        )

    def pupils(self, places: np.ndarray) -> np.ndarray:
        """Where these rays pass the entrance pupil, from `position`, shape (places, 3)."""
        square = self._angles(places) ** 2
        shift = square * (self.pupil[0] + square * self.pupil[1])
        return shift[:, None] * self.axis

    def sight(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`rays` and `pupils`."""
        return self.rays(places), self.pupils(places)

    def _angles(self, places: np.ndarray) -> np.ndarray:
        """From the axis, rad."""
        radius, angles = np.hypot(*(places - self.middle).T), ANGLES[: len(self.heights)]
        return np.interp(radius / self.focal, self.heights, angles, right=np.nan)


def _turned(one: np.ndarray, other: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors at right angles, the first turned towards the second."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * one + sine * other, cosine * other - sine * one


def _heights(projection: str | Sequence[float]) -> np.ndarray:
    """By name, or θ + k₁ θ³ + k₂ θ⁵ + … with the coefficients of a calibrated lens."""
    if isinstance(projection, str):
        return HEIGHTS[projection](ANGLES)
    powers = (k * ANGLES ** (2 * i + 3) for i, k in enumerate(projection))
    return sum(powers, ANGLES)
