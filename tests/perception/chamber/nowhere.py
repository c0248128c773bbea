"""Pictures without a chamber, many in its colours, and some that all but show one."""

from __future__ import annotations

import colorsys
from collections.abc import Callable

import cv2
import numpy as np

ROWS, COLUMNS = 240, 320
SHAPE = (ROWS, COLUMNS, 3)
MIDDLE = np.array([COLUMNS, ROWS]) / 2

WALLS = np.array([(191, 31, 26), (26, 56, 191), (217, 178, 26), (30, 30, 30)], float)
"""Colours of the red, the blue and the yellow wall, and of the top."""

Random = np.random.Generator


def _colors(random: Random, count: int = 6) -> np.ndarray:
    """Those of the chamber, or any bright ones."""
    if random.random() < 0.5:
        return WALLS
    any_of = zip(*random.uniform([0, 0.4, 0.15], 1, (count, 3)).T, strict=True)
    return 255 * np.array([colorsys.hsv_to_rgb(*one) for one in any_of])


def _picture(values: np.ndarray, random: Random, noise: float = 4.0, blur: float = 0.8):
    smooth = cv2.GaussianBlur(np.asarray(values, float), (0, 0), blur)
    return np.clip(np.rint(smooth + random.normal(0, noise, SHAPE)), 0, 255).astype(np.uint8)


def _flat(color: np.ndarray) -> np.ndarray:
    return np.full(SHAPE, color, np.uint8)


def _ellipse(image: np.ndarray, place: np.ndarray, half: np.ndarray, color: np.ndarray, turn=0.0):
    center, axes = (np.round(16 * np.asarray(part)).astype(int).tolist() for part in (place, half))
    fill = np.minimum(color, 255).tolist()
    cv2.ellipse(image, center, axes, turn, 0, 360, fill, -1, cv2.LINE_AA, 4)


def dead_leaves(random: Random) -> np.ndarray:
    """Discs over discs, their radii from a power law, as in natural pictures (Lee et al. 2001)."""
    image, colors = _flat(np.zeros(3)), _colors(random)
    smallest, largest, power = random.uniform([2, 40, 1.5], [8, 160, 3])
    share = random.random(random.integers(100, 800))
    low, high = smallest ** (1 - power), largest ** (1 - power)
    for radius in (low + share * (high - low)) ** (1 / (1 - power)):
        color = colors[random.integers(len(colors))] * random.uniform(0.5, 1.1)
        _ellipse(image, random.uniform([-30, -30], [350, 270]), np.full(2, radius), color)
    return _picture(image, random, random.uniform(0, 6), random.uniform(0.3, 1.5))


def corners(random: Random) -> np.ndarray:
    """Triangles and squares in each other, in the chamber's colours and order."""
    image, sides, size = _flat(WALLS[0]), random.integers(3, 5), random.uniform(50, 100)
    turn = random.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(sides) / sides
    place = random.uniform([100, 80], [220, 160])
    for share, color in zip((1, 0.55, 0.25), WALLS[1:], strict=True):
        polygon = place + share * size * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        cv2.fillPoly(image, [np.round(polygon).astype(np.int32)], color.tolist())
    return _picture(image, random)


def other_orders(random: Random) -> np.ndarray:
    """Rings in another order than red, blue, yellow and dark, which swapping channels leaves so."""
    order = random.permutation(4)
    while order[0] < 2 and order[1] < 2:
        order = random.permutation(4)
    image, size = _flat(WALLS[order[0]]), random.uniform(50, 100)
    place = random.uniform([120, 90], [200, 150])
    for share, color in zip((1, 0.55, 0.25), WALLS[order[1:]], strict=True):
        _ellipse(image, place, share * size * random.uniform(0.8, 1, 2), color)
    return _picture(image, random)


def side_by_side(random: Random) -> np.ndarray:
    """A blue and a yellow disc on red, apart or one half in front of the other."""
    image, turn, radii = _flat(WALLS[0]), random.uniform(0, 2 * np.pi), random.uniform(25, 55, 2)
    apart = radii.sum() * random.uniform(0.65, 1.3) / 2
    step = apart * np.array([np.cos(turn), np.sin(turn)])
    for place, radius, color in zip((-step, step), radii, WALLS[1:3], strict=True):
        _ellipse(image, MIDDLE + place, np.full(2, radius), color)
    return _picture(image, random)


def crescent(random: Random) -> np.ndarray:
    """A blue crescent on red, with yellow or without."""
    image, turn, size = _flat(WALLS[0]), random.uniform(0, 2 * np.pi), random.uniform(50, 100)
    _ellipse(image, MIDDLE, np.full(2, size), WALLS[1])
    off = random.uniform(0.5, 1) * size * np.array([np.cos(turn), np.sin(turn)])
    _ellipse(image, MIDDLE + off, np.full(2, size * random.uniform(0.6, 0.9)), WALLS[0])
    if random.random() < 0.5:
        _ellipse(image, MIDDLE, np.full(2, 0.3 * size), WALLS[2])
    return _picture(image, random)


KINDS: dict[str, Callable[[Random], np.ndarray]] = {
    make.__name__: make for make in (dead_leaves, corners, other_orders, side_by_side, crescent)
}
