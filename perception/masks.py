"""Which pixels are bright enough to be a pad: thresholds, and their clean-up."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import UInt8

CLIPPED = 245
"""Codes from here on may be those of any brighter light."""

BROADEST = 60 / 1080
"""Lamps in view are less broad than this share of the image's height, and longer than broad."""

RIM, STEEP, STEEPER = 4, 12.0, 2.5
"""Within so many pixels from a lamp, which is more than the lens blurs, the mean channel falls by
more than that, and so many times as much as from there to twice as far: light of a lamp on a pad
falls gradually."""

DIMMER = 60
"""A lamp's mean channel is less than this below that of what is beside it."""

Image = UInt8[np.ndarray, "rows columns 3"]
Gray = UInt8[np.ndarray, "rows columns"]
Mask = UInt8[np.ndarray, "rows columns"]
"""255 where it holds, else 0."""


def brightness(channels: Sequence[Gray]) -> Gray:
    """The brightest of red, green and blue in every pixel.

    Not the usual grey, which weights blue with 0.11 and so loses the side that is lit blue.
    """
    red, green, blue = channels
    return cv2.max(cv2.max(red, green), blue)


def lamp_mask(image: Image | Gray, gray: Gray) -> Mask:
    """Lamps in view: clipped strips along or across the section, which end steeply to both sides.

    Args:
        image: red, green and blue, or one channel; beside a lamp the pad may be clipped in the
            lamp's own color, and then only the others show the step.
        gray: its brightness.
    """
    clipped = global_mask(gray, CLIPPED - 1)
    if not clipped.any():
        return clipped
    broadest = round(BROADEST * len(gray)) | 1
    along = _upright_strips(image, clipped, broadest)
    if image.ndim == 2:
        return along
    # An overexposed pad that is seen flatly is such a strip, too, but of more than one color, or
    # it becomes darker along itself gradually.
    colors = np.sum([global_mask(one, CLIPPED - 1) > 0 for one in cv2.split(image)], axis=0)
    sole = np.where(colors == 1, clipped, 0)
    across = _upright_strips(cv2.transpose(image), cv2.transpose(sole), broadest, tips=True)
    return cv2.bitwise_or(along, cv2.transpose(across))


def _upright_strips(
    image: Image | Gray, clipped: Mask, broadest: int, *, tips: bool = False
) -> Mask:
    """Those of the clipped strips that are higher than broad, and end steeply to left and right.

    Args:
        image: red, green and blue, or one channel.
        clipped: where it is.
        broadest: number of pixels.
        tips: whether they must end steeply above and below, too.
    """
    mask, broad = np.zeros_like(clipped), np.ones((1, broadest), np.uint8)
    if image.ndim == 3:
        # Beside a lamp its own color may be clipped on the pad, too.
        mean = cv2.transform(image, np.full((1, 3), 1 / 3))
        most = cv2.subtract(cv2.dilate(mean, broad), np.full_like(mean, DIMMER))
        clipped = cv2.bitwise_and(clipped, cv2.compare(mean, most, cv2.CMP_GE))
    strips = cv2.subtract(clipped, cv2.morphologyEx(clipped, cv2.MORPH_OPEN, broad))
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(strips)
    for one in range(1, count):
        left, top, width, height, area = boxes[one].tolist()
        if height < 4 * RIM or height**2 < 2 * area:
            continue
        window = slice(top, top + height), slice(left, left + width)
        here = labels[window] == one
        rows = np.arange(top, top + height)
        first = left + here.argmax(axis=1)
        last = left + width - 1 - here[:, ::-1].argmax(axis=1)
        # Across a strip that leans, so many pixels are more along a row.
        right = round(RIM * float(np.hypot(1, (first[-1] - first[0]) / (height - 1))))
        sides = [(rows, first, 0, -right), (rows, last, 0, right)]
        if tips:
            above, below = (left + np.flatnonzero(here[i]) for i in (0, -1))
            sides += [(rows[:1], above, -RIM, 0), (rows[-1:], below, RIM, 0)]
        if all(_ends_steeply(image, *side) for side in sides):
            mask[window][here] = 255
    return mask


def _ends_steeply(
    image: Image | Gray, rows: np.ndarray, columns: np.ndarray, down: int, right: int
) -> bool:
    """Whether light falls steeply from places, some pixels beside them, and then no more."""
    steps, limits = np.arange(3)[:, None], np.array(image.shape[:2]) - 1
    levels = image[
        np.clip(rows + down * steps, 0, limits[0]), np.clip(columns + right * steps, 0, limits[1])
    ].astype(float)
    if levels.ndim == 3:
        levels = levels.mean(axis=2)
    first, second = np.median(levels[:-1] - levels[1:], axis=1)
    return bool(first > STEEP and first > STEEPER * second)


def without_lamps(gray: Gray, lamps: Mask, margin: int) -> Gray:
    """An image whose lamps are as dark as the darkest of what is beside them.

    Args:
        gray: brightness.
        lamps: where they are.
        margin: pixels beside them that are taken, too.
    """
    if not lamps.any():
        return gray
    grown = cv2.dilate(lamps, np.ones((2 * margin + 1,) * 2, np.uint8))
    size = 2 * round(BROADEST * len(gray)) | 1
    box = cv2.getStructuringElement(cv2.MORPH_RECT, (size, size))
    return np.where(grown > 0, cv2.erode(gray, box), gray)


def global_mask(gray: Gray, threshold: float) -> Mask:
    """What is brighter than one threshold."""
    return cv2.threshold(gray, threshold, 255, cv2.THRESH_BINARY)[1]


def adaptive_mask(gray: Gray, block: int, share: float) -> Mask:
    """What is brighter than a share of the mean of a box around it.

    Args:
        gray: brightness.
        block: side of the box, px.
        share: of the mean; below 1, so that what is evenly bright stays.
    """
    mean = cv2.boxFilter(gray, -1, (block, block), borderType=cv2.BORDER_REPLICATE)
    return cv2.compare(gray, cv2.convertScaleAbs(mean, alpha=share), cv2.CMP_GT)


def seam_mask(gray: Gray, size: int, share: float) -> Mask:
    """Narrow dark seams across the section, as between a view and another one beside it.

    They are drawn longer at both ends, where the corners of the two views come near each other.

    Args:
        gray: brightness.
        size: seams are narrower than this, px; odd.
        share: a seam's brightness over that of what is on both its sides, at most.
    """

    def box(wide: int, high: int) -> np.ndarray:
        return cv2.getStructuringElement(cv2.MORPH_RECT, (wide, high))

    closed = cv2.morphologyEx(gray, cv2.MORPH_CLOSE, box(size, size))
    dark = cv2.compare(gray, cv2.convertScaleAbs(closed, alpha=share), cv2.CMP_LT)
    # Shorter ones are noise, or the shade of something that touches the pad.
    long = cv2.morphologyEx(dark, cv2.MORPH_OPEN, box(2 * size, 1))
    return cv2.dilate(long, box(3 * size, 1))


def combined_mask(gray: Gray, threshold: float, block: int, share: float) -> Mask:
    """Paper B's combination (§4.1.1): bright by one threshold and by that of its surroundings."""
    return cv2.bitwise_and(global_mask(gray, threshold), adaptive_mask(gray, block, share))


def cleaned(mask: Mask, size: int) -> Mask:
    """Opened and then closed with a square: specks go, and then small holes (paper B §4.1.1)."""
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (size, size))
    opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, square)
    return cv2.morphologyEx(opened, cv2.MORPH_CLOSE, square)
