"""How layers of a drawing look, whatever the file format."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from designopt.export.drawing import Layer

BODIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8A8A8A")
"""Colours of bodies in turn; legible on white and on black."""

THIN, MIDDLE, THICK = 0.18, 0.35, 0.5
"""Widths of lines on paper, mm; ISO 128 has them."""


class LineStyle(NamedTuple):
    """How a layer is drawn.

    Attributes:
        color: ``#RRGGBB``.
        width: of its lines on paper, mm.
        dashed: whether its lines are broken.
        fill: opacity with which closed lines are filled.
    """

    color: str
    width: float
    dashed: bool = False
    fill: float = 0.0


KINDS = {
    "body": LineStyle(BODIES[0], MIDDLE),
    "mirror": LineStyle("#7B3FA0", THICK),
    "pad": LineStyle("#C0392B", THICK),
    "blocker": LineStyle("#808080", THICK),
    "camera": LineStyle("#B07D00", MIDDLE),
    "construction": LineStyle("#808080", THIN, dashed=True),
    "path": LineStyle("#808080", THIN),
    "view": LineStyle("#56B4E9", THIN, fill=0.25),
}


def line_styles_of(layers: Sequence[Layer]) -> Mapping[str, LineStyle]:
    """The look of every layer, by its name."""
    colors = itertools.cycle(BODIES)
    looks = {}
    for layer in layers:
        look = KINDS[layer.kind]
        color = layer.color or (next(colors) if layer.kind == "body" else look.color)
        looks[layer.name] = look._replace(color=color)
    return looks
