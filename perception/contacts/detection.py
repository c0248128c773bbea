"""Where something may be pressed into a pad: round changes of light, at several scales.

In the light of lamps what is pressed in is brighter on the side of each color's lamp and darker on
the other: about it the smoothed change rises towards the lamp. Under even light it is darker than
what is around it. Both are scale-normalized derivatives of Gaussians, which are largest at the
scale of a blob (T. Lindeberg, Int. J. Comput. Vision 30 (1998) 79).
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from perception.contacts.change import CELL, Change, block_means
from perception.contacts.lamps import Lamps

SCALES = np.array([0.5, 0.7, 1.0, 1.4, 2.0, 2.8])
"""Standard deviations, mm; a contact's radius is about as large as the one that fits it."""

COARSE = 2
"""Cells along a side of those that are looked at."""

AROUND = 1.6
"""Scale of what is around over that of what is within, nearly a Laplacian's (D. Marr, E. Hildreth,
Proc. R. Soc. B 207 (1980) 187)."""

GROWTH = 0.6
"""Noise falls at least with this power of the scale."""

LIKELY = 5.0
"""Deviations of noise from which on it may be a contact."""

QUARTER = 3.138
"""Standard deviation of normal numbers over the first quartile of their absolute values."""

LIT_RADIUS = 3**0.5
"""Radius over the scale that answers most, of a bulge like a Gaussian in the light of lamps: its
edge, where it is steepest, is at its deviation. Under even light it is about 1."""

LIFTED = 0.4
"""mm: about so high is the membrane on most contacts, by which they appear displaced."""


class Candidate(NamedTuple):
    """Something that may be a contact: place and radius, mm, and how far above noise it is."""

    along: float
    across: float
    radius: float
    strength: float


def find_candidates(change: Change, lamps: Lamps) -> list[Candidate]:
    """What may be contacts, the strongest first.

    Args:
        change: of the light of a pad.
        lamps: that light the pad.
    """
    deviation = np.hypot(change.noisiness, change.unsure / change.noise(1))
    means = block_means(change.part / deviation, COARSE)
    inner = block_means(change.inner.astype(np.float32), COARSE) > 0.99
    if not inner.any():
        return []
    means = np.where(inner[..., None], means - np.median(means, axis=(0, 1)), 0)
    step = COARSE * CELL
    middle = np.array([change.length / 2, 0])
    toward = np.array([np.zeros(2) if one is None else one.toward(middle) for one in lamps])
    toward = toward.reshape(-1, 2)
    even = not any(lamps)
    ratio = 1.0 if even else LIT_RADIUS
    blobs = _even_blobs if even else _lit_blobs
    found = np.stack([blobs(means, scale / step, toward) for scale in SCALES])
    levels = QUARTER * np.quantile(np.abs(found[:, inner]), 0.25, axis=1)
    # At small scales what is pressed in spoils few places only.
    noise = np.minimum(levels, levels[0] * (SCALES[0] / SCALES) ** GROWTH) + 1e-9
    highest = np.stack([cv2.dilate(one, np.ones((5, 5))) for one in found])
    strength = found / noise[:, None, None]
    candidates = []
    for scale, row, column in np.argwhere((found == highest) & (strength > LIKELY)):
        place = (row + 0.5) * step, (column + 0.5) * step - change.width / 2
        slopes = change.at(change.slopes, *map(np.array, place))
        along, across = np.array(place) + LIFTED * np.clip(slopes, -2, 2)
        size, above = ratio * float(SCALES[scale]), float(strength[scale, row, column])
        candidates.append(Candidate(float(along), float(across), size, above))
    return sorted(candidates, key=lambda one: -one.strength)


def _lit_blobs(
    means: Float[np.ndarray, "rows columns colors"],
    scale: float,
    toward: Float[np.ndarray, "lamps 2"],
) -> Float[np.ndarray, "rows columns"]:
    smooth = cv2.GaussianBlur(means, (0, 0), scale, borderType=cv2.BORDER_CONSTANT)
    rises = np.gradient(smooth, axis=0) @ toward[:, 0] + np.gradient(smooth, axis=1) @ toward[:, 1]
    return (scale * rises).astype(np.float32)


def _even_blobs(
    means: Float[np.ndarray, "rows columns colors"], scale: float, _: Float[np.ndarray, "lamps 2"]
) -> Float[np.ndarray, "rows columns"]:
    mean = means.mean(axis=-1)
    within, around = (
        cv2.GaussianBlur(mean, (0, 0), one, borderType=cv2.BORDER_CONSTANT)
        for one in (scale, AROUND * scale)
    )
    return (around - within).astype(np.float32)
