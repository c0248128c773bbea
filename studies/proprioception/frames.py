"""Frames of fingers with sampled fabrication errors: random ones, and some with labels."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from optics.rendering import Effects
from perception.detection import detect_views
from perception.matching import Sighting
from perception.proprioception import GapTable
from studies.models.one_thread import one_thread
from studies.models.sensor.finger_sensor import FingerSensor

INSET = 0.1
"""Labelled frames keep away from the ends of a range by this part of it."""


@dataclass(frozen=True)
class Frames:
    """Frames of one finger.

    Attributes:
        angles: the true joint angles, rad.
        sightings: what was found in them.
        seconds: of finding it, for each frame.
    """

    angles: Float[np.ndarray, "frames joints"]
    sightings: list[Sighting]
    seconds: list[float]


@dataclass(frozen=True)
class FingerFrames:
    """One finger with sampled errors, and its frames.

    Attributes:
        number: of the finger.
        errors: of the finger, in units of their deviations.
        frames: whose angles are to be found.
        spread: labelled frames spread over the whole range of both joints.
        in_gap: labelled frames in which both joints have a gap.
        spread_labels: stated angles of the former, rad, with their errors.
        gap_labels: stated angles of the latter, rad.
    """

    number: int
    errors: Float[np.ndarray, " errors"]
    frames: Frames
    spread: Frames
    in_gap: Frames
    spread_labels: Float[np.ndarray, "frames joints"]
    gap_labels: Float[np.ndarray, "frames joints"]


def render_finger(
    finger: FingerSensor,
    gaps: list[GapTable],
    effects: Effects,
    *,
    number: int,
    seed: int,
    frames: int,
    labelled: int,
    label_deviation: float,
    range_deg: float,
) -> FingerFrames:
    """Render one finger in random poses and in those that are labelled.

    Args:
        finger: as designed.
        gaps: the gap of every joint.
        effects: what makes images worse.
        number: which of many fingers.
        seed: of all of them.
        frames: number of random frames.
        labelled: number of labelled ones, of both kinds.
        label_deviation: of the labels, rad.
        range_deg: range of both joints.
    """
    fabrication, errors = finger.made(seed, number)
    renderer = finger.renderer(effects, fabrication, seed=seed + number)
    generator = np.random.default_rng([seed, 7, number])
    top, joints = np.deg2rad(range_deg), len(finger.model.names)
    limits = [(float(table.angles[0]), float(table.angles[-1])) for table in gaps]
    sets = (
        generator.uniform(0, top, (frames, joints)),
        spread_angles([(0.0, top)] * joints, labelled),
        spread_angles(limits, labelled),
    )
    # What is compiled on the way is no part of a frame's time.
    detect_views(renderer.render(sets[0][0]).pixels, finger.lens, finger.catalog)
    made, first = [], 0
    for angles in sets:
        found, seconds = [], []
        for frame, pose in enumerate(angles, start=first):
            image = renderer.render(pose, frame=frame)
            with one_thread():
                start = time.perf_counter()
                found.append(detect_views(image.pixels, finger.lens, finger.catalog))
                seconds.append(time.perf_counter() - start)
        made.append(Frames(angles, found, seconds))
        first += len(angles)
    noise = np.random.default_rng([seed, 8, number]).standard_normal((2, *sets[1].shape))
    labels = np.stack(sets[1:]) + label_deviation * noise
    return FingerFrames(number, errors, *made, *labels)


def spread_angles(
    limits: list[tuple[float, float]], count: int
) -> Float[np.ndarray, "count joints"]:
    """Evenly spread values of every joint, the second one's in another order than the first's."""
    columns = []
    for joint, (low, high) in enumerate(limits):
        inset = INSET * (high - low)
        values = np.linspace(low + inset, high - inset, count)
        # A step that has no common factor with the count visits all values.
        step = next(s for s in range(count // 2 + joint, 2 * count) if np.gcd(s, count) == 1)
        columns.append(values[(np.arange(count) * (step if joint else 1)) % count])
    return np.stack(columns, axis=-1)
