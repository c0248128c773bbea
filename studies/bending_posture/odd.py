"""From hardly bent to far, and frames that are no proper images: each has an answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.chamber import ChamberStatus
from perception.posture import PostureEstimator, compute_marker_errors, find_posture
from studies.models.soft_finger.finger import DOWN, SoftFinger, looked_at
from studies.models.soft_finger.odd import Kind, odd_pictures
from studies.models.soft_finger.samples import marker_places

BENDS_DEG = (0.01, 0.1, 1.0, 10.0, 30.0, 60.0, 90.0, 110.0, 120.0)

ODD_BENDS_DEG = (10.0, 25.0, 50.0)
"""Yellow is in view at all of them."""


@dataclass(frozen=True)
class AtBend:
    """Tip errors at one bend.

    Attributes:
        bend_deg: the bend.
        errors: mm; NaN for a frame that was called no chamber.
    """

    bend_deg: float
    errors: Float[np.ndarray, " frames"]

    @property
    def known(self) -> Float[np.ndarray, " answered"]:
        """Errors of frames with an answer, mm."""
        return self.errors[np.isfinite(self.errors)]


@dataclass(frozen=True)
class Odd:
    """What was said of one odd frame.

    Attributes:
        kind: what is odd.
        status: what was answered of the chamber; None after an exception.
        answered: whether a posture was given.
    """

    kind: Kind
    status: ChamberStatus | None
    answered: bool

    @property
    def failed(self) -> bool:
        """Whether the answer is not the defined one."""
        return self.status is not self.kind.status or self.answered is not self.kind.usable


def over_bends(
    finger: SoftFinger, estimator: PostureEstimator, images: int, seed: int
) -> list[AtBend]:
    """Tip errors from 0.01° to 120°, in frames with all effects."""
    bends = np.repeat(np.deg2rad(BENDS_DEG), images)
    postures = finger.postures(bends, np.full(len(bends), DOWN))
    found = looked_at(
        finger.renderer(seed), postures, lambda _, image: find_posture(image.pixels, estimator)
    )
    nothing = np.full((3, 2), np.nan)
    markers = np.stack([nothing if one.markers is None else one.markers for one in found])
    errors = compute_marker_errors(markers, marker_places(bends, finger.length))[:, -1]
    return [
        AtBend(bend, some) for bend, some in zip(BENDS_DEG, errors.reshape(-1, images), strict=True)
    ]


def odd_frames(finger: SoftFinger, estimator: PostureEstimator, seed: int) -> list[Odd]:
    """Frames of every kind, at a few bends."""
    bends = np.deg2rad(ODD_BENDS_DEG)
    postures = finger.postures(bends, np.full(len(bends), DOWN))
    found: list[Odd] = []
    for kind, _, picture in odd_pictures(finger, postures, seed):
        # Whatever is raised is a fault of perception, and is counted as one.
        try:
            seen = find_posture(picture, estimator)
        except Exception:
            found.append(Odd(kind, None, answered=False))
        else:
            found.append(Odd(kind, seen.status, seen.markers is not None))
    return found
