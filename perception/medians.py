"""Medians along the last axis, also of those values that count."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Real


def median(values: Real[np.ndarray, "*rest values"]) -> Float[np.ndarray, "*rest"]:
    """As `numpy.median` of the last axis, which takes three times as long for short ones.

    NaN is not among the values.
    """
    ordered, count = np.sort(values, axis=-1), values.shape[-1]
    return ordered[..., (count - 1) // 2] / 2 + ordered[..., count // 2] / 2


class Medians:
    """Medians of the values that are there, whose ranks are counted once.

    Args:
        there: which values count.

    Attributes:
        none: where no value counts.
    """

    def __init__(self, there: Bool[np.ndarray, "*sides places"]) -> None:
        count = there.sum(axis=-1)
        self._without, self.none = ~there, count == 0
        starts = np.arange(0, there.size, there.shape[-1]).reshape(count.shape)
        self._lower = starts + np.maximum(count - 1, 0) // 2
        self._upper = starts + np.minimum(count // 2, there.shape[-1] - 1)

    def of(self, values: Float[np.ndarray, "*sides places"]) -> Float[np.ndarray, "*sides"]:
        """The medians; 0 where no value is there."""
        ordered = np.where(self._without, np.inf, values)
        ordered.sort(axis=-1)
        flat = ordered.reshape(-1)
        return np.where(self.none, 0.0, (flat[self._lower] + flat[self._upper]) / 2)
