"""How a board looks in windows of an image, and how that changes where the board moves."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from perception.boards.local_maps import LocalMaps, Places, shifting
from perception.boards.pattern import COARSEST, Pattern

FINE, BEYOND = 0.4, 3
"""Step of the samples of which pixels are made, and how far they reach beyond a window, px."""

PIXEL = 0.29
"""Standard deviation of a pixel's own square, px."""

BLURS, BENDS = (0.4, 2.5), (-0.9, 0.9)
"""Looks that are believed: a sharper lens lets lines pass between samples, and of bends beyond
these the tone curve does not rise everywhere."""

SKEW = 0.6
"""Tone curves of cameras are bent more in the dark: with this, those of the powers 1/1.8 to 1/2.4
are met to 1.5 % of the contrast."""

FLATTER = 0.9
"""What the power of a tone curve is below 1 by, over its bend: met to 0.01 by 1, 1/1.8, 1/2.2 and
1/2.4, for ink and paper that send 1 and 17 parts of light."""

Images = Float[np.ndarray, "maps pixels pixels"]


class Look(NamedTuple):
    """What lens and camera make of a print.

    Attributes:
        blur: standard deviation of the lens's blur, px.
        swell: the tone curve's bend times the width of edges, px. White seems to grow by about half
            of it, and by as much, counted in pixels of the image, in a smaller copy of the image.
    """

    blur: float
    swell: float

    @property
    def width(self) -> float:
        """Width of edges: standard deviation of the blur of lens and pixel, px."""
        return math.hypot(self.blur, PIXEL)

    @property
    def bend(self) -> float:
        """Of the tone curve: light halfway between black and white is brighter by a quarter of it.

        It is a share of the contrast.
        """
        return float(np.clip(self.swell / self.width, *BENDS))

    @property
    def power(self) -> float:
        """Of the light, that brightness grows with."""
        return 1 - FLATTER * self.bend


class Appearance(NamedTuple):
    """Windows as they are predicted, on a scale from 0, black, to 1, white.

    Attributes:
        shade: brightness.
        right: its derivative along columns, per px.
        down: its derivative along rows, per px.
        wider: its derivative by half the variance of the blur, per px².
        bent: its derivative by the bend.
    """

    shade: Images
    right: Images
    down: Images
    wider: Images
    bent: Images


def predict(
    pattern: Pattern, maps: LocalMaps, middles: Places, look: Look, half: int
) -> Appearance:
    """What windows show.

    Args:
        pattern: of the board.
        maps: one of each window.
        middles: of the windows, whole pixels.
        look: of lens and camera.
        half: from the middle of a window to its end, px.
    """
    samples = np.arange(-half - BEYOND, half + BEYOND + FINE / 2, FINE)
    printed = _printed(pattern, maps, middles, samples)
    plain, first, second = _blurs(samples, half, look.width)
    across = plain @ printed
    light = across @ plain.T
    bend, even, odd = np.float32(look.bend), light * (1 - light), 1 - 2 * light
    bent = even * (1 + SKEW * odd)
    gain = 1 + bend * (odd + SKEW * (odd * odd - 2 * even))
    return Appearance(
        light + bend * bent,
        gain * (across @ first.T),
        gain * (first @ printed @ plain.T),
        gain * (across @ second.T + second @ printed @ plain.T),
        bent,
    )


def _blurs(samples: np.ndarray, half: int, width: float) -> list[np.ndarray]:
    """What makes pixels of samples along a line: their brightness, first and second derivative."""
    away = np.arange(-half, half + 1)[:, None] - samples
    gauss = np.exp(-0.5 * (away / width) ** 2)
    gauss /= gauss.sum(axis=1, keepdims=True)
    slope, curvature = -away / width**2, (away**2 / width**2 - 1) / width**2
    return [one.astype(np.float32) for one in (gauss, slope * gauss, curvature * gauss)]


def _printed(pattern: Pattern, maps: LocalMaps, middles: Places, samples: np.ndarray) -> Images:
    """What is printed at the samples of each window: 1 where it is white."""
    # A sample is a pixel of the pattern that is as large, across the lines along either axis of
    # the board, as samples are apart: no line then lies between samples.
    steps = np.linalg.norm(maps.slopes(middles), axis=2) * pattern.density * FINE
    levels = np.clip(np.round(np.log2(steps + 1e-9)), 0, COARSEST).astype(int)
    scales = pattern.density / 2.0**levels
    forms = maps.warped(shifting(middles)).forms * scales[..., None, None]
    forms[:, :, 2, 2] += pattern.margin * scales - 0.5
    x, y = (part.ravel() for part in np.meshgrid(samples, samples))
    # The six different elements of a symmetric form, row by row.
    terms = np.stack([x * x, 2 * x * y, 2 * x, y * y, 2 * y, np.ones_like(x)]).astype(np.float32)
    pixels = forms[:, :, *np.triu_indices(3)].astype(np.float32) @ terms
    printed = np.empty((len(middles), len(x)), np.float32)
    for across, down in np.unique(levels, axis=0).tolist():
        chosen = (levels == (across, down)).all(axis=1)
        columns, rows = np.ascontiguousarray(pixels[chosen].swapaxes(0, 1))
        picture, border = pattern.level(across, down), cv2.BORDER_REPLICATE
        printed[chosen] = cv2.remap(picture, columns, rows, cv2.INTER_LINEAR, borderMode=border)
    return printed.reshape(-1, len(samples), len(samples))
