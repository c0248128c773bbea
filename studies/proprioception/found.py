"""Everything that the study measured."""

from __future__ import annotations

from dataclasses import dataclass

from designopt.study.results import PrecisionRow
from perception.proprioception import GapTable
from studies.models.sensor.finger_sensor import FingerSensor
from studies.proprioception.ladder import Answer, Climbed
from studies.proprioception.watching import Watched


@dataclass(frozen=True)
class Found:
    """Everything that was measured.

    Attributes:
        finger: as designed.
        tables: the gap of every joint.
        watched: all made fingers and their frames.
        climbed: the ladder on each of them.
        gap_alone: the gap on corners with a stated noise.
        smooth: answers of the labelled calibration on fingers with smooth edges.
        rows: error against run time.
    """

    finger: FingerSensor
    tables: list[GapTable]
    watched: list[Watched]
    climbed: list[Climbed]
    gap_alone: list[Answer]
    smooth: list[Answer]
    rows: list[PrecisionRow]

    @property
    def answers(self) -> list[Answer]:
        """All answers of the ladder."""
        return [answer for one in self.climbed for answer in one.answers]
