"""Where the finger bends to, by how the points moved (paper A §III.B, Algorithm 1)."""

from __future__ import annotations

import enum
from typing import Literal

import numpy as np
from jaxtyping import Float

from perception.chamber.points import NAMES, Points

Use = Literal["all", "blue", "centre"]

ACROSS = {"all": "acdfg", "blue": "acg", "centre": "g"}
"""The points whose Δx count; of equal ones the first decides."""

DOWN = {"all": "beg", "blue": "bg", "centre": "g"}
"""The same for Δy."""


class Direction(enum.Enum):
    """Bending directions in the image; the values are what a person reads."""

    INITIAL = "The finger is not bent."
    UP = "The finger bends up."
    DOWN = "The finger bends down."
    LEFT = "The finger bends to the left."
    RIGHT = "The finger bends to the right."
    UNDEFINED = "The frame, or the one to compare it with, shows no chamber."


def compute_displacements(points: Points, initial: Points) -> Float[np.ndarray, "7 2"]:
    """By how much the points moved from an initial frame, pixels to the right and down.

    0 for points that are not seen in both frames: in Algorithm 1, they do not count then.

    Example:
        >>> start = Points(np.zeros((7, 2)), np.ones(7, bool))
        >>> moved = Points(np.tile([3.0, 0.0], (7, 1)), np.ones(7, bool))
        >>> compute_displacements(moved, start)[0].tolist()
        [3.0, 0.0]
    """
    both = points.seen & initial.seen
    return np.where(both[:, None], points.xy - initial.xy, 0.0)


def estimate_bending_direction(
    points: Points, initial: Points, *, threshold: float = 0.0, use: Use = "blue"
) -> Direction:
    """The bending direction by the largest of the displacements.

    Source: paper A §III.B, Algorithm 1. Readings: its maximum is that over all |Δx| and all |Δy|;
    the sign of the change decides, not that of the coordinate; of an equal |Δx| and |Δy| the
    former. Without a threshold, INITIAL is the answer only if nothing moved at all. Image
    directions are those of the image, however the camera is turned.

    Args:
        points: of the frame.
        initial: of a frame of the finger while it is not bent.
        threshold: a largest displacement below it is none, px.
        use: which points. "blue" is the paper's choice, as yellow leaves the view; "all" adds
            yellow, which moves about twice as far, while all its three points are seen: with d and
            f alone a bend down, which takes e out of the image first, looks like one to a side.
            Both have no topmost point, so that of a far bend down only the centre is left, and b
            may even rise where the nearer wall hides blue's lower side. "centre", the centre of
            blue alone, moves with what is left of the region, and across the bending direction it
            stays in place by symmetry.

    Example:
        >>> start = Points(np.zeros((7, 2)), np.ones(7, bool))
        >>> moved = Points(np.tile([3.0, 0.5], (7, 1)), np.ones(7, bool))
        >>> estimate_bending_direction(moved, start).name
        'RIGHT'
    """
    if not (points.seen[6] and initial.seen[6]):
        return Direction.UNDEFINED
    if use == "all" and not (points.seen & initial.seen)[3:6].all():
        use = "blue"
    moved = compute_displacements(points, initial)
    across = moved[[NAMES.index(name) for name in ACROSS[use]], 0]
    down = moved[[NAMES.index(name) for name in DOWN[use]], 1]
    right = across[np.abs(across).argmax()]
    below = down[np.abs(down).argmax()]
    largest = max(abs(right), abs(below))
    if largest < threshold or largest == 0:
        return Direction.INITIAL
    if abs(right) == largest:
        return Direction.RIGHT if right > 0 else Direction.LEFT
    return Direction.DOWN if below > 0 else Direction.UP
