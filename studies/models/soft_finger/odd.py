"""Frames that are no proper images of the chamber, each with the answer that is right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from designopt.plot.typesetting import spell_out
from optics.chamber import Posture
from optics.rendering import COLORS
from perception.chamber import IN_VIEW, ChamberStatus
from perception.posture import USABLE
from studies.models.soft_finger.finger import SoftFinger, looked_at

Picture = UInt8[np.ndarray, "rows columns 3"]


def status_words(status: ChamberStatus | None) -> str:
    """What is said of the chamber in an image; none is said where an exception is raised."""
    return spell_out(status.name.lower()) if status else "exception"


@dataclass(frozen=True)
class Kind:
    """What makes a frame odd, and the status that is expected of it.

    Attributes:
        name: what is odd.
        status: that of the chamber.
        gain: of the camera.
        walls: which wall's colour the red, the blue and the yellow one and the top have.
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


KINDS = (
    Kind("underexposed, gain 0.4", ChamberStatus.CHAMBER, gain=0.4),
    Kind("overexposed, gain 2", ChamberStatus.CHAMBER, gain=2.0),
    Kind("dark, gain 0.02", ChamberStatus.TOO_DARK, gain=0.02),
    Kind("saturated, gain 50", ChamberStatus.TOO_BRIGHT, gain=50.0),
    Kind("black", ChamberStatus.TOO_DARK, change=np.zeros_like),
    Kind("white", ChamberStatus.TOO_BRIGHT, change=lambda p: np.full_like(p, 255)),
    Kind("out of the chamber, grey", ChamberStatus.NO_CHAMBER, change=_gray),
    Kind("random pixels", ChamberStatus.NO_CHAMBER, change=_random),
    Kind("no blue region", ChamberStatus.NO_CHAMBER, walls=(0, 0, 2, 3)),
    Kind("no red region", ChamberStatus.NO_CHAMBER, walls=(1, 1, 2, 3)),
    Kind("no yellow region", ChamberStatus.NO_YELLOW, walls=(0, 1, 1, 1)),
    Kind("yellow in the dark", ChamberStatus.DARK_INSIDE, inner=0.02),
    Kind("yellow outside of blue", ChamberStatus.NO_RINGS, walls=(0, 2, 1, 3)),
    Kind("speckles, 5 %", ChamberStatus.CHAMBER, change=_speckled),
    Kind("red and blue swapped", ChamberStatus.SWAPPED,
          change=lambda p: np.ascontiguousarray(p[..., ::-1])),
)  # fmt: skip


def odd_pictures(
    finger: SoftFinger, postures: Posture, seed: int
) -> list[tuple[Kind, int, Picture]]:
    """Pictures of every kind in every posture, with the posture's number."""
    made: list[tuple[Kind, int, Picture]] = []
    for kind in KINDS:
        renderer = finger.renderer(seed, gain=kind.gain, colors=kind.colors)
        pictures = looked_at(renderer, postures, lambda _, image: image.pixels)
        for i, picture in enumerate(pictures):
            made.append((kind, i, kind.change(picture) if kind.change else picture))
    return made
