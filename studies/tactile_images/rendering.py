"""What each effect costs when an image is rendered: one that is off costs nothing."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass, fields, replace

import numpy as np

from optics.rendering import Effects
from studies.models.sensor.finger_sensor import FingerSensor

REPEATS = 5


@dataclass(frozen=True)
class EffectTime:
    """Rendering with one effect alone.

    Attributes:
        effect: its name; ``none`` or ``all``.
        seconds: for one frame.
    """

    effect: str
    seconds: float


def effect_times(finger: FingerSensor, severity: float, seed: int) -> list[EffectTime]:
    """Time for one frame without any effect, with each alone, and with all."""
    every = replace(Effects.graded(severity or 1.0), gain=1.2)
    cases = {"none": Effects()}
    for field in fields(Effects):
        cases[field.name] = replace(Effects(), **{field.name: getattr(every, field.name)})
    cases["all"] = every
    times = []
    for name, effects in cases.items():
        renderer = finger.renderer(effects, finger.made(seed, 0)[0], seed)
        pose = np.full(len(finger.model.names), np.pi / 4)
        renderer.render(pose)
        samples = []
        for frame in range(REPEATS):
            start = time.perf_counter()
            renderer.render(pose, frame=frame)
            samples.append(time.perf_counter() - start)
        times.append(EffectTime(name, statistics.median(samples)))
    return times
