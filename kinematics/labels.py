"""Where the names of joints stand in a drawing: beside them, on nothing that is drawn."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

Points = Float[np.ndarray, "points 2"]

FONT = 8.0
"""Size of the labels, in points."""
ANGLES = np.radians([45, 90, 0, 135, 180, -45, 225, -90, *np.arange(22.5, 360, 45)])
DISTANCES = (9.0, 13.0, 18.0, 24.0)
CLEAR = 6.0
"""Points between a label and a line's middle beyond which more does not count."""
STEP = 3.0
"""Points between the samples that stand for a line."""


def sampled(line: Points, scale: float) -> Points:
    """Points along a line, close enough to stand for it, in points on paper.

    Args:
        line: its corners, mm.
        scale: points per mm.
    """
    parts = [line[:1]]
    for start, end in itertools.pairwise(line):
        count = 1 + int(min(math.hypot(*(end - start)) * scale / STEP, 1000))
        parts.append(start + np.linspace(0, 1, count + 1)[1:, None] * (end - start))
    return np.vstack(parts) * scale


def label_offsets(
    places: Sequence[Mapping[str, Float[np.ndarray, "2"]]], drawn: Sequence[Points], scale: float
) -> dict[str, tuple[float, float]]:
    """Where each joint's label stands relative to it, the same in all of several poses.

    Args:
        places: in each pose the joints that have a label, mm.
        drawn: in each pose what labels keep clear of, in points on paper.
        scale: points per mm.

    Returns:
        Offsets of the labels' middles, in points.
    """
    kept = list(drawn)
    offsets = {}
    for name in places[0]:
        half = np.array([0.3 * FONT * len(name), 0.5 * FONT])
        box = half * np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)])
        best = max(
            _candidates(half),
            key=lambda offset: (
                sum(
                    _clearance(pose[name] * scale + offset + box, clutter)
                    for pose, clutter in zip(places, kept, strict=True)
                )
                - 0.05 * len(places) * math.hypot(*offset)
            ),
        )
        offsets[name] = (float(best[0]), float(best[1]))
        kept = [
            np.vstack([clutter, pose[name] * scale + best + box])
            for pose, clutter in zip(places, kept, strict=True)
        ]
    return offsets


def _candidates(half: Float[np.ndarray, "2"]) -> list[Float[np.ndarray, "2"]]:
    """Middles of a label around its joint; a long name stands farther out at the sides."""
    wider = max(half[0] - half[1], 0.0)
    return [
        np.array(
            [
                distance * math.cos(angle) + wider * np.sign(round(math.cos(angle), 9)),
                distance * math.sin(angle),
            ]
        )
        for distance in DISTANCES
        for angle in ANGLES
    ]


def _clearance(box: Points, clutter: Points) -> float:
    """How far a label is from what is drawn, up to `CLEAR`, in points."""
    gaps = box[:, None, :] - clutter[None, :, :]
    nearest = math.sqrt(float(np.min(np.sum(gaps * gaps, axis=-1), initial=CLEAR**2)))
    return min(nearest, CLEAR)
