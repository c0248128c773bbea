"""Paper A's chamber, and others that differ from it."""

import dataclasses

from optics import Chamber, read_chamber
from tests.helpers import GALLERY

_, PAPER = read_chamber(GALLERY / "chambers/chamber.toml")
"""With constants that Table I follows, near η = 0.6."""


def chamber(**changes: float) -> Chamber:
    """Of the float type of the moment."""
    fields = {field.name: float(getattr(PAPER, field.name)) for field in dataclasses.fields(PAPER)}
    return Chamber(**(fields | changes))
