"""Everything that the study measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, UInt8

from perception.posture import TrainingRecord
from studies.object_size.grasp import Hand
from studies.object_size.odd import AtBend, Odd
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
        other_lamp: the same with a lamp that the network was not trained with.
        bends: answers from hardly bent to far.
        odd: frames that are no proper images.
        shown: pictures.
        seconds: from one picture to a diameter.
    """

    hand: Hand
    curve: Curve
    record: TrainingRecord
    usable: int
    bottles: Measured
    random: Measured
    other_lamp: Measured
    bends: list[AtBend]
    odd: list[Odd]
    shown: list[Shown]
    seconds: float

    @property
    def grasps(self) -> list[Measured]:
        """All with the lamp of the training."""
        return [self.bottles, self.random]

    @property
    def odd_failures(self) -> int:
        """Frames without the answer that is defined for them."""
        return sum(one.failed for one in self.odd) + sum(one.failures for one in self.bends)
