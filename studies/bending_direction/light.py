"""Frames in the light of a lamp at the lens: path-traced by an oracle, and rendered beside them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from designopt.study.records import Records
from optics.chamber import compute_wall_radii
from optics.rendering import ChamberEffects, ChamberRenderer
from perception import chamber
from perception.chamber import Direction, Points, Region
from studies.bending_direction.frames import TOWARDS, judge
from studies.models.soft_finger.finger import SoftFinger
from studies.oracles.chamber_light import Frame, expose, trace_once

FOLDER = "bending-direction"
"""Of path-traced frames, in the user's cache."""

WALLS: dict[str, dict[str, Any]] = {
    "matt": {},
    "matt, dust": {"dust": 40},
    "glossy": {"coat": 1.41, "roughness": 0.1},
    "wet, dust": {"coat": 1.41, "roughness": 0.03, "dust": 40},
}
"""Kinds of walls: the coat is silicone's, the dust that of grains of 0.1 mm."""

EXPOSURES = {"linear": (0.9, 1.0), "overexposed": (2.0, 1.0), "for screens": (0.9, 2.2)}
"""Level of the brightest pixels but a hundredth, part of full scale, and the response's gamma."""

LEAST_DEG = 5.0
"""Bend from which on a direction is to be decided, in the light of a lamp."""

GAIN = 0.5
"""Of rendered frames in this light: red near the lens is four times as bright as at B."""


def frame_of(finger: SoftFinger, **changed: Any) -> Frame:
    """The chamber of a finger in plain numbers, straight and matt but for what is changed."""
    own, camera = finger.chamber, finger.endoscope
    a, b, c, d = compute_wall_radii(own).tolist()
    return Frame(
        lengths=(float(own.length_ab), float(own.length_bc), float(own.length_cd)),
        radii=(a, b, c, d),
        pinhole=float(own.pinhole_offset),
        field_of_view=float(camera.field_of_view),
        distortion=float(camera.distortion),
        columns=camera.columns,
        rows=camera.rows,
        **changed,
    )


def exposed(
    light: Float[np.ndarray, "rows columns 3"], name: str
) -> UInt8[np.ndarray, "rows columns 3"]:
    """A picture of traced light by one of `EXPOSURES`."""
    level, gamma = EXPOSURES[name]
    return expose(light, level / np.percentile(light.max(axis=-1), 99), gamma)


def find_points(picture: UInt8[np.ndarray, "rows columns 3"]) -> tuple[Points, str]:
    """Points of a picture, and the chamber's status in words."""
    regions = chamber.find_regions(picture)
    return chamber.find_points(picture, regions), regions.status.name.lower()


def bends_deg(count: int, largest_deg: float) -> Float[np.ndarray, " bends"]:
    """Bends of traced frames, from a small one to the largest, each twice as far or more."""
    return np.geomspace(min(2 * LEAST_DEG, largest_deg), largest_deg, count)


class Case(NamedTuple):
    """A path-traced frame, and the direction to which the finger bends in it."""

    truth: Direction
    bend_deg: float
    frame: Frame


def traced_cases(
    finger: SoftFinger, bends: Float[np.ndarray, " bends"], scatter_deg: float, seed: int
) -> dict[str, list[Case]]:
    """Frames of every kind of wall: the straight finger, then all bends in every direction."""
    random, cases = np.random.default_rng([seed, 5]), {}
    for number, (walls, coat) in enumerate(WALLS.items()):
        straight = frame_of(finger, seed=1000 * seed + number, **coat)
        cases[walls] = [Case(Direction.INITIAL, 0.0, straight)]
        for truth, towards in TOWARDS.items():
            for bend in bends.tolist():
                direction = towards + math.radians(scatter_deg * random.standard_normal())
                own = dataclasses.replace(
                    straight, bend=math.radians(bend), direction=float(direction)
                )
                cases[walls].append(Case(truth, bend, own))
    return cases


def answer_traced(cases: dict[str, list[Case]], threshold: float, folder: Path) -> Records:
    """Answers to path-traced frames of all kinds of walls, directions and exposures.

    Returns:
        ``walls``, ``exposure``, ``direction``, ``bend_deg``, ``answer``, ``status`` and the columns
        of `judge`.
    """
    rows = Records()
    for walls, (straight, *bent) in cases.items():
        light = trace_once(straight.frame, folder)
        initial = {name: find_points(exposed(light, name))[0] for name in EXPOSURES}
        for case in bent:
            light = trace_once(case.frame, folder)
            for name, start in initial.items():
                answer, status = _answer(exposed(light, name), start, threshold)
                rows.add(
                    walls=walls, exposure=name, direction=case.truth.name.lower(),
                    bend_deg=case.bend_deg, answer=answer, status=status,
                )  # fmt: skip
    return judge(rows)


def answer_real(
    finger: SoftFinger,
    images: int,
    largest_deg: float,
    threshold: float,
    scatter_deg: float,
    seed: int,
) -> Records:
    """The same for rendered frames in the light of a lamp, with gloss and dust.

    Every direction is an experiment of its own; pictures are not kept.
    """
    rows = Records()
    for number, (truth, towards) in enumerate(TOWARDS.items()):
        random = np.random.default_rng([seed, 6, number])
        bends = random.uniform(LEAST_DEG, largest_deg, images)
        directions = towards + np.deg2rad(scatter_deg * random.standard_normal(images))
        renderer = finger.renderer((seed, 6, number), gain=GAIN, real=True)
        straight = renderer.render(finger.postures(np.zeros(1), np.zeros(1)), images)[0]
        initial, _ = find_points(straight.pixels)
        for start in range(0, images, BLOCK):
            some = np.s_[start : start + BLOCK]
            postures = finger.postures(np.deg2rad(bends[some]), directions[some])
            pictures = renderer.render(postures, start)
            found = [_answer(one.pixels, initial, threshold) for one in pictures]
            answers, statuses = zip(*found, strict=True)
            rows.add(
                direction=truth.name.lower(), bend_deg=bends[some], answer=list(answers),
                status=list(statuses),
            )  # fmt: skip
    return judge(rows)


BLOCK = 32
"""Pictures that are kept at a time."""


def _answer(
    picture: UInt8[np.ndarray, "rows columns 3"], initial: Points, threshold: float
) -> tuple[str, str]:
    points, status = find_points(picture)
    found = chamber.estimate_bending_direction(points, initial, threshold=threshold, use="all")
    return found.name.lower(), status


def compare_falloff(finger: SoftFinger, traced: Frame, folder: Path) -> Mapping[str, float]:
    """How much brighter red is than yellow, in the straight finger with matt walls.

    Args:
        finger: its chamber and camera.
        traced: the same as the path tracer has it.
        folder: of traced frames.

    Returns:
        ``traced``, ``rendered`` in the light of a lamp, and ``power``, rendered in that of the
        renderer's usual power: means over each region of its brightest channel.
    """
    straight = finger.postures(np.zeros(1), np.zeros(1))
    ratios, labels = {}, None
    for name, effects in (
        ("rendered", ChamberEffects(lamp=1.0, gain=0.25)),
        ("power", ChamberEffects(gain=0.7)),
    ):
        renderer = ChamberRenderer(finger.chamber, finger.endoscope, effects)
        [image] = renderer.render(straight)
        if labels is None:
            labels = chamber.find_regions(image.pixels).labels
        ratios[name] = red_over_yellow(image.pixels, labels)
    assert labels is not None  # by the first of them
    ratios["traced"] = red_over_yellow(trace_once(traced, folder), labels)
    return ratios


def red_over_yellow(picture: np.ndarray, labels: np.ndarray) -> float:
    """Ratio of the mean brightest channels of what is labelled red and yellow."""
    value = picture.max(axis=-1).astype(float)
    red, yellow = (value[labels == region].mean() for region in (Region.RED, Region.YELLOW))
    return float(red / yellow)
