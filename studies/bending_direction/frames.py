"""Images of a bending finger, and which direction is estimated from each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from designopt.study.records import Records
from optics.rendering import ChamberImage, ChamberRenderer
from perception import chamber
from perception.chamber import Direction, Points
from perception.chamber.directions import Use
from studies.models.soft_finger.finger import SoftFinger, looked_at

TOWARDS = {
    Direction.UP: -math.pi / 2,
    Direction.DOWN: math.pi / 2,
    Direction.LEFT: math.pi,
    Direction.RIGHT: 0.0,
}
"""Angles of the directions in the image, y down."""

USES: tuple[Use, ...] = ("blue", "all", "centre")
"""The points that Algorithm 1 may use; the first is the paper's choice."""

UNDECIDED = ("initial", "undefined")
"""Answers that name no direction: not bent, or no chamber in view."""

INITIAL_FRAME = 10**9
"""Number of the frame of the finger before it bends."""


class Frame(NamedTuple):
    """What is found in one frame.

    Attributes:
        points: the seven.
        areas: of what is blue and of what is yellow, px.
    """

    points: Points
    areas: tuple[int, int]


@dataclass(frozen=True)
class Series:
    """Frames of one direction.

    Attributes:
        truth: the direction.
        bends_deg: degrees.
        frames: one per bend.
        initial: points of the finger before it bent.
    """

    truth: Direction
    bends_deg: Float[np.ndarray, " frames"]
    frames: Sequence[Frame]
    initial: Points

    @property
    def name(self) -> str:
        """Of the direction."""
        return self.truth.name.lower()

    def estimate(self, thresholds: Sequence[float], uses: Sequence[Use] = USES) -> Records:
        """The answers of Algorithm 1 to every frame, with every threshold and set of points.

        Args:
            thresholds: a largest displacement below it counts as not bent, px.
            uses: sets of points.

        Returns:
            ``direction``, ``points``, ``threshold_px``, ``bend_deg``, ``answer`` (a direction's
            name), and the columns of `judge`.
        """
        rows = Records()
        for use in uses:
            for threshold in dict.fromkeys(thresholds):
                how = {"threshold": threshold, "use": use}
                answers = [
                    chamber.estimate_bending_direction(one.points, self.initial, **how).name.lower()
                    for one in self.frames
                ]
                names = {"direction": self.name, "points": use, "threshold_px": threshold}
                rows.add(**names, bend_deg=self.bends_deg, answer=answers)
        return judge(rows)


def judge(rows: Records) -> Records:
    """Answers with whether each is ``right``, ``undecided`` (names no direction) or ``wrong``."""
    right = rows["answer"] == rows["direction"]
    undecided = np.isin(rows["answer"], np.array(UNDECIDED, object))
    return rows | {"right": right, "undecided": undecided, "wrong": ~right & ~undecided}


def analyze(_: int, image: ChamberImage) -> Frame:
    """Regions and points of one picture."""
    regions = chamber.find_regions(image.pixels)
    blue, yellow = (int(np.count_nonzero(regions.labels == region)) for region in (2, 3))
    return Frame(chamber.find_points(image.pixels, regions), (blue, yellow))


def before_bending(renderer: ChamberRenderer, finger: SoftFinger) -> Points:
    """Points of the straight finger, in a frame with its own shake and noise."""
    straight = finger.postures(np.zeros(1), np.zeros(1))
    return looked_at(renderer, straight, analyze, INITIAL_FRAME)[0].points


def render_series(
    finger: SoftFinger,
    truth: Direction,
    bends_deg: Float[np.ndarray, " frames"],
    scatter_deg: Float[np.ndarray, " frames"] | float = 0.0,
    *,
    seed: int | Sequence[int],
    first: int = 0,
    severity: float | None = None,
) -> Series:
    """Frames of a finger that bends in one direction.

    Args:
        finger: its chamber and camera.
        truth: the direction.
        bends_deg: degrees.
        scatter_deg: by which angles each was bent beside the direction, degrees.
        seed: of the pictures.
        first: number of the first picture.
        severity: of the pictures; by default the finger's.
    """
    renderer = finger.renderer(seed, severity=severity)
    postures = finger.postures(np.deg2rad(bends_deg), TOWARDS[truth] + np.deg2rad(scatter_deg))
    frames = looked_at(renderer, postures, analyze, first)
    return Series(truth, bends_deg, frames, before_bending(renderer, finger))
