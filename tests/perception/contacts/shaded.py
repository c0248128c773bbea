"""Pictures of a pad with spheres pressed in, by closed forms that are not those that are fitted.

The membrane is Hertz's on an infinite half-space, in closed form (K. Johnson, Contact Mechanics,
1985, (3.42a)). Light of a far lamp follows Lambert's law; even light comes from the hemisphere.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from perception.contacts import Lamp
from perception.matching import View
from perception.places import Sight
from perception.quality import Quality
from perception.unwarping import PER_MM

LENGTH, WIDTH = 24.0, 24.0
ELEVATION = np.deg2rad(30)
"""Of the lamps."""

FAR = 2000.0
"""mm: lamps so far away light from one direction."""


class Bump(NamedTuple):
    along: float
    across: float
    diameter: float
    depth: float


def hertz(away, edge, depth):
    """Height of a membrane over a sphere, mm."""
    s = np.maximum(away / edge, 1)
    flank = ((2 - s**2) * np.arcsin(1 / s) + np.sqrt(s**2 - 1)) / np.pi
    return depth * np.where(away < edge, 1 - (away / edge) ** 2 / 2, flank)


def lamps():
    """Red from greater columns, green from the pad's first end, blue from lesser columns."""
    height, half = FAR * np.tan(ELEVATION), 20 * FAR
    low, high = height - 1, height + 1
    return [
        Lamp((-half, FAR), (half, FAR), low, high),
        Lamp((-FAR, -half), (-FAR, half), low, high),
        Lamp((-half, -FAR), (half, -FAR), low, high),
    ]


TOWARD = np.array([[0.0, 1], [-1, 0], [0, -1]])


def light_of(bumps, lit, slope=(0.0, 0.0)):
    """Light of every sample and color, 1 where the pad is flat, as a view of a slope has it."""
    shape = round(LENGTH * PER_MM), round(WIDTH * PER_MM)
    u, v = np.meshgrid(*((np.arange(n) + 0.5) / PER_MM for n in shape), indexing="ij")
    v = v - WIDTH / 2

    def lifted(x, y):
        height, by_x, by_y = np.zeros((3, *x.shape))
        for one in bumps:
            away = np.hypot(x - one.along, y - one.across) + 1e-9
            given = one.diameter / 2, one.depth
            height = height + hertz(away, *given)
            rise = (hertz(away + 1e-4, *given) - hertz(np.abs(away - 1e-4), *given)) / 2e-4
            by_x = by_x + rise * (x - one.along) / away
            by_y = by_y + rise * (y - one.across) / away
        return height, by_x, by_y

    z = np.zeros(shape)
    for _ in range(40):  # slopes of rays and bumps are small: it contracts
        z = lifted(u + slope[0] * z, v + slope[1] * z)[0]
    _, by_u, by_v = lifted(u + slope[0] * z, v + slope[1] * z)
    up = 1 / np.sqrt(1 + by_u**2 + by_v**2)
    if not lit:
        return np.repeat(((1 + up) / 2)[..., None], 3, axis=-1)
    lean = np.stack([-by_u * up, -by_v * up], axis=-1) @ TOWARD.T
    shining = lean * np.cos(ELEVATION) + up[..., None] * np.sin(ELEVATION)
    return np.maximum(shining, 0) / np.sin(ELEVATION)


def picture_of(light, generator, *, gamma=1.0, noise=0.01, level=0.35, jpeg=None):
    """What a camera makes of it, a sample a pixel."""
    noisy = level * light + noise * generator.standard_normal(light.shape)
    pixels = np.rint(255 * np.clip(noisy, 0, 1) ** (1 / gamma)).astype(np.uint8)
    if jpeg is None:
        return pixels
    _, file = cv2.imencode(".jpg", pixels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, jpeg])
    stored = cv2.imdecode(file, cv2.IMREAD_COLOR)
    assert stored is not None  # it has just been encoded
    return np.ascontiguousarray(stored[..., ::-1])


def response(gamma):
    return None if gamma == 1 else 255 * (np.arange(256) / 255) ** gamma


def sight(slope=(0.0, 0.0)):
    """A camera far away, a pixel for every sample where it looks straight down."""
    pixels = np.sqrt(1 + np.square(slope)) / PER_MM
    return Sight(*(np.broadcast_to(np.array(one), (13, 13, 2)) for one in (slope, pixels)))


def view(pad="tip", path="direct"):
    """A view whose corners are exact."""
    places, none = np.zeros((4, 2)), np.zeros((4, 2, 2))
    return View(pad, path, 0, Quality.COMPLETE, (True, True), places, places, none, none, 1.0)
