"""Whether an image has the colors of every pixel, or those of half of them, as compressed ones do.

JPEG and most videos keep chroma in every other column, or quantize it in blocks, and interpolate:
then the columns differ. What is between two columns that have been kept is smooth, so that between
these the difference of red and green changes less than between others.
"""

from __future__ import annotations

import numpy as np

from perception.images import checked_image

ROW = 4
"""Of so many rows one is looked at: they are enough, and all of them would take 15 ms."""

DARKEST, BRIGHTEST = 1, 254
"""Codes that may be clipped."""

ALIKE = 0.85
"""Mean squares of even and of odd columns: nearer to each other where no chroma is missing."""


def has_fine_colors(image: object) -> bool:
    """Whether an image has its own colors in every column.

    Of an image without any change of color, nothing is missing.

    Args:
        image: red, green and blue, 8 bits, as it was stored: not resized, and not turned.

    Raises:
        UserError: it is no such image.

    Example:
        >>> import cv2
        >>> noise = np.random.default_rng(0).normal(100, 9, (64, 64, 3)).astype(np.uint8)
        >>> _, file = cv2.imencode(".jpg", noise)
        >>> has_fine_colors(noise), has_fine_colors(cv2.imdecode(file, cv2.IMREAD_COLOR))
        (True, False)
    """
    rows = checked_image(image, what="the image")[::ROW, :, :2].astype(np.int16)
    steps = np.diff(rows[..., 0] - rows[..., 1], axis=1)
    bends = (2 * steps[:, 1:-1] - steps[:, :-2] - steps[:, 2:]).astype(np.float32)
    known = np.all((rows > DARKEST) & (rows < BRIGHTEST), axis=2)
    known = known[:, :-3] & known[:, 1:-2] & known[:, 2:-1] & known[:, 3:]
    squares = np.where(known, bends**2, 0)
    counts = (np.maximum(known[:, first::2].sum(), 1) for first in (0, 1))
    even, odd = (
        squares[:, first::2].sum() / count for first, count in zip((0, 1), counts, strict=True)
    )
    return bool(min(even, odd) >= ALIKE * max(even, odd))
