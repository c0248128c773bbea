"""Poses of frames with known joint angles."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

INSET = 0.1
"""Labelled frames keep away from the ends of a range by this part of it."""


def spread_angles(
    limits: list[tuple[float, float]], count: int
) -> Float[np.ndarray, "count joints"]:
    """Evenly spread values of every joint, the second one's in another order than the first's."""
    columns = []
    for joint, (low, high) in enumerate(limits):
        inset = INSET * (high - low)
        values = np.linspace(low + inset, high - inset, count)
        # A step that has no common factor with the count visits all values.
        step = next(s for s in range(count // 2 + joint, 2 * count) if np.gcd(s, count) == 1)
        columns.append(values[(np.arange(count) * (step if joint else 1)) % count])
    return np.stack(columns, axis=-1)
