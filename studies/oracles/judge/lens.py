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
        position: in the section.
        axis: unit vector of the optical axis.
        focal: focal length, px.
        rows: of the image, which the field of view fills.
        columns: of the image.
        heights: image heights at `ANGLES`, as far as they grow.
    """

    position: complex
    axis: complex
    focal: float
    rows: int
    columns: int
    heights: np.ndarray

    @classmethod
    def of(cls, camera: Mapping[str, Any], motion: tuple[complex, complex], aspect: float) -> Lens:
        """That of ``[camera]``, carried by a motion p ↦ a p + b of its frame."""
        heights = _heights(camera.get("projection", "equidistant"))
        heights = heights[: 1 + int(np.argmin(np.append(np.diff(heights) > 0, False)))]
        rows, half = int(camera["pixels"]), math.radians(camera["fov_deg"] / 2)
        focal = rows / 2 / float(np.interp(half, ANGLES[: len(heights)], heights))
        turn, shift = motion
        position = turn * complex(*camera["position"]) + shift
        axis = turn * cmath.exp(1j * math.radians(camera["direction_deg"]))
        return cls(position, axis, focal, rows, round(aspect * rows), heights)

    @property
    def middle(self) -> tuple[float, float]:
        """Column and row of the optical axis; whole numbers are the middles of pixels."""
        return (self.columns - 1) / 2, (self.rows - 1) / 2

    def rays(self, places: np.ndarray) -> np.ndarray:
        """Unit vectors (x, y, z) of places (column, row), shape (places, 2).

        Rows grow clockwise in the section, columns along z. Places beyond the lens's largest image
        have NaN.
        """
        across, down = (places - self.middle).T
        radius, angles = np.hypot(across, down), ANGLES[: len(self.heights)]
        angle = np.interp(radius / self.focal, self.heights, angles, right=np.nan)
        safe = np.where(radius > 0, radius, 1.0)
        up, side = -np.sin(angle) * down / safe, np.sin(angle) * across / safe
        plane = self.axis * (np.cos(angle) + 1j * up)
        return np.stack([plane.real, plane.imag, side], axis=-1)


def _heights(projection: str | Sequence[float]) -> np.ndarray:
    """By name, or θ + k₁ θ³ + k₂ θ⁵ + … with the coefficients of a calibrated lens."""
    if isinstance(projection, str):
        return HEIGHTS[projection](ANGLES)
    powers = (k * ANGLES ** (2 * i + 3) for i, k in enumerate(projection))
    return sum(powers, ANGLES)
