"""Disturbed frames of the soft finger, and bends from 0.01° to far: each has a defined answer.

A study gives the function that answers a picture; the sweeps take it through every kind of frame or
every bend, and `summarize_disturbances` counts what was answered otherwise::

    def answer(picture: Picture, kind: Disturbance, number: int) -> Answer:
        found = find_posture(picture, estimator)
        given = found.markers is not None
        return Answer(found.status, given, right=given is kind.usable)


    frames = answer_disturbances(finger, postures, seed, answer)
    out.metrics(odd_failures=frames.stat("sum failed"))
    table = summarize_disturbances(frames)
    expected = np.where(table["usable"], "a posture", "none")
    out.table("odd_frames", table | {"expected": expected, "with_posture": table["given"]})

    bends = Records({"bend_deg": np.repeat(BENDS_DEG, frames_each)})
    found = view_bends(finger, BENDS_DEG, frames_each, look, seed=seed)
    bends |= {"error_mm": [one.error for one in found]}
    out.table("bends", bends.summary("bend_deg", mean_mm="mean error_mm"))
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float, UInt8

from designopt.plot.typesetting import spell_out
from designopt.study.records import Records
from optics.chamber import Posture
from optics.rendering import COLORS, ChamberImage
from perception.chamber import IN_VIEW, ChamberStatus
from perception.posture import USABLE
from studies.models.soft_finger.finger import DOWN, SoftFinger, looked_at

Picture = UInt8[np.ndarray, "rows columns 3"]
Looked = TypeVar("Looked")


def status_words(status: ChamberStatus | None) -> str:
    """The chamber's status in an image in words; "exception" where one was raised."""
    return spell_out(status.name.lower()) if status else "exception"


@dataclass(frozen=True)
class Disturbance:
    """What keeps a frame from being a proper image, and the status that is expected of it.

    Attributes:
        name: what is disturbed.
        status: expected of the chamber.
        gain: of the camera.
        walls: which wall's color the red, the blue and the yellow one and the top have.
        inner: what yellow and the top reflect, over what they do usually.
        change: of the picture.
    """

    name: str
    status: ChamberStatus
    gain: float = 1.0
    walls: tuple[int, int, int, int] = (0, 1, 2, 3)
    inner: float = 1.0
    change: Callable[[Picture], Picture] | None = None

    @property
    def usable(self) -> bool:
        """Whether a posture is to be read all the same."""
        return self.status in USABLE

    @property
    def in_view(self) -> bool:
        """Whether blue's points are to be found all the same."""
        return self.status in IN_VIEW

    @property
    def colors(self) -> Float[np.ndarray, "4 3"]:
        """Of the walls and of the top."""
        return COLORS[list(self.walls)] * np.array([[1], [1], [self.inner], [self.inner]])


def _gray(picture: Picture) -> Picture:
    noise = np.random.default_rng(0).normal(120, 6, picture.shape)
    return np.clip(noise, 0, 255).astype(np.uint8)


def _random(picture: Picture) -> Picture:
    return np.random.default_rng(0).integers(0, 256, picture.shape, np.uint8)


def _speckled(picture: Picture) -> Picture:
    random = np.random.default_rng(0)
    bright = random.choice(np.array([0, 255], np.uint8), picture.shape[:2])
    hit = random.random(picture.shape[:2]) < 0.05
    return np.where(hit[..., None], bright[..., None], picture)


DISTURBANCES = (
    Disturbance("underexposed, gain 0.4", ChamberStatus.CHAMBER, gain=0.4),
    Disturbance("overexposed, gain 2", ChamberStatus.CHAMBER, gain=2.0),
    Disturbance("dark, gain 0.02", ChamberStatus.TOO_DARK, gain=0.02),
    Disturbance("saturated, gain 50", ChamberStatus.TOO_BRIGHT, gain=50.0),
    Disturbance("black", ChamberStatus.TOO_DARK, change=np.zeros_like),
    Disturbance("white", ChamberStatus.TOO_BRIGHT, change=lambda p: np.full_like(p, 255)),
    Disturbance("out of the chamber, grey", ChamberStatus.NO_CHAMBER, change=_gray),
    Disturbance("random pixels", ChamberStatus.NO_CHAMBER, change=_random),
    Disturbance("no blue region", ChamberStatus.NO_CHAMBER, walls=(0, 0, 2, 3)),
    Disturbance("no red region", ChamberStatus.NO_CHAMBER, walls=(1, 1, 2, 3)),
    Disturbance("no yellow region", ChamberStatus.NO_YELLOW, walls=(0, 1, 1, 1)),
    Disturbance("yellow in the dark", ChamberStatus.DARK_INSIDE, inner=0.02),
    Disturbance("yellow outside of blue", ChamberStatus.NO_RINGS, walls=(0, 2, 1, 3)),
    Disturbance("speckles, 5 %", ChamberStatus.CHAMBER, change=_speckled),
    Disturbance(
        "red and blue swapped",
        ChamberStatus.SWAPPED,
        change=lambda p: np.ascontiguousarray(p[..., ::-1]),
    ),
)


class Answer(NamedTuple):
    """What is answered to a disturbed frame.

    Attributes:
        status: of the chamber; None after an exception.
        given: whether anything else was answered, such as a direction or a posture.
        right: whether that is the answer, or the lack of one, that is defined for the frame.
    """

    status: ChamberStatus | None
    given: bool
    right: bool


def disturbed_frames(
    finger: SoftFinger, postures: Posture, seed: int
) -> Iterator[tuple[Disturbance, int, Picture]]:
    """Pictures of every disturbance in every posture, with the posture's number."""
    taken: dict[tuple, list[Picture]] = {}  # by what the camera and the walls are like
    for kind in DISTURBANCES:
        light = (kind.gain, kind.walls, kind.inner)
        if light not in taken:
            renderer = finger.renderer(seed, gain=kind.gain, colors=kind.colors)
            taken[light] = looked_at(renderer, postures, lambda _, image: image.pixels)
        for number, picture in enumerate(taken[light]):
            yield kind, number, kind.change(picture) if kind.change else picture


def answer_disturbances(
    finger: SoftFinger,
    postures: Posture,
    seed: int,
    answer: Callable[[Picture, Disturbance, int], Answer],
) -> Records:
    """Answers to every disturbance in every posture.

    Args:
        finger: its chamber and camera.
        postures: one batch axis.
        seed: of the pictures.
        answer: to a picture, of a disturbance, in the posture of that number. Whatever it raises is
            counted as a wrong answer.

    Returns:
        A row for each frame: ``kind``, ``number`` of the posture, ``usable`` and ``in_view`` as of
        `Disturbance`, ``expected_sight`` and ``sight`` (the statuses in words), ``given``, and
        ``failed``: whether status or answer is not the defined one.
    """
    rows = Records()
    for kind, number, picture in disturbed_frames(finger, postures, seed):
        try:
            one = answer(picture, kind, number)
        except Exception:
            one = Answer(None, given=False, right=False)
        rows.add(
            kind=kind.name,
            number=number,
            usable=kind.usable,
            in_view=kind.in_view,
            expected_sight=status_words(kind.status),
            sight=status_words(one.status),
            given=one.given,
            failed=one.status is not kind.status or not one.right,
        )
    return rows


def summarize_disturbances(frames: Records) -> Records:
    """A row for each disturbance, from those of `answer_disturbances`.

    Returns:
        ``kind``, ``expected_sight``, ``usable``, ``in_view``; ``frames``, ``sights`` (all statuses
        that were answered), ``given`` and ``failures``, numbers of frames.
    """
    return frames.summary(
        "kind",
        "expected_sight",
        "usable",
        "in_view",
        frames="count failed",
        sights=lambda own: ", ".join(sorted(set(own["sight"]))),
        given="sum given",
        failures="sum failed",
    )


def view_bends(
    finger: SoftFinger,
    bends_deg: Sequence[float],
    frames: int,
    look: Callable[[int, ChamberImage], Looked],
    *,
    seed: int,
    direction: float = DOWN,
    severity: float | None = None,
) -> list[Looked]:
    """What is found on some frames at each of some bends.

    Args:
        finger: its chamber and camera.
        bends_deg: degrees.
        frames: at each of them.
        look: from the number of a frame and its picture to what is found; called in threads.
        seed: of the pictures.
        direction: of bending, radians.
        severity: of the pictures; by default the finger's.

    Returns:
        As many at the first bend, then at the second, in the order of
        ``np.repeat(bends_deg, frames)``.
    """
    postures = finger.postures(np.repeat(np.deg2rad(bends_deg), frames), direction)
    return looked_at(finger.renderer(seed, severity=severity), postures, look)
