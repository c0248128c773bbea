"""Pictures without a chamber, many in its colours, and some that all but show one."""

from __future__ import annotations

import colorsys
from collections.abc import Callable
from pathlib import Path

import cv2
import matplotlib as mpl
import matplotlib.pyplot as plt
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
    noisy = smooth + random.normal(0, noise, SHAPE) if noise else smooth
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


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


def leaves_on_red(random: Random) -> np.ndarray:
    image, colors = _flat(WALLS[0]), _colors(random)
    for _ in range(random.integers(5, 14)):
        place, half = random.uniform(0, [COLUMNS, ROWS]), random.uniform(8, 90, 2)
        color = colors[random.integers(len(colors))]
        _ellipse(image, place, half, color, random.uniform(0, 180))
    return _picture(image, random, 0)


def clouds(random: Random) -> np.ndarray:
    """Noise whose power falls with the frequency, in every channel."""
    rows, columns = np.fft.fftfreq(ROWS)[:, None], np.fft.rfftfreq(COLUMNS)
    frequency = np.hypot(rows, columns)
    frequency[0, 0] = np.inf
    shape = (3, *frequency.shape)
    waves = random.normal(size=shape) + 1j * random.normal(size=shape)
    noise = np.fft.irfft2(waves / frequency ** random.uniform(0.7, 1.8), (ROWS, COLUMNS))
    noise = np.moveaxis(noise / noise.std(axis=(1, 2), keepdims=True), 0, -1)
    level = random.uniform(60, 160) + random.uniform(-60, 60, 3)
    return _picture(level + random.uniform(30, 110) * noise, random, 0)


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


def photograph(random: Random) -> np.ndarray:
    """Part of the portrait that Matplotlib brings along, turned, and often in other colours."""
    file = Path(mpl.get_data_path()) / "sample_data" / "grace_hopper.jpg"
    whole = plt.imread(file)
    wide = random.uniform(120, min(whole.shape[:2]))
    place = random.uniform(wide / 2, np.array(whole.shape[1::-1]) - wide / 2)
    turn = cv2.getRotationMatrix2D(place.tolist(), random.uniform(0, 360), COLUMNS / wide)
    turn[:, 2] += [COLUMNS / 2, ROWS / 2] - place
    part = cv2.warpAffine(whole, turn, (COLUMNS, ROWS), borderMode=cv2.BORDER_REFLECT)
    if random.random() < 0.3:
        return part
    hue, full, value = cv2.split(cv2.cvtColor(part, cv2.COLOR_RGB2HSV).astype(int))
    other = [(hue + random.integers(180)) % 180, full * random.uniform(0.8, 3), value]
    other = np.clip(np.stack(other, axis=-1), 0, 255).astype(np.uint8)
    return cv2.cvtColor(other, cv2.COLOR_HSV2RGB)


KINDS: dict[str, Callable[[Random], np.ndarray]] = {
    make.__name__: make
    for make in (
        *(dead_leaves, leaves_on_red, clouds, corners),
        *(other_orders, side_by_side, crescent, photograph),
    )
}
