"""The camera: which ray belongs to a place of the image; projections as textbooks have them."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

INVERSES: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "pinhole": np.arctan,  # r = f tan θ
    "equidistant": lambda r: 1.0 * r,  # r = f θ
    "equisolid": lambda r: 2 * np.arcsin(r / 2),  # r = 2 f sin(θ/2)
    "stereographic": lambda r: 2 * np.arctan(r / 2),  # r = 2 f tan(θ/2)
    "orthographic": np.arcsin,  # r = f sin θ
}
"""The angle from the axis at which a place r/f from the image's middle lies."""

HEIGHTS: Mapping[str, Callable[[float], float]] = {
    "pinhole": math.tan,
    "equidistant": lambda angle: angle,
    "equisolid": lambda angle: 2 * math.sin(angle / 2),
    "stereographic": lambda angle: 2 * math.tan(angle / 2),
    "orthographic": math.sin,
}

TABULATED = np.linspace(0, math.pi, 200_001)
"""Angles at which the polynomial of a calibrated lens is tabulated: linear between, to 1e-10."""


class Lens(NamedTuple):
    """A camera whose image line is the image's middle column.

    Attributes:
        position: in the section.
        axis: unit vector of the optical axis.
        focal: focal length, px.
        rows: of the image, which the field of view fills.
        columns: of the image.
        inverse: from r/f to the angle from the axis.
    """

    position: complex
    axis: complex
    focal: float
    rows: int
    columns: int
    inverse: Callable[[np.ndarray], np.ndarray]

    @classmethod
    def of(cls, camera: Mapping[str, Any], motion: tuple[complex, complex], aspect: float) -> Lens:
        """That of ``[camera]``, carried by a motion p ↦ a p + b of its frame."""
        projection, half = camera.get("projection", "equidistant"), camera["fov_deg"] / 2
        half, rows = math.radians(half), int(camera["pixels"])
        if isinstance(projection, str):
            height, inverse = HEIGHTS[projection](half), INVERSES[projection]
        else:
            height, inverse = _polynomial(projection, half), _inverse(projection)
        turn, shift = motion
        position = turn * complex(*camera["position"]) + shift
        axis = turn * cmath.exp(1j * math.radians(camera["direction_deg"]))
        return cls(position, axis, rows / 2 / height, rows, round(aspect * rows), inverse)

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
        radius = np.hypot(across, down)
        with np.errstate(invalid="ignore"):
            angle = self.inverse(radius / self.focal)
            angle = np.where(angle <= math.pi, angle, np.nan)
        safe = np.where(radius > 0, radius, 1.0)
        up, side = -np.sin(angle) * down / safe, np.sin(angle) * across / safe
        plane = self.axis * (np.cos(angle) + 1j * up)
        return np.stack([plane.real, plane.imag, side], axis=-1)


def _polynomial(coefficients: Sequence[float], angle: Any) -> Any:
    """Sum of θ, k₁ θ³, k₂ θ⁵ and so on: r/f."""
    powers = [angle ** (2 * i + 3) * k for i, k in enumerate(coefficients)]
    return angle + sum(powers)


def _inverse(coefficients: Sequence[float]) -> Callable[[np.ndarray], np.ndarray]:
    heights = _polynomial(coefficients, TABULATED)
    grows = np.append(np.diff(heights) > 0, False)
    last = int(np.argmin(grows))  # beyond it the image turns back
    return lambda radius: np.interp(
        radius, heights[: last + 1], TABULATED[: last + 1], right=np.nan
    )
