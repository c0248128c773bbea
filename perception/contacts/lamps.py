"""Light of line lamps that stand beside a pad, on a membrane that leans and is lifted.

A lamp is a band of the same radiance, along a line over the pad's plane and between two heights. On
a matt membrane at the height z with the unit normal n, a piece of it at the horizontal arrow w from
there, which shines along d towards the pad, sends light as

    (w·d) (w·n + (H − z) n_z) / (|w|² + (H − z)²)²

(pieces are short against w). What of the lamp is below the membrane sends none, and no
piece lights a membrane that faces away from it. Shadows of other places are not computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

PIECES = 5
"""Of a lamp, by equal angles seen from a contact."""

ROWS = 2
"""Of pieces, one above the other: lamps of layers are as high as contacts are far from them."""

NEAREST = 0.5
"""mm: the membrane is no nearer to a lamp's line."""


@dataclass(frozen=True)
class Lamp:
    """A line lamp beside a pad.

    Attributes:
        start: one end of its line: along the pad from its first end, across from its middle, mm.
        end: the other one.
        low: height of its lower edge above the pad, mm.
        high: of its upper edge.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    low: float
    high: float

    def toward(self, place: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """Direction from a place to its line, at right angles."""
        start, end = np.array(self.start), np.array(self.end)
        line = (end - start) / np.linalg.norm(end - start)
        away = start - place
        away = away - (away @ line) * line
        return away / np.linalg.norm(away)


Lamps = Sequence[Lamp | None]
"""The lamp of each color, red first; ``None`` for a color that none lights from aside. Without any
the light is even."""


class Pieces(NamedTuple):
    """Pieces of a lamp seen from places; arrays of the shape (pieces, places), but as written.

    Attributes:
        along: arrows to them, mm.
        across: likewise.
        square: of their lengths, mm².
        weight: light per solid angle, over what comes to a flat membrane from the lamp.
        edges: heights of the rows of pieces: lower and upper edges, shape (rows, 2), mm.
    """

    along: np.ndarray
    across: np.ndarray
    square: np.ndarray
    weight: np.ndarray
    edges: np.ndarray

    @classmethod
    def of(cls, lamp: Lamp, middle: Float[np.ndarray, "2"], along, across) -> Pieces:
        """Those of a lamp, as they matter about a place.

        Args:
            lamp: the lamp.
            middle: of a contact, mm.
            along: places about it, mm.
            across: likewise.
        """
        start, end = np.array(lamp.start), np.array(lamp.end)
        toward, length = lamp.toward(middle), float(np.linalg.norm(end - start))
        line = (end - start) / length
        distance = max(float((start - middle) @ toward), NEAREST)
        first = float((start - middle) @ line)
        ends = np.arctan2([first, first + length], distance)
        angles = ends[0] + (np.arange(PIECES) + 0.5) / PIECES * (ends[1] - ends[0])
        places = middle + distance * toward + distance * np.tan(angles)[:, None] * line
        ways = places[:, 0, None] - along, places[:, 1, None] - across
        sent = np.maximum(ways[0] * toward[0] + ways[1] * toward[1], NEAREST)
        square = np.maximum(ways[0] ** 2 + ways[1] ** 2, NEAREST**2)
        weight = sent / np.cos(angles)[:, None] ** 2
        steps = np.linspace(lamp.low, lamp.high, ROWS + 1)
        edges = np.stack([steps[:-1], steps[1:]], axis=-1)
        flat = sum(weight * height / (square + height**2) ** 2 for height in edges.mean(axis=1))
        weight = weight / np.sum(flat, axis=0)
        return cls(*(one.astype(np.float32) for one in (*ways, square, weight, edges)))

    def light(self, by_along, by_across, upright, height) -> np.ndarray:
        """Light on a membrane over that on the flat one, for arrays of shape (…, places).

        Args:
            by_along: the normal's component along the pad.
            by_across: and across it.
            upright: and up.
            height: of the membrane, mm.
        """
        along, across, square, weight = (one[:, None] for one in self[:4])
        level = along * by_along + across * by_across
        light = np.zeros(1)
        for low, high in self.edges:
            bottom = np.clip(height, low, high)
            rise = (high + bottom) / 2 - height
            met = np.maximum(level + rise * upright, 0) / (square + rise * rise) ** 2
            light = light + (high - bottom) / (high - low) * np.sum(weight * met, axis=0)
        return light
