"""Everything that the study measures."""

from __future__ import annotations

from dataclasses import dataclass

from designopt.study.results import PrecisionRow
from optics.rendering import ChamberImage
from perception.chamber import Points
from perception.chamber.directions import Use
from studies.bending_direction.design import Design
from studies.bending_direction.frames import Series
from studies.bending_direction.odd import AtBend, Odd

USES: tuple[Use, ...] = ("blue", "all", "centre")
"""The points that Algorithm 1 may use; the first is the paper's choice."""


@dataclass(frozen=True)
class Shown:
    """A picture for the report, with what was found on it."""

    title: str
    image: ChamberImage
    points: Points


@dataclass(frozen=True)
class Found:
    """What the study measures.

    Attributes:
        series: random images, by direction.
        curves: bending evenly from nothing to far, by direction.
        designs: the study's chamber, with each knob of the best one alone, then the best one.
        held_by: the limits that hold the best one, in words.
        small: images at small bends, by direction, of each of the designs; their shake, noise
            and bends are the same.
        bends: answers from 0.01° to 120°.
        odd: frames that are no proper images.
        rows: outlines of pictures, error against run time.
        seconds: of regions and points of one frame, on one core.
        shown: pictures.
    """

    series: list[Series]
    curves: list[Series]
    designs: list[Design]
    held_by: list[str]
    small: list[list[Series]]
    bends: list[AtBend]
    odd: list[Odd]
    rows: list[PrecisionRow]
    seconds: float
    shown: list[Shown]
