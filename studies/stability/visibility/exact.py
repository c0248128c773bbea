"""What extreme scenes show, in 50 digits: formulas that name what bounds every piece.

Places are complex numbers. Each formula is told which lines bound the view, by reasoning about its
scene; there is no search, and nothing of the library. Derivatives are central differences in the
same digits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np

from studies.stability.visibility.scenes import (
    CAMERA,
    DIRECTION,
    FIELD_OF_VIEW,
    GRAZING,
    NAMES,
    PADS,
    STRUCTURE,
)

STEP = mpmath.mpf(10) ** -20
"""Step of the central differences, in units of the inputs."""

Segment = tuple[Any, Any]
"""Two ends, complex."""


@dataclass(frozen=True)
class Piece:
    """A part of a pad that a path shows.

    Attributes:
        word: mirrors along the path.
        source: the (virtual) camera.
        start: pad coordinate.
        end: pad coordinate.
        pad: which pad.
    """

    word: tuple[int, ...]
    source: Any
    start: Any
    end: Any
    pad: int = 0


class ExactScene:
    """A row of numbers as a scene: its surfaces by name (``scene["m0"]``) and its camera.

    Attributes:
        row: mpmath numbers.
        read: indices of those that have been asked for.
    """

    def __init__(self, row: np.ndarray) -> None:
        self.row = row
        self.read: set[int] = set()

    def __getitem__(self, name: str) -> Segment:
        first = 4 * NAMES.index(name)
        return self._place(first), self._place(first + 2)

    @property
    def camera(self) -> Any:
        """Its position."""
        return self._place(CAMERA.start)

    @property
    def limits(self) -> tuple[Any, Any]:
        """Directions of the right and the left limit of the field of view."""
        half = self._number(FIELD_OF_VIEW) / 2
        right, left = (mpmath.expj(self._number(DIRECTION) + turn) for turn in (-half, half))
        return right, left

    @property
    def grazing(self) -> Any:
        """Least grazing angle of pad 0."""
        return self._number(GRAZING.start)

    def _place(self, first: int) -> Any:
        return mpmath.mpc(self._number(first), self._number(first + 1))

    def _number(self, index: int) -> Any:
        self.read.add(index)
        return self.row[index]


def cross(first: Any, second: Any) -> Any:
    """The z component of the vector product."""
    return (mpmath.conj(first) * second).imag


def met(pad: Segment, source: Any, through: Any) -> Any:
    """Pad coordinate at which the line through two places meets the pad's."""
    first, last = (cross(through - source, end - source) for end in pad)
    return first / (first - last)


def mirrored(place: Any, mirror: Segment) -> Any:
    """The image of a place."""
    start, along = mirror[0], mirror[1] - mirror[0]
    return start + along * mpmath.conj((place - start) / along)


def crossing(first: Segment, second: Segment) -> Any:
    """Where two lines cross."""
    return first[0] + met(first, *second) * (first[1] - first[0])


Formula = Callable[[ExactScene], list[Piece]]


def judged_numbers(scene: ExactScene, formula: Formula, bounces: int) -> np.ndarray:
    """Coverage of the pads, part that each path shows of each, margin of what is seen (else 0).

    Args:
        scene: the scene.
        formula: what it shows.
        bounces: most reflections of a path.
    """
    words = STRUCTURE.words(bounces)
    pieces = [piece for piece in formula(scene) if piece.word in words]
    coverage, reached = (np.full(PADS, mpmath.mpf(0)) for _ in range(2))
    seen, margin = (np.full((len(words), PADS), mpmath.mpf(0)) for _ in range(2))
    for piece in sorted(pieces, key=lambda piece: piece.start):
        pad, view = piece.pad, (words.index(piece.word), piece.pad)
        coverage[pad] += max(piece.end - max(piece.start, reached[pad]), 0)
        reached[pad] = max(reached[pad], piece.end)
        start, end = scene[f"p{pad}"]
        arrows = [start + at * (end - start) - piece.source for at in (piece.start, piece.end)]
        seen[view] += piece.end - piece.start
        margin[view] = max(margin[view], abs(mpmath.arg(arrows[1] / arrows[0])))
    return np.concatenate([coverage, seen.reshape(-1), margin.reshape(-1)])


def slopes(scene: ExactScene, formula: Formula, bounces: int, unit: np.ndarray) -> np.ndarray:
    """Derivatives of `judged_numbers` with respect to a scene's row, shape (numbers, inputs).

    Args:
        scene: the scene.
        formula: what it shows.
        bounces: most reflections of a path.
        unit: in what the inputs are counted, shape (inputs,).
    """
    found = judged_numbers(scene, formula, bounces)
    result = np.full((len(found), len(unit)), mpmath.mpf(0))
    for index in scene.read:  # what is not asked for changes nothing
        high, low = (scene.row.copy() for _ in range(2))
        high[index] += STEP * unit[index]
        low[index] -= STEP * unit[index]
        ends = [judged_numbers(ExactScene(row), formula, bounces) for row in (high, low)]
        result[:, index] = (ends[0] - ends[1]) / (2 * STEP)
    return result
