"""What a family of extreme scenes is, and what its scenes and formulas are written with."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np

from studies.stability.visibility.exact import ExactScene, Formula, Piece, met, mirrored
from studies.stability.visibility.scenes import NAMES, PADS


@dataclass(frozen=True)
class Family:
    """Scenes that are extreme in one respect.

    Attributes:
        case: what is extreme in them.
        rows: shape (cases, inputs), float64.
        formula: what they show.
        clear: of each, how far it is from where its views change, of its size; infinite where
            the answer holds at once.
        smooth: whether it has derivatives: not where surfaces or views just touch.
        steepness: by how much a small relative change of the inputs, counted from the camera, is
            enlarged in the gradient.
    """

    case: str
    rows: np.ndarray
    formula: Formula
    clear: np.ndarray | float = np.inf
    smooth: bool = True
    steepness: np.ndarray | float = 1.0


Surfaces = Mapping[str, Sequence[complex]]
"""Ends of surfaces, by their names."""


def row(
    camera: complex,
    surfaces: Surfaces,
    *,
    direction: float = 0.0,
    field_of_view: float = 2.0,
    grazing: float = 0.0,
    absent: complex = 0j,
) -> np.ndarray:
    """One scene; surfaces that are not named lie at one place and have no length."""
    places = [place for name in NAMES for place in surfaces.get(name, (absent, absent))]
    flat = np.array([*places, camera], complex).view(float)
    return np.concatenate([flat, [direction, field_of_view], np.full(PADS, grazing)])


def stacked(rows: Iterable[np.ndarray]) -> np.ndarray:
    """Rows of several scenes."""
    return np.stack(list(rows))


def direct(scene: ExactScene, *spans: tuple[Any, Any], pad: int = 0) -> list[Piece]:
    """What is seen of a pad without a mirror."""
    return [Piece((), scene.camera, mpmath.mpf(a), mpmath.mpf(b), pad) for a, b in spans]


def between(scene: ExactScene, name: str) -> list[Any]:
    """Pad coordinates behind the ends of a surface, in their order on it."""
    return [met(scene["p0"], scene.camera, end) for end in scene[name]]


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
