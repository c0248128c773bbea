"""Images of a bending finger, and what is answered to each."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from optics.rendering import ChamberImage, ChamberRenderer
from perception.chamber import (
    ChamberStatus,
    Direction,
    Points,
    estimate_bending_direction,
    find_points,
    find_regions,
)
from perception.chamber.directions import Use
from studies.bending_direction.rules import Tally
from studies.models.soft_finger.finger import SoftFinger, looked_at

TOWARDS = {
    Direction.UP: -math.pi / 2,
    Direction.DOWN: math.pi / 2,
    Direction.LEFT: math.pi,
    Direction.RIGHT: 0.0,
}
"""Angles of the directions in the image, y down."""

INITIAL_FRAME = 10**9
"""Number of the frame of the finger before it bends."""


@dataclass(frozen=True)
class Look:
    """What is found in one frame.

    Attributes:
        status: what is seen of the chamber.
        points: the seven.
        areas: of what is blue and of what is yellow, px.
        seconds: that regions and points took.
    """

    status: ChamberStatus
    points: Points
    areas: tuple[int, int]
    seconds: float


@dataclass(frozen=True)
class Series:
    """Frames of one direction.

    Attributes:
        truth: the direction.
        bends: radians.
        looks: one per bend.
        initial: points of the finger before it bent.
    """

    truth: Direction
    bends: Float[np.ndarray, " frames"]
    looks: tuple[Look, ...]
    initial: Points

    def tally(self, threshold: float, use: Use) -> Tally:
        """The answers of Algorithm 1."""
        return Tally(
            self.truth,
            tuple(
                estimate_bending_direction(look.points, self.initial, threshold=threshold, use=use)
                for look in self.looks
            ),
        )


def look_at(_: int, image: ChamberImage) -> Look:
    """Regions and points of one picture."""
    start = time.perf_counter()
    regions = find_regions(image.pixels)
    points = find_points(image.pixels, regions)
    seconds = time.perf_counter() - start
    blue, yellow = (int(np.count_nonzero(regions.labels == region)) for region in (2, 3))
    return Look(regions.status, points, (blue, yellow), seconds)


def before_bending(renderer: ChamberRenderer, finger: SoftFinger) -> Points:
    """Points of the straight finger, in a frame with its own shake and noise."""
    straight = finger.postures(np.zeros(1), np.zeros(1))
    return looked_at(renderer, straight, look_at, INITIAL_FRAME)[0].points


def series(
    finger: SoftFinger,
    truth: Direction,
    bends: Float[np.ndarray, " frames"],
    scatter: Float[np.ndarray, " frames"],
    *,
    seed: int | Sequence[int],
    first: int,
    severity: float | None = None,
) -> Series:
    """Frames of a finger that bends in one direction.

    Args:
        finger: its chamber and camera.
        truth: the direction.
        bends: radians.
        scatter: by which angles each was bent beside the direction, radians.
        seed: of the pictures.
        first: number of the first picture.
        severity: of the pictures; by default the finger's.
    """
    renderer = finger.renderer(seed, severity=severity)
    postures = finger.postures(bends, TOWARDS[truth] + scatter)
    looks = looked_at(renderer, postures, look_at, first)
    return Series(truth, bends, tuple(looks), before_bending(renderer, finger))
