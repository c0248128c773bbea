"""Frames that are no proper images of the chamber, each with the answer that is right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from designopt.typesetting import words
from optics.soft_finger import COLOURS, Posture
from perception.chamber import Sight
from perception.posture import USABLE
from studies.chamber_images.making import SoftFinger, looked_at

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
        change: of the picture.
    """

    name: str
    sight: Sight
    gain: float = 1.0
    walls: tuple[int, int, int, int] = (0, 1, 2, 3)
    change: Callable[[Picture], Picture] | None = None

    @property
    def usable(self) -> bool:
        """Whether a posture is to be read all the same."""
        return self.sight in USABLE


def _grey(picture: Picture) -> Picture:
    noise = np.random.default_rng(0).normal(120, 6, picture.shape)
    return np.clip(noise, 0, 255).astype(np.uint8)


def _random(picture: Picture) -> Picture:
    return np.random.default_rng(0).integers(0, 256, picture.shape, np.uint8)


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
    Kind("red and blue swapped", Sight.SWAPPED,
          change=lambda p: np.ascontiguousarray(p[..., ::-1])),
)  # fmt: skip


def odd_pictures(
    finger: SoftFinger, postures: Posture, seed: int
) -> list[tuple[Kind, int, Picture]]:
    """Pictures of every kind in every posture, with the posture's number."""
    made: list[tuple[Kind, int, Picture]] = []
    for kind in KINDS:
        renderer = finger.renderer(seed, gain=kind.gain, colours=COLOURS[list(kind.walls)])
        pictures = looked_at(renderer, postures, lambda _, image: image.pixels)
        for i, picture in enumerate(pictures):
            made.append((kind, i, kind.change(picture) if kind.change else picture))
    return made
