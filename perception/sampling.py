"""Values of an image between its pixels."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float


def sampled(
    image: np.ndarray, places: Float[np.ndarray, "rows columns 2"], *, smooth: bool = False
) -> np.ndarray:
    """An image at given places (column, row), interpolated; beyond its border as on it.

    Args:
        image: of any number of channels.
        places: a table of places.
        smooth: by cubics, for maps; linearly by default.
    """
    columns, rows = (np.ascontiguousarray(places[..., part], np.float32) for part in range(2))
    how = cv2.INTER_CUBIC if smooth else cv2.INTER_LINEAR
    return cv2.remap(image, columns, rows, how, borderMode=cv2.BORDER_REPLICATE)
