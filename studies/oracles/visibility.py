"""What scenes show, in as many digits as mpmath works in: formulas that name what bounds each view.

Places are complex numbers. Whoever writes a formula reasons about the scene and gives the lines
that bound its views: there is no search. Derivatives are central differences in the same digits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import mpmath
import numpy as np

from studies.oracles.rays import Structure

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

    Args:
        structure: how the row is to be read.
        row: mpmath numbers.

    Attributes:
        read: indices of those that have been asked for.
    """

    def __init__(self, structure: Structure, row: np.ndarray) -> None:
        self.structure, self.row = structure, row
        self.read: set[int] = set()

    def __getitem__(self, name: str) -> Segment:
        first = 4 * self.structure.names.index(name)
        return self._place(first), self._place(first + 2)

    @property
    def camera(self) -> Any:
        """Its position."""
        return self._place(self.structure.camera.start)

    @property
    def limits(self) -> tuple[Any, Any]:
        """Directions of the right and the left limit of the field of view."""
        direction = self._number(self.structure.camera.stop)
        half = self._number(self.structure.camera.stop + 1) / 2
        return mpmath.expj(direction - half), mpmath.expj(direction + half)

    @property
    def grazing(self) -> Any:
        """Least grazing angle of pad 0."""
        return self._number(self.structure.camera.stop + 2)

    def _place(self, first: int) -> Any:
        return mpmath.mpc(self._number(first), self._number(first + 1))

    def _number(self, index: int) -> Any:
        self.read.add(index)
        return self.row[index]


Formula = Callable[[ExactScene], list[Piece]]


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


def direct(scene: ExactScene, *spans: tuple[Any, Any], pad: int = 0) -> list[Piece]:
    """What is seen of a pad without a mirror."""
    return [Piece((), scene.camera, mpmath.mpf(a), mpmath.mpf(b), pad) for a, b in spans]


def between(scene: ExactScene, name: str) -> list[Any]:
    """Pad coordinates behind the ends of a surface, in their order on it."""
    return [met(scene["p0"], scene.camera, end) for end in scene[name]]


def around(scene: ExactScene) -> list[Piece]:
    """What is seen of a pad beside blocker 0."""
    first, last = between(scene, "b0")
    return direct(scene, (0, first), (last, 1))


def in_mirror(scene: ExactScene) -> Piece:
    """What mirror 0 shows of a pad that is longer than what it can show."""
    source = mirrored(scene.camera, scene["m0"])
    start, end = sorted(met(scene["p0"], source, end) for end in scene["m0"])
    return Piece((0,), source, start, end)


def whole(scene: ExactScene) -> list[Piece]:
    """All of the pad directly, nothing else."""
    return direct(scene, (0, 1))


def nothing(scene: ExactScene) -> list[Piece]:
    """Nothing at all."""
    return []


def shown(scene: ExactScene, formula: Formula, bounces: int) -> np.ndarray:
    """Coverage of the pads, part that each path shows of each, margin of what is seen (else 0).

    Args:
        scene: the scene.
        formula: its pieces.
        bounces: most reflections of a path.
    """
    words, pads = scene.structure.words(bounces), scene.structure.pads
    pieces = [piece for piece in formula(scene) if piece.word in words]
    coverage, reached = (np.full(pads, mpmath.mpf(0)) for _ in range(2))
    seen, margin = (np.full((len(words), pads), mpmath.mpf(0)) for _ in range(2))
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
    """Derivatives of `shown` with respect to a scene's row, shape (numbers, inputs).

    Args:
        scene: the scene, which `shown` has read.
        formula: its pieces.
        bounces: most reflections of a path.
        unit: in what the inputs are counted, shape (inputs,).
    """
    found = shown(scene, formula, bounces)
    result = np.full((len(found), len(unit)), mpmath.mpf(0))
    for index in scene.read:  # what is not asked for changes nothing
        high, low = (scene.row.copy() for _ in range(2))
        high[index] += STEP * unit[index]
        low[index] -= STEP * unit[index]
        ends = [shown(ExactScene(scene.structure, row), formula, bounces) for row in (high, low)]
        result[:, index] = (ends[0] - ends[1]) / (2 * STEP)
    return result


class Views(NamedTuple):
    """What a scene shows, and how that follows its inputs.

    Attributes:
        numbers: as `shown` returns them.
        slopes: their derivatives, coordinates in units of the scene's size; if there are any.
        own: the inputs, counted from the camera, in the same units.
        unit: that size for coordinates, 1 for angles.
        views: whether each path shows each pad, shape (paths, pads).
    """

    numbers: np.ndarray
    slopes: np.ndarray | None
    own: np.ndarray
    unit: np.ndarray
    views: np.ndarray

    def errors(
        self, found: np.ndarray, gradient: np.ndarray, weights: np.ndarray
    ) -> tuple[float, float, float]:
        """Condition-scaled errors of an answer.

        Args:
            found: numbers in the order of `shown`.
            gradient: of their weighted sum, without the margins of views that there are not.
            weights: of the numbers in that sum.

        Returns:
            The worst error of a number; of the gradient's entries, relative to the largest or by
            what they would do to the sum; and of an entry that is not rounding beside the largest,
            relative to that entry. The last two are NaN where there are no derivatives.
        """
        # A margin is judged where there is a view; how far another is missed has no formula.
        weights = weights.copy()
        weights[-self.views.size :] *= self.views.reshape(-1)
        missed, judged = abs(digits(found) - self.numbers), weights > 0
        if self.slopes is None:
            return float(max(missed[: -self.views.size])), np.nan, np.nan
        swing = np.sum(self.own * abs(self.slopes), axis=1)
        value = float(max((missed / (1 + swing))[judged]))
        slope = np.sum(weights[:, None] * self.slopes, axis=0)
        off, steepest = abs(digits(gradient) * self.unit - slope), max(abs(slope))
        if steepest == 0:  # nothing is seen, whatever moves
            return value, float(max(off)), float(max(off))
        effect = np.sum(weights * (abs(self.numbers) + swing))
        steep = abs(slope) > 1e-15 * steepest
        return (
            value,
            float(max(np.minimum(off / steepest, self.own * off / effect))),
            float(max(off[steep] / abs(slope[steep]))),
        )


def views(
    structure: Structure, row: np.ndarray, formula: Formula, bounces: int, smooth: bool
) -> Views:
    """The views of a scene; ``smooth`` if its numbers have derivatives."""
    number, camera = digits(row), structure.camera.stop
    scene = ExactScene(structure, number)
    numbers = shown(scene, formula, bounces)
    parts = np.split(numbers[structure.pads :], 2)[0].reshape(-1, structure.pads)
    places = number[:camera].reshape(-1, 2)
    own = abs(places - places[-1])
    own[-1] = np.max(own, axis=0)  # moving the camera moves all else the other way
    size = np.max(own) or mpmath.mpf(1)
    unit = np.array([size] * camera + [mpmath.mpf(1)] * (len(row) - camera))
    own = np.concatenate([own.reshape(-1), abs(number[camera:])]) / unit
    moved = slopes(scene, formula, bounces, unit) if smooth else None
    return Views(numbers, moved, own, unit, parts > 0)


def digits(values: np.ndarray) -> np.ndarray:
    """Numbers as those of mpmath; what is not finite is far from all others."""
    return np.array([mpmath.mpf(float(v)) if np.isfinite(v) else mpmath.mpf(1e300) for v in values])
