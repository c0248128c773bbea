"""Whether an image has colors as a camera has them, or coarser ones, as compressed pictures have.

JPEG and most videos keep chroma in every other column and interpolate: then color bends less
between the columns that were kept than between the others. In images as cameras have them both
bend alike: by noise, and by edges, which are at all columns.
"""

from __future__ import annotations

import numpy as np

from perception.images import checked_image

EACH = 4
"""Every so many rows are compared: more would change nothing."""

DARKEST, BRIGHTEST = 1, 254
"""Codes that may be clipped."""

ALIKE = 0.85
"""Mean squares of how color bends at even and at odd columns, the smaller over the larger one: at
least so much where no columns are missing (0.91 to 1 in images with noise; at most 0.82 in 138
compressed ones of `physical-check-contacts`). Chroma that was not halved from column to column, as
in JPEG of 4:4:4, may be taken for fine."""

FEWEST = 100
"""Places without which no column is known to be missing."""


def has_fine_colors(image: object) -> bool:
    """Whether no compression has made the colors of an image coarser.

    Args:
        image: red, green and blue, 8 bits, as it was stored: not resized, and not turned. It has
            some noise: where all that changes is an upright edge, it may be taken for compressed.

    Returns:
        Whether it bends alike at even and at odd columns; true where nothing is known.

    Raises:
        UserError: it is no such image.

    Example:
        >>> import cv2
        >>> noise = np.random.default_rng(0).normal(100, 9, (64, 64, 3)).astype(np.uint8)
        >>> _, file = cv2.imencode(".jpg", noise)
        >>> has_fine_colors(noise), has_fine_colors(cv2.imdecode(file, cv2.IMREAD_COLOR))
        (True, False)
    """
    rows = checked_image(image, what="the image")[::EACH, :, :2].astype(np.int16)
    # Third differences.
    bends = np.diff(rows[..., 0] - rows[..., 1], n=3, axis=1).astype(np.float32)
    known = np.all((rows > DARKEST) & (rows < BRIGHTEST), axis=2)
    known = known[:, :-3] & known[:, 1:-2] & known[:, 2:-1] & known[:, 3:]
    if np.count_nonzero(known) < FEWEST:
        return True
    squares = np.where(known, bends**2, 0)
    means = [squares[:, i::2].sum() / max(known[:, i::2].sum(), 1) for i in range(2)]
    return bool(min(means) >= ALIKE * max(means))
