"""Samples for the posture network: boundary images, and where the finger's markers are."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32

from optics.chamber import Posture, bend_center_line, press_wall
from optics.rendering import ChamberImage
from perception.chamber import find_regions
from perception.posture import USABLE, make_boundary_image, shrink
from studies.models.soft_finger.finger import DOWN, SoftFinger, looked_at

Size = tuple[int, int]
"""Columns and rows of an image."""

MARKERS = (0.1, 0.4, 0.7, 1.0)
"""Places of the markers over the finger's length, the one that the others are relative to first.
The paper gives none."""

SCATTER_DEG = 3.0
"""Standard deviation of the direction around the plane that the outer camera looks at."""

PRESSED_SHARE, DEEPEST = 0.3, 3.0
"""Part of the samples in which something presses the wall, and the deepest it does, mm."""


@dataclass(frozen=True)
class Samples:
    """Images and labels.

    Attributes:
        bends: radians.
        images: shrunk boundary images, by their size.
        usable: whether the frame shows what a posture can be read from.
        markers: true places relative to the marker nearest the camera: to the side the finger
            bends to, and along the finger where it starts, mm.
    """

    bends: Float[np.ndarray, " samples"]
    images: dict[Size, Float32[np.ndarray, "samples rows columns"]]
    usable: Bool[np.ndarray, " samples"]
    markers: Float[np.ndarray, "samples 3 2"]

    def part(self, which: slice | Bool[np.ndarray, " samples"]) -> Samples:
        """Some of them, by their numbers or by a mask."""
        images = {size: stack[which] for size, stack in self.images.items()}
        return Samples(self.bends[which], images, self.usable[which], self.markers[which])


def marker_places(
    bends: Float[np.ndarray, " samples"], length: float
) -> Float[np.ndarray, "samples 3 2"]:
    """The three markers relative to the one nearest the camera, mm (paper A §III.A.c)."""
    arcs = jnp.asarray(np.multiply(MARKERS, length))
    each = jax.vmap(bend_center_line, in_axes=(None, 0, None))
    line = each(arcs, jnp.asarray(bends), jnp.asarray(length))
    places = np.stack([np.asarray(line.across), np.asarray(line.along)], axis=-1)
    return places[:, 1:] - places[:, :1]


def random_postures(
    finger: SoftFinger, count: int, largest_bend_deg: float, generator: np.random.Generator
) -> Posture:
    """A finger that bends down by up to so much, not quite straight, sometimes pressed."""
    bends, arc = np.deg2rad(generator.uniform(0, largest_bend_deg, count)), jnp.asarray(finger.arc)
    directions = DOWN + np.deg2rad(SCATTER_DEG) * generator.standard_normal(count)
    places = generator.uniform(40, 90, count)
    radii = generator.uniform(15, 50, count)
    depths = generator.uniform(0, DEEPEST, count) * (generator.uniform(size=count) < PRESSED_SHARE)
    pressed = [
        np.asarray(press_wall(arc, *(jnp.asarray(one) for one in press)))
        for press in zip(places, radii, depths, strict=True)
    ]
    return finger.postures(bends, directions, np.stack(pressed))


def boundaries(image: ChamberImage, sizes: tuple[Size, ...]) -> tuple[list[np.ndarray], bool]:
    """Shrunk boundary images of one picture, and whether it is usable."""
    regions = find_regions(image.pixels)
    edges = make_boundary_image(regions.nested())
    return [shrink(edges, size) for size in sizes], regions.status in USABLE


def samples(
    finger: SoftFinger, postures: Posture, sizes: tuple[Size, ...], *, seed: int, first: int = 0
) -> Samples:
    """Boundary images of some postures, and their markers.

    Args:
        finger: its chamber and camera.
        postures: one batch axis; bends down.
        sizes: of the images.
        seed: of the pictures.
        first: number of the first picture.
    """
    found = looked_at(
        finger.renderer(seed), postures, lambda _, image: boundaries(image, sizes), first
    )
    stacks = {size: np.stack([images[i] for images, _ in found]) for i, size in enumerate(sizes)}
    bends = np.asarray(postures.bend)
    usable = np.array([ok for _, ok in found])
    return Samples(bends, stacks, usable, marker_places(bends, finger.length))
