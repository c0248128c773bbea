"""Notices a camera that changes its exposure or its white balance, against a reference image.

What touches the pads changes few places, and views that move change many in as many ways; a camera
changes all in the same way. So the ratio of each color to its reference is taken place by place,
and of those ratios the half that agree best count (the shorth of Andrews et al. 1972, *Robust
Estimates of Location*): what stands still before the camera, or moves along itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from perception.images import checked_image

COLUMNS, ROWS = 80, 3
"""Places in a row, at the least: each is the mean of so many rows of a square of pixels."""

DARK, BRIGHT = 30, 240
"""Codes between which a place of the reference counts; in an image it may be half as dark."""

LEAST = 12
"""Places of a color without which nothing is concluded from it."""

AGREEMENT = 0.08
"""Logarithms of the ratios of the half that counts differ by no more, or it is no half that agrees.
"""

MOVED, RETURNED = np.log(1.05), np.log(1.025)
"""From where on light has moved, and within which it has returned: logarithms of ratios."""

LOOKS = 5
"""Images in succession that must agree on it."""


@final
@dataclass(frozen=True)
class Light:
    """Light of an image over that of the reference, in codes of 8 bits.

    Attributes:
        gains: ratio of red, green and blue; NaN where an image shows none.
        verdict: a line if the light has just moved, or has just returned; else empty.
    """

    gains: Float[np.ndarray, "3"]
    verdict: str = ""

    @property
    def gain(self) -> float:
        """Ratio of brightness: the geometric mean of the colors' that are known."""
        known = self.gains[np.isfinite(self.gains)]
        return float(np.exp(np.log(known).mean())) if known.size else float("nan")

    @property
    def red(self) -> float:
        """Ratio of red over green to that of the reference."""
        return float(self.gains[0] / self.gains[1])

    @property
    def blue(self) -> float:
        """Ratio of blue over green to that of the reference."""
        return float(self.gains[2] / self.gains[1])


@final
class LightWatch:
    """Compares the light of successive images with a reference.

    Where less than half of what is bright stands still, most images leave it open; and a finger
    whose views all move can be taken for light that has moved.

    Args:
        reference: an image of red, green and blue, in the light that is to be kept.

    Raises:
        UserError: it is no such image.

    Example:
        >>> import numpy as np
        >>> image = np.full((120, 160, 3), 100, np.uint8)
        >>> watch = LightWatch(image)
        >>> for _ in range(LOOKS):
        ...     light = watch.look(image + np.uint8(20))
        >>> round(light.gain, 2), light.verdict[:63]
        (1.2, "the light is not the reference's: brightness ×1.20, red over gr")
    """

    def __init__(self, reference: object) -> None:
        image = checked_image(reference, what="the reference of the light")
        self._shape = image.shape[:2]
        self._reference = _shrunk(image)
        self._has_moved, self._looks = False, 0

    def look(self, image: object) -> Light:
        """The light of the next image, with a verdict when `LOOKS` in succession agree on it.

        Raises:
            UserError: it is no image of the reference's size.
        """
        like = "the reference of the light", self._shape
        now = _shrunk(checked_image(image, like=like))
        light = Light(np.array([_gain(*pair) for pair in zip(self._reference, now, strict=True)]))
        known = np.abs(np.log(light.gains[np.isfinite(light.gains)]))
        if not known.size:
            return light
        is_other = not (known < RETURNED).all() if self._has_moved else (known > MOVED).any()
        self._looks = self._looks + 1 if is_other != self._has_moved else 0
        if self._looks < LOOKS:
            return light
        self._has_moved, self._looks = not self._has_moved, 0
        return Light(light.gains, _verdict(light) if self._has_moved else BACK)


BACK = "the light is the reference's again"


def _verdict(light: Light) -> str:
    return (
        f"the light is not the reference's: brightness ×{light.gain:.2f}, red over green "
        f"×{light.red:.2f}, blue ×{light.blue:.2f}; switch off the camera's automatic exposure and "
        "white balance"
    )


def _shrunk(image: UInt8[np.ndarray, "rows columns 3"]) -> Float[np.ndarray, "3 places"]:
    rows, columns = image.shape[:2]
    step = max(columns // COLUMNS, 1)
    size = (columns // step, max(rows // step, 1))
    # Averaging all rows would take most of the time.
    small = cv2.resize(image[:: max(step // ROWS, 1)], size, interpolation=cv2.INTER_AREA)
    return small.reshape(-1, 3).T.astype(np.float32)


def _gain(reference: Float[np.ndarray, " places"], now: Float[np.ndarray, " places"]) -> float:
    """Ratio of one color that the half of the places agree on; NaN if they do not."""
    counts = (reference > DARK) & (now > DARK / 2) & (np.maximum(reference, now) < BRIGHT)
    half = int(counts.sum()) // 2
    if half < LEAST // 2:
        return float("nan")
    ratios = np.sort(np.log(now[counts] / reference[counts]))
    widths = ratios[half:] - ratios[: len(ratios) - half]
    first = int(widths.argmin())
    if widths[first] > AGREEMENT:
        return float("nan")
    return float(np.exp(np.median(ratios[first : first + half + 1])))
