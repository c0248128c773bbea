"""Frames of fingers with sampled fabrication errors: random ones, and some with labels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from jaxtyping import Float

from optics.rendering import Effects
from perception.matching import Sighting
from perception.proprioception import GapTable
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.poses import spread_angles
from studies.proprioception import ProprioceptionSpec


@dataclass(frozen=True)
class Frames:
    """Frames of one finger.

    Attributes:
        angles: the true joint angles, rad.
        sightings: what was found in them.
        seconds: of finding it, for each frame.
        labels: stated joint angles, rad, where they have any: the true ones with errors.
    """

    angles: Float[np.ndarray, "frames joints"]
    sightings: list[Sighting]
    seconds: list[float]
    labels: Float[np.ndarray, "frames joints"]


@dataclass(frozen=True)
class FingerFrames:
    """One finger with sampled errors, and its frames.

    Attributes:
        number: of the finger.
        errors: of the finger, in units of their deviations.
        frames: whose angles are to be found; their labels have no errors.
        spread: labelled frames spread over the whole range of both joints.
        in_gap: labelled frames in which both joints have a gap.
    """

    number: int
    errors: Float[np.ndarray, " errors"]
    frames: Frames
    spread: Frames
    in_gap: Frames


def render_finger(
    finger: FingerSensor,
    gaps: list[GapTable],
    spec: ProprioceptionSpec,
    number: int,
    seed: int,
    *,
    smooth: bool = False,
) -> FingerFrames:
    """Render one finger in random poses and in those that are labelled.

    Args:
        finger: as designed.
        gaps: the gap of every joint.
        spec: numbers of frames, what makes images worse, the labels' deviation.
        number: which of many fingers.
        seed: of all of them.
        smooth: without rough edges and round corners.
    """
    effects = Effects.graded(spec.severity)
    effects = replace(effects, roughness=0.0, rounding=0.0) if smooth else effects
    generator, joints = np.random.default_rng([seed, 7, number]), len(finger.model.names)
    top = math.radians(spec.range_deg)
    sets = [
        generator.uniform(0, top, (spec.frames, joints)),
        spread_angles([(0.0, top)] * joints, spec.labelled),
        spread_angles(ranges(gaps), spec.labelled),
    ]
    noise = np.random.default_rng([seed, 8, number]).standard_normal((2, *sets[1].shape))
    off = [np.zeros(joints), *(math.radians(spec.label_deviation_deg) * noise)]
    renderer = finger.made_renderer(effects, seed, number)
    shots = finger.film(renderer, np.concatenate(sets))
    made = []
    for angles, wrong in zip(sets, off, strict=True):
        found = [(sighting, seconds) for _, sighting, seconds in islice(shots, len(angles))]
        sightings, seconds = map(list, zip(*found, strict=True))
        made.append(Frames(angles, sightings, seconds, angles + wrong))
    return FingerFrames(number, finger.made(seed, number)[1], *made)


def ranges(gaps: list[GapTable]) -> list[tuple[float, float]]:
    """From where to where every joint has a gap, rad."""
    return [(float(table.angles[0]), float(table.angles[-1])) for table in gaps]
