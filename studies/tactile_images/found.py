"""Everything that the study measured."""

from __future__ import annotations

from dataclasses import dataclass

from designopt.study.results import PrecisionRow
from studies.models.sensor.finger_sensor import FingerSensor
from studies.tactile_images.corrupted import Trial
from studies.tactile_images.frames import Frame
from studies.tactile_images.pictures import Shown
from studies.tactile_images.rendering import EffectTime

OURS, PAPER = "lines in ray space", "paper's polygon"
"""Both ways to corners."""


@dataclass(frozen=True)
class Found:
    """Everything that was measured.

    Attributes:
        frames: all frames of one severity and gain each, analysed.
        independent: frames whose effects have severities independent of each other, likewise.
        trials: corrupted frames.
        rows: error against run time.
        times: of rendering, effect by effect.
        finger: as designed.
        shown: what the figures show.
    """

    frames: list[Frame]
    independent: list[Frame]
    trials: list[Trial]
    rows: list[PrecisionRow]
    times: list[EffectTime]
    finger: FingerSensor
    shown: Shown
