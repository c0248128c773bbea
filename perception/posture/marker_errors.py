"""How far predicted markers are off, and how far they are without looking at all."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def compute_marker_errors(
    predicted: Float[np.ndarray, "images 3 2"], markers: Float[np.ndarray, "images 3 2"]
) -> Float[np.ndarray, "images 3"]:
    """Distances between predicted and true markers, mm; the tip's are the last column.

    Example:
        >>> import numpy as np
        >>> compute_marker_errors(np.zeros((1, 3, 2)), np.tile([3.0, 4.0], (1, 3, 1))).tolist()
        [[5.0, 5.0, 5.0]]
    """
    return np.linalg.norm(predicted - markers, axis=-1)


def compute_mean_predictor_error(
    train_markers: Float[np.ndarray, "samples 3 2"], markers: Float[np.ndarray, "images 3 2"]
) -> float:
    """Mean tip error of who always answers the mean of the training labels, mm.

    A network that is no better has learnt nothing from its images.

    Example:
        >>> import numpy as np
        >>> compute_mean_predictor_error(np.zeros((2, 3, 2)), np.tile([3.0, 4.0], (1, 3, 1)))
        5.0
    """
    always = np.broadcast_to(train_markers.mean(axis=0), markers.shape)
    return float(compute_marker_errors(always, markers)[:, -1].mean())
