"""Which pixels are bright enough to be a pad: thresholds, and their clean-up."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import UInt8

Image = UInt8[np.ndarray, "rows columns 3"]
Gray = UInt8[np.ndarray, "rows columns"]
Mask = UInt8[np.ndarray, "rows columns"]
"""255 where it holds, else 0."""


def brightness(image: Image) -> Gray:
    """The brightest channel of every pixel.

    Not the usual grey, which weights blue with 0.11 and so loses the side that is lit blue.
    """
    red, green, blue = cv2.split(image)
    return cv2.max(cv2.max(red, green), blue)


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
