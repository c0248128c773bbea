"""Everything that the study finds, before it is told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from optics.scene.scene import Scene
from studies.finger_mirrors.solvers import Run
from studies.models.finger import Finger
from studies.models.mirror_design.design import MirrorDesign
from studies.models.mirror_design.judging import Square, Verdict
from studies.models.mirror_design.yields import Sensitivity, Yield

START, OPTIMUM, GIVEN = "start", "optimum", "reference layout"


class Case(NamedTuple):
    """A layout of camera and mirrors and what it is worth.

    Attributes:
        name: in tables and figures.
        finger: with its camera and mirrors.
        scene: of it.
        verdict: degree by degree.
        yields: by Monte Carlo.
    """

    name: str
    finger: Finger
    scene: Scene
    verdict: Verdict
    yields: Yield

    @property
    def thickness(self) -> float:
        """Of its body, mm."""
        return float(self.finger.body.thickness)

    @property
    def mirror_lengths(self) -> list[float]:
        """In the order of the mirrors, mm."""
        return [float(mirror.length) for mirror in self.finger.mirrors]


class RayCheck(NamedTuple):
    """Coverage by rays.

    Attributes:
        degrees: PIP and DIP of the postures.
        coverage: of every pad.
    """

    degrees: Float[np.ndarray, "poses 2"]
    coverage: Float[np.ndarray, "poses pads"]


@dataclass(frozen=True)
class Found:
    """Everything.

    Attributes:
        design: the main body's.
        before: the poor start.
        after: the optimum.
        others: the layout that was given, if the body is the one it is for, and the thin body's
            optimum.
        thin: the latter.
        squares: over all pairs of angles: before, and after.
        thin_square: the same for the thin body's optimum.
        checks: by rays, of the optima.
        sensitivity: to each error.
        start_coverages: mean coverage of every start.
        runs: of the solvers; none if they were not compared.
    """

    design: MirrorDesign
    before: Case
    after: Case
    others: Sequence[Case]
    thin: Case | None
    squares: dict[str, Square]
    thin_square: Square | None
    checks: Sequence[tuple[Case, RayCheck]]
    sensitivity: Sensitivity
    start_coverages: Sequence[float]
    runs: Sequence[Run]

    @property
    def cases(self) -> list[Case]:
        """All layouts."""
        return [self.before, self.after, *self.others]
