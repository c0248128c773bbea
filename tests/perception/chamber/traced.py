"""Path-traced pictures of wet, dusty chambers: `tests.trace_chambers` makes them."""

from __future__ import annotations

import functools

import cv2
import numpy as np

from tests.helpers import DATA


@functools.cache
def picture(name: str, gamma: float = 1.0, level: float = 1.0) -> np.ndarray:
    """A picture, brighter by a level and by a response curve, so cut off at full scale."""
    image = cv2.imread(str(DATA / f"chamber_{name}.png"))
    assert image is not None
    light = np.clip(level * image[..., ::-1] / 255, 0, 1)
    return np.rint(255 * light ** (1 / gamma)).astype(np.uint8)
