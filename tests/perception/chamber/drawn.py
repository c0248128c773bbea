"""Looks into a chamber, drawn as nested ellipses; pixels are means of finer ones."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import cv2
import numpy as np

from perception.chamber import Points, Region, find_points, find_regions

FINE = 4
"""Finer pixels across a pixel and down it."""

RED, BLUE, YELLOW, TOP = (
    np.array(albedo)
    for albedo in ((0.75, 0.12, 0.10), (0.10, 0.22, 0.75), (0.85, 0.70, 0.10), (0.18, 0.18, 0.18))
)


@dataclass(frozen=True)
class Ellipse:
    x: float
    y: float
    wide: float
    high: float

    @property
    def extremes(self) -> np.ndarray:
        """Leftmost, lowest and rightmost point."""
        x, y = self.x, self.y
        return np.array([(x - self.wide, y), (x, y + self.high), (x + self.wide, y)])

    def holds(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return ((x - self.x) / self.wide) ** 2 + ((y - self.y) / self.high) ** 2 <= 1


@dataclass(frozen=True)
class Scene:
    """A look into the chamber.

    ``opening`` is what a nearer wall leaves free of all but red, ``inner`` the light on yellow and
    the top over that on red and blue.
    """

    rows: int = 480
    columns: int = 640
    blue: Ellipse | None = Ellipse(319.5, 239.5, 180, 180)
    yellow: Ellipse | None = Ellipse(319.5, 239.5, 94, 94)
    top: Ellipse | None = Ellipse(319.5, 239.5, 42, 42)
    opening: Ellipse | None = None
    inner: float = 1.0

    def moved(self, x: float, y: float) -> Scene:
        """Bent: blue moves by (x, y), yellow and the top twice as far; each stays in the outer."""
        move = {}
        for part in ("blue", "yellow", "top"):
            ellipse = getattr(self, part)
            far = 1 if part == "blue" else 2
            if ellipse is not None:
                place = {"x": ellipse.x + far * x, "y": ellipse.y + far * y}
                move[part] = replace(ellipse, **place)
        return replace(self, **move)

    @functools.lru_cache(maxsize=64)  # noqa: B019 - scenes are values
    def reflectances(self) -> np.ndarray:
        """Of every pixel, red, green, blue, as (rows, columns, 3)."""
        y, x = ((np.arange(n * FINE) + 0.5) / FINE - 0.5 for n in (self.rows, self.columns))
        y = y[:, None]
        inside = np.ones((self.rows * FINE, self.columns * FINE), bool)
        if self.opening is not None:
            inside = self.opening.holds(x, y)
        fine = np.zeros(inside.shape, np.uint8)
        for number, ellipse in enumerate((self.blue, self.yellow, self.top), 1):
            if ellipse is None:
                break
            inside = inside & ellipse.holds(x, y)
            fine[inside] = number
        out = np.zeros((self.rows, self.columns, 3))
        for number, albedo in enumerate((RED, BLUE, self.inner * YELLOW, self.inner * TOP)):
            part = (fine == number).astype(np.float32)
            part = cv2.resize(part, (self.columns, self.rows), interpolation=cv2.INTER_AREA)
            out += part[..., None] * albedo
        return out

    def labels(self) -> np.ndarray:
        """The `Region` of every pixel's middle."""
        y, x = np.mgrid[: self.rows, : self.columns]
        drawn = np.full((self.rows, self.columns), Region.RED, np.uint8)
        ellipses = (self.blue, self.yellow, self.top)
        for ellipse, region in zip(ellipses, (Region.BLUE, Region.YELLOW, Region.TOP), strict=True):
            assert ellipse is not None
            drawn[ellipse.holds(x, y)] = region
        return drawn

    def light(self) -> np.ndarray:
        """Falls off with depth, towards the middle."""
        y, x = np.mgrid[: self.rows, : self.columns]
        far = np.hypot(x - (self.columns - 1) / 2, y - (self.rows - 1) / 2)
        return (0.5 + 0.4 * np.clip(far / (0.5 * self.columns), 0, 1))[..., None]

    def image(
        self, *, gain: float = 1.0, noise: float = 0.0, seed: int = 0, blur: float = 0.8
    ) -> np.ndarray:
        linear = cv2.GaussianBlur(self.reflectances() * self.light(), (0, 0), blur)
        seen = np.clip(255 * gain * linear, 0, 255)
        seen += np.random.default_rng(seed).normal(0, noise, seen.shape) if noise else 0
        return np.clip(np.rint(seen), 0, 255).astype(np.uint8)

    @property
    def points(self) -> np.ndarray:
        """The paper's seven points, where nothing is hidden or cut."""
        assert self.blue is not None
        assert self.yellow is not None
        center = [[self.blue.x, self.blue.y]]
        return np.concatenate([self.blue.extremes, self.yellow.extremes, center])


_BLUE, _YELLOW, _TOP = (Ellipse(159.5, 119.5, radius, radius) for radius in (90, 47, 21))
HALF = Scene(240, 320, _BLUE, _YELLOW, _TOP)
"""The straight chamber in half as many pixels."""


def points_of(image: np.ndarray) -> Points:
    """Points of whatever regions an image shows."""
    return find_points(image, find_regions(image))
