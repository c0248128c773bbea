"""From hardly bent to far, and frames that are no proper images: each has a defined answer."""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from perception.chamber import ChamberStatus
from perception.posture import USABLE, find_posture
from studies.models.soft_finger.finger import DOWN, SoftFinger, looked_at
from studies.models.soft_finger.odd import Kind, Picture, odd_pictures
from studies.object_size.estimates import Reader, estimated
from studies.object_size.grasp import diameter_of

BENDS_DEG = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 60.0, 90.0, 110.0, 120.0)

ODD_BENDS_DEG = (10.0, 25.0, 50.0)
"""Yellow is in view at all of them."""


@dataclass(frozen=True)
class Said:
    """What was said of one picture.

    Attributes:
        status: of the chamber; None after an exception.
        diameter: of the bottle, mm; None if it is undefined.
    """

    status: ChamberStatus | None
    diameter: float | None

    @property
    def sound(self) -> bool:
        """Whether nothing was raised, and a diameter is one, and of a chamber that is seen."""
        if self.status is None:
            return False
        if self.diameter is None:
            return True
        return self.status in USABLE and math.isfinite(self.diameter) and self.diameter > 0


@dataclass(frozen=True)
class Odd:
    """One odd frame and what was said of it.

    Attributes:
        kind: what is odd, and the status expected.
        said: what was.
    """

    kind: Kind
    said: Said

    @property
    def failed(self) -> bool:
        """Whether that is not the defined answer.

        Where the chamber is no longer seen there is no diameter. Where it is there is one, or the
        markers lie on no arc, or on one that holds nothing.
        """
        unseen = self.said.diameter is not None and not self.kind.usable
        return self.said.status is not self.kind.status or unseen or not self.said.sound


WITHIN = 5.0
"""How far a diameter may be off the bottle's, mm; more is another answer than the defined one."""


@dataclass(frozen=True)
class AtBend:
    """What was said of a finger at one bend.

    Attributes:
        bend_deg: the bend.
        diameter: of the bottle that a finger so bent holds, mm; None if it holds none.
        said: of every frame.
    """

    bend_deg: float
    diameter: float | None
    said: list[Said]

    @property
    def failures(self) -> int:
        """Frames without the defined answer.

        All show the chamber. A finger that holds nothing has no diameter. One that holds a bottle
        has about that of the bottle, or none: the bend that is read may be off to where it holds
        nothing.
        """
        return sum(
            one.status not in USABLE
            or not one.sound
            or (
                one.diameter is not None
                and (self.diameter is None or abs(one.diameter - self.diameter) > WITHIN)
            )
            for one in self.said
        )


def say(picture: Picture, reader: Reader) -> Said:
    """From a picture to a diameter."""
    seen = find_posture(picture, reader.estimator)
    one = estimated([seen], reader)
    return Said(seen.status, float(one.diameters[0]) if one.known[0] else None)


def over_bends(finger: SoftFinger, reader: Reader, frames: int, seed: int) -> list[AtBend]:
    """From 0.01° to 120°, in frames with all effects."""
    bends = np.repeat(np.deg2rad(BENDS_DEG), frames)
    pictures = looked_at(
        finger.renderer(seed),
        finger.postures(bends, np.full(len(bends), DOWN)),
        lambda _, image: image.pixels,
    )
    said = [_answer(picture, reader) for picture in pictures]
    true = jax.jit(diameter_of)
    found: list[AtBend] = []
    for i, bend in enumerate(BENDS_DEG):
        solved = true(reader.hand, jnp.asarray(np.deg2rad(bend)))
        held = float(solved.value) if bool(solved.ok) else None
        found.append(AtBend(bend, held, said[i * frames : (i + 1) * frames]))
    return found


def odd_frames(finger: SoftFinger, reader: Reader, seed: int) -> list[Odd]:
    """Frames of every kind, at a few bends."""
    bends = np.deg2rad(ODD_BENDS_DEG)
    postures = finger.postures(bends, np.full(len(bends), DOWN))
    return [
        Odd(kind, _answer(picture, reader))
        for kind, _, picture in odd_pictures(finger, postures, seed)
    ]


def _answer(picture: Picture, reader: Reader) -> Said:
    # Whatever is raised is a fault of perception, and is counted as one.
    try:
        return say(picture, reader)
    except Exception:
        return Said(None, None)
