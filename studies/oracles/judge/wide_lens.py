"""A wide lens: a camera by itself, with any rising image height and a pupil that moves."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from studies.oracles.judge.lens import HEIGHTS

Projection = str | tuple[float, ...]
"""A name in `PROJECTIONS`, or k₁, k₂, … of θ + k₁ θ³ + k₂ θ⁵ + … (Kannala and Brandt, 2006)."""

PROJECTIONS = {**HEIGHTS, "arctangent": np.arctan}
"""Image height in focal lengths at an angle from the axis.

Four coefficients fit every textbook projection to 0.01 px rms in 600 px, 200° wide; the
arctangent, whose series ends at 57°, only to 0.2 px, and no polynomial is a blend with it.
"""

TABLED = 40_001
"""Angles at which heights are tabulated; linear between them, the inverse is right to 1e-9 rad."""

SIZES = ((640, 480), (800, 600), (1024, 768), (1280, 720), (1280, 960), (1440, 1080))

FLATTEST = 0.25
"""Of random lenses: the least slope of the image height, focal lengths per rad."""


class WideLens(NamedTuple):
    """A camera in its own frame: x to greater columns, y to greater rows, z along the axis, mm.

    Attributes:
        size: columns and rows.
        focal: px.
        middle: column and row of the optical axis; whole numbers are the middles of pixels.
        blend: shares and projections, whose sum is the image height in focal lengths.
        pupil: e₂ and e₄: a ray at θ (rad) from the axis passes the point e₂ θ² + e₄ θ⁴ mm before
            the origin on the axis.
        largest: angle from the axis up to which there is an image, rad.
    """

    size: tuple[int, int]
    focal: float
    middle: tuple[float, float]
    blend: tuple[tuple[float, Projection], ...]
    pupil: tuple[float, float]
    largest: float

    def heights(self, angles: np.ndarray) -> np.ndarray:
        """Image heights at angles from the axis, focal lengths."""
        found = np.zeros_like(angles)
        for share, projection in self.blend:
            found += share * _height(projection, angles)
        return found

    def shifts(self, angles: np.ndarray) -> np.ndarray:
        """How far before the origin rays pass the axis, mm."""
        return angles**2 * (self.pupil[0] + self.pupil[1] * angles**2)

    def sight(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rays of places (column, row), shape (places, 2).

        Returns:
            Unit vectors, shape (places, 3), NaN beyond the largest angle; and how far before the
            origin they pass the axis, mm, shape (places,).
        """
        across, down = (places - np.array(self.middle)).T
        radius = np.hypot(across, down)
        angles, heights = _table(self)
        angle = np.interp(radius / self.focal, heights, angles, right=np.nan)
        share = np.sin(angle) / np.where(radius > 0, radius, 1.0)
        ways = np.stack([share * across, share * down, np.cos(angle)], axis=-1)
        return ways, self.shifts(angle)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Where points (x, y, z), mm, are imaged: column and row, NaN outside of the image.

        The angle θ is the root of ρ cos θ − (z − e(θ)) sin θ, ρ from the axis, by bisection. It is
        the only one of points farther from the pupil than e′(θ) sin θ, a few mm.

        Args:
            points: shape (points, 3).

        Returns:
            Places, shape (points, 2).
        """
        across, down, ahead = points.T
        aside = np.hypot(across, down)

        def beyond(angle: np.ndarray) -> np.ndarray:
            return aside * np.cos(angle) - (ahead - self.shifts(angle)) * np.sin(angle)

        low, high = np.zeros(len(points)), np.full(len(points), self.largest)
        seen = beyond(high) <= 0
        for _ in range(60):
            middle = (low + high) / 2
            wider = beyond(middle) > 0
            low, high = np.where(wider, middle, low), np.where(wider, high, middle)
        scale = self.focal * self.heights(low) / np.where(aside > 0, aside, 1.0)
        places = np.stack([across, down], axis=-1) * scale[:, None] + np.array(self.middle)
        seen &= np.all((places >= -0.5) & (places <= np.array(self.size) - 0.5), axis=-1)
        return np.where(seen[:, None], places, np.nan)


def random_lens(generator: np.random.Generator) -> WideLens:
    """A lens 120° to 200° wide, across the image's diagonal or across a circle in the image.

    A third have a textbook projection, a third four random coefficients, and a third are blends
    with the arctangent.
    """
    size = SIZES[generator.integers(len(SIZES))]
    largest = math.radians(generator.uniform(120, 200) / 2)
    if generator.random() < 0.5:
        reach = math.hypot(*size) / 2
    else:
        reach = generator.uniform(0.9 * size[1], size[0]) / 2
    blend = _random_blend(generator, np.linspace(0, largest, 500))
    column, row = np.array(size) * (1 + generator.normal(0, 0.02, 2)) / 2 - 0.5
    pupil = generator.uniform(0, 1), generator.normal(0, 0.03)
    lens = WideLens(size, 1.0, (float(column), float(row)), blend, pupil, largest)
    return lens._replace(focal=float(reach / lens.heights(np.array([largest]))[0]))


def _random_blend(
    generator: np.random.Generator, angles: np.ndarray
) -> tuple[tuple[float, Projection], ...]:
    """One whose image height rises at all angles."""
    names = "equidistant", "equisolid", "stereographic", "orthographic"
    while True:
        name, share = str(generator.choice(names)), float(generator.uniform(0.2, 0.8))
        random = tuple((generator.normal(0, 1, 4) * (0.05, 0.01, 2e-3, 3e-4)).tolist())
        blend = (
            ((1.0, name),),
            ((1.0, random),),
            ((1 - share, name), (share, "arctangent")),
        )[generator.integers(3)]
        heights = sum(share * _height(projection, angles) for share, projection in blend)
        if np.min(np.diff(heights)) > FLATTEST * angles[1]:
            return blend


def _height(projection: Projection, angles: np.ndarray) -> np.ndarray:
    if isinstance(projection, str):
        return PROJECTIONS[projection](angles)
    square, found = angles**2, np.zeros_like(angles)
    for coefficient in reversed((1.0, *projection)):
        found = found * square + coefficient
    return found * angles


@functools.lru_cache(maxsize=8)
def _table(lens: WideLens) -> tuple[np.ndarray, np.ndarray]:
    """Angles and their image heights."""
    angles = np.linspace(0, lens.largest, TABLED)
    return angles, lens.heights(angles)
