"""Result codes of a view that was looked for in an image."""

from __future__ import annotations

import enum


class Quality(enum.Enum):
    """How a view was found; the values are what a person reads."""

    COMPLETE = "All four sides of the pad are seen."
    CLIPPED = "The view is cut off by the image's border or by something in the way."
    FLAT = "The pad is seen too flat: at less than its least grazing angle."
    GHOST = "Something bright that is no view of a pad that was asked for."
    MERGED = "The view runs into another one; its outline is not that of the pad."
    AMBIGUOUS = "The image shows a pad that this joint moves at two joint angles at once."
    BLURRED = "The view's sides are too blurred for its corners to be relied on."
    LOW_CONTRAST = "A side of the view is hardly brighter than what is beside it."
    MISSING = "The view was not found."
