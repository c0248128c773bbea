"""From hardly bent to far too far, and frames that are no proper images: each has an answer."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Literal

import numpy as np

from perception.chamber import (
    ChamberStatus,
    Direction,
    Points,
    estimate_bending_direction,
    find_points,
    find_regions,
)
from studies.bending_direction.frames import TOWARDS, Series, before_bending, series
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.odd import Kind, Picture, odd_pictures

BENDS_DEG = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 60.0, 90.0, 120.0)

ODD_BEND_DEG = 25.0
"""Bend of the finger in odd frames, far enough to be decided where anything is."""


@dataclass(frozen=True)
class Odd:
    """One odd frame and what came out.

    Attributes:
        kind: what is odd, and what is to be answered.
        truth: the direction.
        status: what was answered of the chamber.
        direction: what was answered of the direction; None after an exception.
    """

    kind: Kind
    truth: Direction
    status: ChamberStatus | None
    direction: Direction | None

    @property
    def failed(self) -> bool:
        """Whether the answer is not the defined one."""
        if self.status is not self.kind.status:
            return True
        return self.direction is not (self.truth if self.kind.in_view else Direction.UNDEFINED)


def odd_frames(finger: SoftFinger, threshold: float, seed: int) -> list[Odd]:
    """One frame of every kind in every direction, answered with a threshold, px."""
    truths = list(TOWARDS)
    bends = np.full(len(truths), np.deg2rad(ODD_BEND_DEG))
    postures = finger.postures(bends, np.array([TOWARDS[truth] for truth in truths]))
    initial = before_bending(finger.renderer(seed), finger)
    return [
        Odd(kind, truths[i], *_answer(picture, initial, threshold))
        for kind, i, picture in odd_pictures(finger, postures, seed)
    ]


def _answer(
    picture: Picture, initial: Points, threshold: float
) -> tuple[ChamberStatus | None, Direction | None]:
    # Whatever is raised is a fault of perception, and is counted as one.
    try:
        regions = find_regions(picture)
        return regions.status, estimate_bending_direction(
            find_points(picture, regions), initial, threshold=threshold, use="all"
        )
    except Exception:
        return None, None


@dataclass(frozen=True)
class AtBend:
    """Answers at one bend, over all directions.

    Attributes:
        images: which images these are.
        bend_deg: the bend.
        threshold: px.
        answers: how often the true direction, "not bent", a wrong one and none was answered.
    """

    images: Literal["perfect", "with all effects"]
    bend_deg: float
    threshold: float
    answers: Counter[str]


def over_bends(
    finger: SoftFinger, images: int, threshold: float, seed: int, *, perfect: bool = False
) -> list[AtBend]:
    """What is answered from 0.01° to 120° of bend, straight towards every direction.

    Args:
        finger: its chamber and camera.
        images: at every bend in every direction.
        threshold: a largest displacement below it counts as not bent, px; without and with it.
        seed: of the pictures.
        perfect: whether the pictures are, in place of the finger's own.
    """
    bends = np.repeat(np.deg2rad(BENDS_DEG), images)
    thresholds = (0.0,) if perfect else tuple(dict.fromkeys((0.0, threshold)))
    counts = {(least, bend): Counter[str]() for least in thresholds for bend in BENDS_DEG}
    for number, truth in enumerate(TOWARDS):
        frames = series(
            finger, truth, bends, np.zeros(len(bends)), seed=seed, first=number * len(bends),
            severity=0.0 if perfect else None,
        )  # fmt: skip
        for least in thresholds:
            for i, answer in enumerate(frames.tally(least, "all").answers):
                counts[least, BENDS_DEG[i // images]][_word(answer, frames)] += 1
    kind = "perfect" if perfect else "with all effects"
    return [AtBend(kind, bend, least, count) for (least, bend), count in counts.items()]


def _word(answer: Direction, frames: Series) -> str:
    if answer is frames.truth:
        return "right"
    words = {Direction.INITIAL: "not bent", Direction.UNDEFINED: "undefined"}
    return words.get(answer, "wrong")
