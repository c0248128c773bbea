"""How layers of a drawing look, whatever the file format."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from designopt.export.sheet import Layer

BODIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8A8A8A")
"""Colours of bodies in turn; legible on white and on black."""

THIN, MIDDLE, THICK = 0.18, 0.35, 0.5
"""Widths of lines on paper, mm; ISO 128 has them."""


@dataclass(frozen=True)
class Look:
    """How a layer is drawn.

    Attributes:
        colour: ``#RRGGBB``.
        width: of its lines on paper, mm.
        dashed: whether its lines are broken.
    """

    colour: str
    width: float
    dashed: bool = False


KINDS = {
    "body": Look(BODIES[0], MIDDLE),
    "mirror": Look("#7B3FA0", THICK),
    "pad": Look("#C0392B", THICK),
    "blocker": Look("#808080", THICK),
    "camera": Look("#B07D00", MIDDLE),
    "construction": Look("#808080", THIN, dashed=True),
}


def looks_of(layers: Sequence[Layer]) -> Mapping[str, Look]:
    """The look of every layer, by its name."""
    colours = itertools.cycle(BODIES)
    looks = {}
    for layer in layers:
        look = KINDS[layer.kind]
        colour = layer.colour or (next(colours) if layer.kind == "body" else look.colour)
        looks[layer.name] = replace(look, colour=colour)
    return looks
