"""Pictures for a browser: what has changed since the last one, as a PNG."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Int, UInt8, UInt32
from numpy.lib.stride_tricks import sliding_window_view

Pixels = UInt32[np.ndarray, "rows columns"]
"""Four bytes of red, green, blue and opacity per pixel, all opaque."""

SIDE = 32
"""Of the squares in which changes are looked for, pixels; the least width and height of a picture.
"""


class Change(NamedTuple):
    """The squares of a picture in which anything has changed.

    Attributes:
        places: left and top of every square, pixels from the picture's left and top; squares at
            its right and its lower edge overlap their neighbours.
        across: squares in a row of the image.
        pixels: the squares as they are now, row by row in one image, the last row filled up.
    """

    places: Int[np.ndarray, "squares 2"]
    across: int
    pixels: UInt32[np.ndarray, "image_rows image_columns"]


def pixels_of(rgba: UInt8[np.ndarray, "rows columns 4"]) -> Pixels:
    """An image whose pixels can be compared as one number each."""
    return np.ascontiguousarray(rgba).view(np.uint32)[:, :, 0]


def change(pixels: Pixels, before: Pixels | None) -> Change | None:
    """What has changed in a picture; ``None`` where nothing has.

    Args:
        pixels: of the picture, opaque.
        before: of the one before, of the same size; without one, all has changed.
    """
    height, width = pixels.shape
    tops, lefts = np.arange(0, height, SIDE), np.arange(0, width, SIDE)
    differs = np.ones((height, len(lefts) * SIDE), bool)
    if before is not None:
        differs[:, width:] = False
        np.not_equal(pixels, before, out=differs[:, :width])
    eights = np.bitwise_or.reduceat(differs.view(np.uint64), tops, axis=0)  # pixels at a time
    squares = eights.reshape(len(tops), len(lefts), -1).any(axis=-1)
    row, column = np.nonzero(squares)
    count = len(row)
    if not count:
        return None
    top, left = np.minimum(tops[row], height - SIDE), np.minimum(lefts[column], width - SIDE)
    across = math.isqrt(count - 1) + 1
    down = -(-count // across)
    found = np.zeros((down * across, SIDE, SIDE), np.uint32)
    found[:count] = sliding_window_view(pixels, (SIDE, SIDE))[top, left]
    image = found.reshape(down, across, SIDE, SIDE).swapaxes(1, 2)
    return Change(np.stack([left, top], axis=-1), across, image.reshape(down * SIDE, across * SIDE))


def png(pixels: Pixels) -> bytes:
    """An opaque image as a PNG, packed for speed: it goes to a browser on the same machine."""
    rgba = np.ascontiguousarray(pixels).view(np.uint8).reshape(*pixels.shape, 4)
    # Without PNG's filters, which help photographs, this takes a third of Pillow's time.
    quick = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE]
    _, data = cv2.imencode(".png", cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGR), quick)
    return data.tobytes()
