"""Pads before a camera, drawn by tracing rays in three dimensions, with lenses written out by hand.

Points and directions are (forward, up, across) in the camera's own axes; what is before the camera
is a rectangle across the section, given by its two ends within it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from perception.lens import Lens
from perception.matching import View
from perception.quads import Quad
from perception.quality import Quality

FINE = 4
"""Rays across a pixel and down it."""

ALL = slice(None), slice(None)

DARK, BRIGHT = 12.0, 150.0
"""Brightness beside pads, and of pads."""


@dataclass(frozen=True)
class Eye:
    """A camera whose axis meets the image's middle: r = f θ, or f tan θ for a pinhole."""

    rows: int = 360
    columns: int = 480
    focal: float = 130.0
    pinhole: bool = False

    @property
    def middle(self) -> np.ndarray:
        return np.array([self.columns - 1, self.rows - 1]) / 2

    def directions(self, places: np.ndarray) -> np.ndarray:
        """Unit vectors through places of the image."""
        right, down = np.moveaxis(places - self.middle, -1, 0)
        radius = np.hypot(right, down)
        angle = np.arctan(radius / self.focal) if self.pinhole else radius / self.focal
        part = np.sinc(angle / np.pi) * angle / np.where(radius > 0, radius, 1)
        return np.stack([np.cos(angle), -part * down, part * right], axis=-1)

    def places(self, points: np.ndarray) -> np.ndarray:
        """Where points are imaged."""
        forward, up, right = np.moveaxis(points, -1, 0)
        off = np.hypot(up, right)
        angle = np.arctan2(off, forward)
        part = self.focal * (np.tan(angle) if self.pinhole else angle)
        part = part / np.where(off > 0, off, 1)
        return self.middle + np.stack([part * right, -part * up], axis=-1)

    def grid(self, fine: int = 1, window: tuple[slice, slice] = ALL) -> np.ndarray:
        """Places of pixels' middles, or of as many rays in each, all or those in a window."""
        rows, columns = (
            (np.arange(count * fine)[part] + 0.5) / fine - 0.5
            for count, part in zip((self.rows, self.columns), window, strict=True)
        )
        return np.stack(np.meshgrid(columns, rows), axis=-1)

    def lens(self) -> Lens:
        """What perception is given of it."""
        rays = rays_of(self.directions(self.grid()))

        def project(rays: np.ndarray) -> np.ndarray:
            angle, slope = rays.T
            return self.places(np.stack([np.cos(angle), np.sin(angle), slope], axis=-1))

        return Lens(rays.astype(np.float32), project)


def rays_of(directions: np.ndarray) -> np.ndarray:
    """Section angle and lateral slope of directions."""
    forward, up, right = np.moveaxis(directions, -1, 0)
    return np.stack([np.arctan2(up, forward), right / np.hypot(forward, up)], axis=-1)


@dataclass(frozen=True)
class Pad:
    """A rectangle: its ends (forward, up), its width, and how far its middle is beside the camera.

    Its corners may be round.
    """

    first: tuple[float, float]
    second: tuple[float, float]
    width: float = 24.0
    beside: float = 0.0
    radius: float = 0.0

    @property
    def length(self) -> float:
        return float(np.hypot(*np.subtract(self.second, self.first)))

    @property
    def step(self) -> np.ndarray:
        """Unit vector from the first end to the second one."""
        return np.subtract(self.second, self.first) / self.length

    def points(self, places: np.ndarray) -> np.ndarray:
        """Points of the pad, from mm along and across it."""
        section = np.asarray(self.first) + places[..., :1] * self.step
        return np.concatenate([section, places[..., 1:] + self.beside], axis=-1)

    def met(self, directions: np.ndarray) -> np.ndarray:
        """Where rays meet the pad's plane: mm along and across it; NaN where they do not."""
        normal = np.array([-self.step[1], self.step[0]])
        towards = directions[..., :2] @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (normal @ np.asarray(self.first)) / towards
        points = np.where(distance > 0, distance, np.nan)[..., None] * directions
        along = (points[..., :2] - np.asarray(self.first)) @ self.step
        return np.stack([along, points[..., 2] - self.beside], axis=-1)

    def holds(self, places: np.ndarray) -> np.ndarray:
        """Whether places in the pad's plane are on the pad."""
        half = np.array([self.length, self.width]) / 2 - self.radius
        from_middle = np.abs(places - [self.length / 2, 0]) - half
        beyond = np.hypot(*np.moveaxis(np.maximum(from_middle, 0), -1, 0))
        inside = np.where(beyond > 0, beyond, from_middle.max(axis=-1))
        return inside <= self.radius

    def lattice(self, count: int) -> np.ndarray:
        """Places on the pad, mm along and across it: so many each way, shape (count, count, 2)."""
        along = np.linspace(0, self.length, count)
        across = self.width * np.linspace(-0.5, 0.5, count)
        return np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1)

    def corners(self) -> np.ndarray:
        """Corners of the sharp rectangle in the pad's own order."""
        return self.points(self.lattice(2)[[0, 1, 1, 0], [0, 0, 1, 1]])


Look = Callable[[np.ndarray], np.ndarray]
"""Brightness at places (mm along and across a pad)."""


def drawn(
    eye: Eye, pads: Sequence[Pad], looks: Sequence[Look] | None = None, dark: float = DARK
) -> np.ndarray:
    """Brightness of every pixel, the mean of fine rays; the first pad that a ray meets counts."""
    light = np.full((eye.rows * FINE, eye.columns * FINE), dark)
    free = np.ones(light.shape, bool)
    for number, pad in enumerate(pads):
        window = _window(eye, pad)
        places = pad.met(eye.directions(eye.grid(FINE, window)))
        there = free[window] & pad.holds(places)
        light[window][there] = BRIGHT if looks is None else looks[number](places[there])
        free[window] &= ~there
    return light.reshape(eye.rows, FINE, eye.columns, FINE).mean(axis=(1, 3))


def _window(eye: Eye, pad: Pad) -> tuple[slice, slice]:
    """Fine rays among which are all that meet a pad."""
    around = eye.places(pad.points(pad.lattice(17).reshape(-1, 2)))
    low, high = FINE * (around.min(axis=0) - 4), FINE * (around.max(axis=0) + 4)
    (left, top), (right, bottom) = np.maximum(low, 0).astype(int), np.maximum(high, 0).astype(int)
    return slice(top, bottom), slice(left, right)


def stored(light: np.ndarray, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """As 8-bit brightness, with normal noise."""
    noisy = light + noise * np.random.default_rng(seed).standard_normal(light.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def defocused(light: np.ndarray, radius: float) -> np.ndarray:
    """Light spread over a disc, its rim to a fraction of a pixel."""
    reach = np.arange(-np.ceil(radius), np.ceil(radius) + 1)
    disc = np.clip(radius + 0.5 - np.hypot(reach[:, None], reach), 0, 1)
    return cv2.filter2D(light, -1, disc / disc.sum(), borderType=cv2.BORDER_REPLICATE)


def colored(gray: np.ndarray) -> np.ndarray:
    """Three equal channels."""
    return np.repeat(gray[..., None], 3, axis=-1)


def quad_at(eye: Eye, corners: np.ndarray, *, deviation: float = 0.0) -> Quad:
    """A complete one with these corners, the lower end first."""
    covariance = np.tile(deviation**2 * np.eye(2), (4, 1, 1))
    numbers = covariance, np.zeros_like(covariance), 1.0, 100.0, 0.1, Quality.COMPLETE
    return Quad(rays_of(eye.directions(corners)), corners, *numbers)


def exact_quad(eye: Eye, pad: Pad, *, deviation: float = 0.0) -> Quad:
    """What a perfect image shows of a pad whose first end is the lower one."""
    return quad_at(eye, eye.places(pad.corners()), deviation=deviation)


def exact_view(
    eye: Eye, pad: Pad, *, name: str = "pad", path: str = "direct", area: float = 1.0
) -> View:
    """A view with the true corners of a pad."""
    quad = exact_quad(eye, pad)
    granted = quad.quality, (True, True)
    covariances = quad.covariance, quad.roughness
    return View(name, path, 0, *granted, quad.corners, quad.rays, *covariances, area)
