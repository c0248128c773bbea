"""Frames that are no proper images of the chamber, each with the answer that is right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from designopt.plot.typesetting import words
from optics.chamber import Posture
from optics.rendering import COLOURS
from perception.chamber import IN_VIEW, Sight
from perception.posture import USABLE
from studies.models.soft_finger.finger import SoftFinger, looked_at

Picture = UInt8[np.ndarray, "rows columns 3"]


def sight_words(sight: Sight | None) -> str:
    """What is said of the chamber in an image; none is said where an exception is raised."""
    return words(sight.name.lower()) if sight else "exception"


@dataclass(frozen=True)
class Kind:
    """What makes a frame odd, and what is to be said of it.

    Attributes:
        name: what is odd.
        sight: what is to be said of the chamber.
        gain: of the camera.
        walls: which wall's colour the red, the blue and the yellow one and the top have.
        inner: what yellow and the top reflect, over what they do usually.
        change: of the picture.
    """

    name: str
    sight: Sight
    gain: float = 1.0
    walls: tuple[int, int, int, int] = (0, 1, 2, 3)
    inner: float = 1.0
    change: Callable[[Picture], Picture] | None = None

    @property
    def usable(self) -> bool:
        """Whether a posture is to be read all the same."""
        return self.sight in USABLE

    @property
    def in_view(self) -> bool:
        """Whether blue's points are to be found all the same."""
        return self.sight in IN_VIEW

    @property
    def colours(self) -> Float[np.ndarray, "4 3"]:
        """Of the walls and of the top."""
        return COLOURS[list(self.walls)] * np.array([[1], [1], [self.inner], [self.inner]])


def _grey(picture: Picture) -> Picture:
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
    Kind("underexposed, gain 0.4", Sight.CHAMBER, gain=0.4),
    Kind("overexposed, gain 2", Sight.CHAMBER, gain=2.0),
    Kind("dark, gain 0.02", Sight.TOO_DARK, gain=0.02),
    Kind("saturated, gain 50", Sight.TOO_BRIGHT, gain=50.0),
    Kind("black", Sight.TOO_DARK, change=np.zeros_like),
    Kind("white", Sight.TOO_BRIGHT, change=lambda p: np.full_like(p, 255)),
    Kind("out of the chamber, grey", Sight.NO_CHAMBER, change=_grey),
    Kind("random pixels", Sight.NO_CHAMBER, change=_random),
    Kind("no blue region", Sight.NO_CHAMBER, walls=(0, 0, 2, 3)),
    Kind("no red region", Sight.NO_CHAMBER, walls=(1, 1, 2, 3)),
    Kind("no yellow region", Sight.NO_YELLOW, walls=(0, 1, 1, 1)),
    Kind("yellow in the dark", Sight.DARK_INSIDE, inner=0.02),
    Kind("yellow outside of blue", Sight.NO_RINGS, walls=(0, 2, 1, 3)),
    Kind("speckles, 5 %", Sight.CHAMBER, change=_speckled),
    Kind("red and blue swapped", Sight.SWAPPED,
          change=lambda p: np.ascontiguousarray(p[..., ::-1])),
)  # fmt: skip


def odd_pictures(
    finger: SoftFinger, postures: Posture, seed: int
) -> list[tuple[Kind, int, Picture]]:
    """Pictures of every kind in every posture, with the posture's number."""
    made: list[tuple[Kind, int, Picture]] = []
    for kind in KINDS:
        renderer = finger.renderer(seed, gain=kind.gain, colours=kind.colours)
        pictures = looked_at(renderer, postures, lambda _, image: image.pixels)
        for i, picture in enumerate(pictures):
            made.append((kind, i, kind.change(picture) if kind.change else picture))
    return made
