"""Everything that the study measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, UInt8

from perception.posture import TrainingRecord
from studies.object_size.grasp import Hand
from studies.object_size.trials import Measured


@dataclass(frozen=True)
class Curve:
    """Diameter over bend, with every bottle in its place.

    Attributes:
        diameters: evenly from the least to the largest that is measured, mm.
        bends: of the finger around them, in radians.
        arcs: where along the finger they touch it, mm.
        slopes: derivative of the diameter by the bend, mm per degree.
        monotone: whether the diameter falls with every bend between.
    """

    diameters: Float[np.ndarray, " places"]
    bends: Float[np.ndarray, " places"]
    arcs: Float[np.ndarray, " places"]
    slopes: Float[np.ndarray, " places"]
    monotone: bool


@dataclass(frozen=True)
class Shown:
    """A bottle in its place, for the report.

    Attributes:
        diameter: mm.
        bend: of the finger, in radians.
        arc: where along it the bottle touches, mm.
        pixels: what the camera sees.
        boundary: as the network takes it.
    """

    diameter: float
    bend: float
    arc: float
    pixels: UInt8[np.ndarray, "rows columns 3"]
    boundary: Float32[np.ndarray, "_rows _columns"]


@dataclass(frozen=True)
class Found:
    """What the study measures.

    Attributes:
        hand: with a bottle in its place.
        curve: diameter over bend.
        record: of the network's training.
        usable: samples that it was trained on.
        bottles: grasps of the bottles that are told apart.
        random: grasps of bottles of random diameters.
        shown: pictures.
        seconds: from one picture to a diameter, on one core.
    """

    hand: Hand
    curve: Curve
    record: TrainingRecord
    usable: int
    bottles: Measured
    random: Measured
    shown: list[Shown]
    seconds: float

    @property
    def grasps(self) -> list[Measured]:
        """All of them."""
        return [self.bottles, self.random]
