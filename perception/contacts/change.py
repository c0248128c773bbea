"""By which part the light of a pad has changed, on cells, and how noisy that is."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Bool, Float

from perception.images import checked_image
from perception.places import Sight
from perception.unwarping import PER_MM

CELL = 0.2
"""Side of a cell, mm."""

DARK = 4.0
"""Codes, of 255, that are added to what is divided by: the dark has no contrast."""

FAINTEST = 0.5
"""Codes: as dark is what has the code zero."""

LEAST_GAIN = 0.1
"""Exposures of two pictures differ by less, or the darker one shows nothing."""

SMOOTH = 0.5
"""mm: the light of the untouched pad is smoothed by so much (standard deviation)."""

RIM, RIM_PIXELS = 0.3, 1.5
"""So many mm and pixels from the pad's edges what is beside it shows."""

DARK_SIDE = 0.5
"""By this part, or more, half of a side is darker where what is seen there is not the pad."""

PIXEL = 12**-0.5
"""Deviation of a place that may be anywhere within a pixel: two pictures lie on each other so well,
and where their light changes quickly, so does their difference."""

FLATTEST = 1.6
"""Length of a pixel on the pad over its width, 51° from above: in views that are flatter, flanks of
bulges hide what is behind them, and light by way of layers depends on the joints' angles."""

APART = 1.5
"""Pixels: noise at places so far from each other has little in common."""

NORMAL = 1.4826
"""Standard deviation of normal numbers over the median of their absolute values."""

Cells = Float[np.ndarray, "rows columns colors"]
Places = Float[np.ndarray, "*places"]


@dataclass(frozen=True, eq=False)
class Change:
    """What has changed on a pad since it was not touched, by cells of `CELL`.

    Of all colors, or of their sum alone: that is what even light shows, and a compressed picture
    has the hue of blocks of 16 pixels in whole codes only.

    Attributes:
        part: of the light and of `DARK`, by which it has become brighter, beyond what all cells
            have in common: the exposure of the two pictures need not be the same.
        noisiness: deviation of ``part``, up to a factor that all cells share.
        unsure: deviation of ``part`` by where the pictures lie on each other.
        light: logarithm of that of the untouched pad.
        visible: part that light has of itself and `DARK`.
        slopes: of rays, as those of `Sight`.
        pixels: likewise.
        inner: which cells are away from the pad's edges and not seen too flat.
    """

    part: Cells
    noisiness: Cells
    unsure: Cells
    light: Cells
    visible: Cells
    slopes: Float[np.ndarray, "rows columns 2"]
    pixels: Float[np.ndarray, "rows columns 2"]
    inner: Bool[np.ndarray, "rows columns"]
    _noise: dict[int, float] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(
        cls,
        picture: np.ndarray,
        reference: np.ndarray,
        sight: Sight,
        response: Float[np.ndarray, "256"] | None,
        *,
        colored: bool,
    ) -> Change:
        """From the unwarped pictures of a pad, pressed and untouched.

        Args:
            picture: pressed.
            reference: untouched.
            sight: how they show the pad.
            response: of the camera.
            colored: of all colors, red first.

        Raises:
            UserError: one is no image of three channels of 8 bits, or they differ in size.
        """
        untouched = checked_image(reference, what="the reference of a pad")
        like = "its reference", untouched.shape[:2]
        pressed = checked_image(picture, like=like, what="an unwarped pad")
        if not colored:
            untouched, pressed = (
                cv2.cvtColor(one, cv2.COLOR_RGB2GRAY) for one in (untouched, pressed)
            )
        codes = np.arange(256.0)
        curve = codes if response is None else response
        dark, faintest = np.interp([DARK, FAINTEST], codes, curve)
        table = (curve + dark).astype(np.float32)
        step = round(CELL * PER_MM)
        rows, columns = (size // step for size in untouched.shape[:2])
        cut = np.s_[: rows * step, : columns * step]
        size = columns, rows
        now, before, mean = (
            cv2.resize(one[cut], size, interpolation=cv2.INTER_AREA).reshape(rows, columns, -1)
            for one in (cv2.LUT(pressed, table), cv2.LUT(untouched, table), untouched)
        )
        relative = (np.gradient(table) / table).astype(np.float32)
        smooth = cv2.GaussianBlur(before, (0, 0), SMOOTH / CELL, borderType=cv2.BORDER_REPLICATE)
        smooth = smooth.reshape(before.shape)
        slopes, pixels = (
            cv2.resize(one.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
            for one in (sight.slopes, sight.pixels)
        )
        away = [(np.arange(count) + 0.5) * CELL for count in (rows, columns)]
        away = [np.minimum(one, one[::-1]) for one in away]
        rim = RIM + RIM_PIXELS * pixels
        inner = (away[0][:, None] > rim[..., 0]) & (away[1] > rim[..., 1])
        inner &= pixels.max(axis=-1) < FLATTEST * pixels.min(axis=-1)
        light = np.maximum(smooth - dark, faintest)
        visible = light / (light + dark)
        ratio = now / before
        clear = inner[..., None] & (visible > 0.5)
        brighter = float(np.median(((ratio - 1) / visible)[clear])) if clear.any() else 0.0
        gain = max(1 + brighter, LEAST_GAIN)
        part = (ratio - 1 - (gain - 1) * visible) / gain
        rises = np.gradient(np.log(smooth), CELL, axis=(0, 1))
        unsure = PIXEL * np.hypot(*(r * pixels[..., i, None] for i, r in enumerate(rises)))
        noisiness = cv2.LUT(mean, relative).reshape(before.shape)
        logarithm = np.log(light)
        return cls(part, noisiness, unsure, logarithm, visible, slopes, pixels, inner)

    @functools.cached_property
    def length(self) -> float:
        """Of the pad, mm."""
        return self.part.shape[0] * CELL

    @functools.cached_property
    def width(self) -> float:
        """Of the pad, mm."""
        return self.part.shape[1] * CELL

    @functools.cached_property
    def pixel(self) -> float:
        """Side of a pixel on the pad, its median, mm."""
        return float(np.median(np.sqrt(self.pixels[..., 0] * self.pixels[..., 1])))

    def is_misplaced(self) -> bool:
        """Whether a side has become dark: then what is taken for the pad is not the pad alone."""
        change = np.where(self.inner[..., None], self.part / self.visible, np.nan)
        rows, columns = (np.flatnonzero(self.inner.any(axis=axis)) for axis in (1, 0))
        sides = change[rows[:2]], change[rows[-2:]], change[:, columns[:2]], change[:, columns[-2:]]
        return any(np.nanmedian(one) < -DARK_SIDE for one in sides if one.size)

    def noise(self, cells: int) -> float:
        """Deviation of means over squares of so many cells a side, over their ``noisiness``.

        From second differences along the pad, so far apart as pixels are; what is pressed in spoils
        less than half of them.
        """
        if cells not in self._noise:
            means = block_means(self.part / self.noisiness, cells)
            lag = max(1, math.ceil(APART * self.pixel / (cells * CELL)))
            bends = means[lag:-lag] - (means[2 * lag :] + means[: -2 * lag]) / 2
            deviation = NORMAL / math.sqrt(1.5) * np.median(np.abs(bends))
            self._noise[cells] = max(float(deviation), 1e-6)
        return self._noise[cells]

    def pixels_at(self, along: float, across: float) -> Float[np.ndarray, "2"]:
        """How large a pixel is along and across the pad at a place, mm."""
        rows, columns = self.inner.shape
        row = min(max(int(along / CELL), 0), rows - 1)
        column = min(max(int((across + self.width / 2) / CELL), 0), columns - 1)
        return self.pixels[row, column].astype(float)

    def at(self, values: np.ndarray, along: Places, across: Places) -> np.ndarray:
        """Values of cells at places of the pad, interpolated linearly; shape (places, channels)."""
        columns = np.atleast_2d((across + self.width / 2) / CELL - 0.5).astype(np.float32)
        rows = np.atleast_2d(along / CELL - 0.5).astype(np.float32)
        found = cv2.remap(values, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return found.reshape(*np.shape(along), -1)


def block_means(values: np.ndarray, cells: int) -> np.ndarray:
    """Means over squares of so many cells a side; what is left over at the ends is left out."""
    if cells == 1:
        return values
    rows, columns = (size // cells for size in values.shape[:2])
    cut = np.ascontiguousarray(values[: rows * cells, : columns * cells])
    found = cv2.resize(cut, (columns, rows), interpolation=cv2.INTER_AREA)
    return found.reshape(rows, columns, *values.shape[2:])
