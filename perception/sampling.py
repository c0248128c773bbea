"""Values of an image between its pixels."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float


def sampled(image: np.ndarray, places: Float[np.ndarray, "rows columns 2"]) -> np.ndarray:
    """An image at given places (column, row), interpolated linearly; beyond its border as on it.

    Args:
        image: of any number of channels.
        places: a table of places.
    """
    columns, rows = (np.ascontiguousarray(places[..., part], np.float32) for part in range(2))

    def at(channels: np.ndarray) -> np.ndarray:
        return cv2.remap(channels, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    if image.ndim == 3 and image.shape[2] == 2:
        # Of two channels OpenCV rounds places to 1/32 px; of one it does not.
        return np.stack([at(np.ascontiguousarray(image[..., part])) for part in range(2)], axis=-1)
    return at(image)
