"""Rays that are shot into a posed scene of the tests, by the oracle that studies use as well."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from studies.oracles.rays import Fans, Structure, find_runs, union


@dataclass(frozen=True)
class Surfaces:
    """Mirrors, then pads, then blockers: ends (n, 2, 2), sides (+1 left, −1 right, 0 both)."""

    ends: np.ndarray
    sides: np.ndarray
    mirrors: int
    pads: int
    grazing: np.ndarray


class Run(NamedTuple):
    """Neighbouring rays that see one pad by one path; pad coordinates."""

    path: tuple[int, ...]
    pad: int
    inner: np.ndarray
    outer: np.ndarray


def shoot(
    surfaces: Surfaces,
    position: np.ndarray,
    direction: float,
    field_of_view: float,
    rays: int,
    bounces: int,
) -> list[Run]:
    """All runs of a fan of rays spread evenly over the field of view."""
    structure = Structure(surfaces.mirrors, surfaces.pads, tuple(surfaces.sides.tolist()))
    parts = (surfaces.ends, position, direction, field_of_view, surfaces.grazing)
    fans = Fans(*(np.asarray(part, float)[None] for part in parts))
    words = structure.words(bounces)
    _, path, pad, inner, outer, _ = find_runs(structure, fans, rays, bounces)
    paths = [words[index] for index in path.tolist()]
    return [Run(*run) for run in zip(paths, pad.tolist(), inner, outer, strict=True)]


def coverage(runs: list[Run], pads: int) -> tuple[np.ndarray, np.ndarray]:
    """Inner and outer bound of the part of each pad that is seen by any path."""
    on = np.array([run.pad for run in runs], int)
    inner, outer = (
        union(np.reshape([getattr(run, side) for run in runs], (-1, 2)), on, pads)
        for side in ("inner", "outer")
    )
    return inner, outer
