"""Lamps and fingers that the network was not trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.posture import PostureEstimator, compute_marker_errors
from studies.bending_posture.spec import BendingPostureSpec
from studies.bending_posture.trainings import size_of
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.samples import random_postures, samples
from studies.models.soft_finger.spec import MadeSpec

LAMP, MADE, BOTH = "another lamp", "finger as made", "both"
"""What is other than in training."""

DRAWS, FRAMES = 10, 20
"""Lamps or fingers, and frames of each."""

STREAM, LAMPS, FIRST = 8, 100, 1_000_000
"""Of random numbers; added to the seed for another lamp; number of the first frame."""


@dataclass(frozen=True)
class Elsewhere:
    """Tip errors where something is other than in training.

    Attributes:
        other: what it is.
        frames: number of frames.
        errors: mm, of every network, for every lamp or finger; unusable frames are left out.
    """

    other: str
    frames: int
    errors: list[Float[np.ndarray, "networks _"]]

    @property
    def usable(self) -> int:
        """Frames with an answer."""
        return sum(one.shape[1] for one in self.errors)

    @property
    def known(self) -> Float[np.ndarray, " errors"]:
        """Errors of all networks on all usable frames, mm."""
        return np.concatenate([one.ravel() for one in self.errors])

    @property
    def mean(self) -> float:
        """Mean error, mm; NaN if no frame is usable."""
        return float(self.known.mean()) if self.usable else float("nan")

    @property
    def worst(self) -> float:
        """Mean error of the lamp or finger where it is largest, mm; NaN if no frame is usable."""
        return max((float(one.mean()) for one in self.errors if one.size), default=float("nan"))


def elsewhere(
    spec: BendingPostureSpec,
    finger: SoftFinger,
    networks: Sequence[PostureEstimator],
    seed: int,
) -> list[Elsewhere]:
    """The same random postures with all effects, under other lamps and in other fingers."""
    return [
        Elsewhere(
            other,
            DRAWS * FRAMES,
            [_errors(spec, finger, networks, seed, draw, other) for draw in range(DRAWS)],
        )
        for other in (LAMP, MADE, BOTH)
    ]


def _errors(
    spec: BendingPostureSpec,
    finger: SoftFinger,
    networks: Sequence[PostureEstimator],
    seed: int,
    draw: int,
    other: str,
) -> Float[np.ndarray, "networks _"]:
    lamp = seed if other == MADE else seed + LAMPS + draw
    if other != LAMP:
        finger = finger.made(MadeSpec(), np.random.default_rng([seed, STREAM, draw, 1]))
    generator = np.random.default_rng([seed, STREAM, draw, 0])
    bends = np.deg2rad(generator.uniform(0, spec.largest_bend_deg, FRAMES))
    size = size_of(spec.width)
    postures = random_postures(finger, bends, generator)
    seen = samples(finger, postures, (size,), seed=lamp, first=FIRST + FRAMES * draw)
    # All frames are read, so that one program serves every finger.
    errors = [
        compute_marker_errors(network.predict(seen.images[size]), seen.markers)[:, -1]
        for network in networks
    ]
    return np.stack(errors)[:, seen.usable]
