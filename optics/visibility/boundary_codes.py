"""What bounds a view, as one number: so it can be searched without derivatives and looked up."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Array, Int

FIRST_PAD_END, SECOND_PAD_END, LEFT_LIMIT, RIGHT_LIMIT, LOW_GRAZING, HIGH_GRAZING, FOLD = range(
    -1, -8, -1
)
"""Labels of what bounds a view and is no surface in its way: the pad's own ends, the limits of the
field of view, the least grazing angle towards the pad's two ends, a fold of the image."""

FIRST_BEZEL, SECOND_BEZEL, LOW_TRANSMISSION, HIGH_TRANSMISSION, FIRST_WALL, SECOND_WALL = range(
    -8, -14, -1
)
"""Labels of what layers add to these: the bezel at the pad's two ends, the least transmission
towards them, and the end faces of layers where they meet the outermost surface; two less, four
less, … where layers meet each other."""

WINDOWS = -(1 << 20)
"""Label of the first end of the first of a surface's windows, in the search for the best line of
sight only: a layer's edge may bound a clear end face and a window behind it. The others follow."""

LIMITS = (LEFT_LIMIT, RIGHT_LIMIT, LOW_GRAZING, HIGH_GRAZING)
"""Labels of what bounds every view: the field of view, and the flattest rays."""

PAD_ENDS, BEZELS = (FIRST_PAD_END, SECOND_PAD_END), (FIRST_BEZEL, SECOND_BEZEL)
DARK = (LOW_TRANSMISSION, HIGH_TRANSMISSION)
"""Labels at both ends of a pad."""

FIRST_END, SECOND_END, CROSSING, CUT_BEFORE, CUT_AFTER, HORIZON = range(6)
"""What of a surface can bound a view: one of its ends, the place where it meets the pad, the place
where it meets the line of the mirror before or after it on the path, or that where a curved one
turns away from the ray."""

# Bits of a kind and of a surface, since programs take labels apart again and again.
_KIND, _SURFACE = 3, 16

Number = Int[Array | np.ndarray, "..."] | int


def label_of(leg: Number, surface: Number, kind: int) -> Any:
    """The label, 0 or more, of one kind of end of a surface, by index, on a leg of a path.

    There are labels for 65,536 surfaces; that of a mirror −1, which is not there, means nothing.
    """
    return (leg << (_KIND + _SURFACE)) + (surface << _KIND) + kind


def edge_of_layers(level: Number, end: int | np.ndarray) -> Any:
    """The label of where layers end at a level, the outermost surface the first, at either end."""
    return FIRST_WALL - 2 * level - end


def with_kind(label: Number, kind: int) -> Any:
    """The label of another kind of end of the same surface on the same leg."""
    return (label >> _KIND << _KIND) + kind


def parts_of(label: Number) -> tuple[Any, Any, Any]:
    """Leg, surface and kind of a label that is not negative."""
    surface = (label >> _KIND) & ((1 << _SURFACE) - 1)
    return label >> (_KIND + _SURFACE), surface, label & ((1 << _KIND) - 1)


def is_own_end(label: Number, end: int) -> Any:
    """Whether a label is of where a pad itself ends at either end, or its bezel or its layers."""
    walls = (label <= FIRST_WALL) & (label > WINDOWS) & ((FIRST_WALL - label) % 2 == end)
    return walls | (label == PAD_ENDS[end]) | (label == BEZELS[end])
