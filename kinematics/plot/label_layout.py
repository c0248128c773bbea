"""Where the names of joints stand in a drawing: beside them, on nothing that is drawn."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

Points = Float[np.ndarray, "_ 2"]
Place = Float[np.ndarray, "2"]

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
    places: Sequence[Mapping[str, Place]],
    drawn: Sequence[Points],
    scale: float,
    angles: Sequence[Mapping[str, float]] | None = None,
) -> dict[str, tuple[float, float]]:
    """Where each joint's label stands relative to it, the same in all of several poses.

    Args:
        places: in each pose the joints that have a label, mm.
        drawn: in each pose what labels keep clear of, in points on paper.
        scale: points per mm.
        angles: in each pose by how much a joint's label is turned about it, rad; 0 by default.

    Returns:
        Offsets of the labels' middles, in points, to be turned by the angles.
    """
    kept = list(drawn)
    turns = angles or [dict.fromkeys(places[0], 0.0)] * len(places)
    offsets = {}
    for name in places[0]:
        joint = [(pose[name] * scale, turn[name]) for pose, turn in zip(places, turns, strict=True)]
        best = _best_offset(len(name), joint, kept)
        boxes = _boxes(len(name), joint, best)
        kept = [np.vstack(pair) for pair in zip(kept, boxes, strict=True)]
        offsets[name] = (float(best[0]), float(best[1]))
    return offsets


def _best_offset(letters: int, joint: list[tuple[Place, float]], kept: list[Points]) -> Place:
    """Of all candidates the one that is clearest on the average, and near to the joint."""

    def merit(offset: Place) -> float:
        clear = sum(map(_clearance, _boxes(letters, joint, offset), kept)) / len(joint)
        return clear - 0.05 * math.hypot(*offset)

    return max(_candidates(_half(letters)), key=merit)


def _boxes(letters: int, joint: list[tuple[Place, float]], offset: Place) -> list[Points]:
    """Points of a label in each pose, for a joint's places (points) and angles."""
    box = _half(letters) * np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)])
    return [place + turned(offset, angle) + box for place, angle in joint]


def _half(letters: int) -> Place:
    """Half the width and height of a label, in points."""
    return np.array([0.3 * FONT * letters, 0.5 * FONT])


def turned(offset: Place, angle: float) -> Place:
    """An offset turned counter-clockwise by an angle, rad."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]]) @ offset


def _candidates(half: Place) -> list[Place]:
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
