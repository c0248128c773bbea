"""Rays of pixels on their way down through the clear layers on a pad, to its membrane.

In the pad's own axes a ray's slopes along and across it only shrink by one factor in each layer,
since n sin θ stays (Snell), and a wall at right angles mirrors the place and one slope: so every
level is met in closed form. Rays enter by the outermost surface; what enters by an end face, seen
from outside, is not shown. A clear wall reflects each ray once in each layer: totally, or the part
that Fresnel's formulas give. Black, painted and bevelled walls are dark where they are met, and so
are the ledges between layers; of two walls that a ray is beyond, that at the pad's end counts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from optics.rendering.ways import TINY, Coordinates
from optics.scene.layers import CHANNELS, GREEN
from optics.scene.scene import Scene
from optics.visibility.refraction import profile_of, transmission
from optics.visibility.second_images import SQUARE

OUTWARD = (-1.0, 1.0)
"""Sense in which places grow beyond the first and the second end, or beside the pad."""

LAMPS = ((GREEN, GREEN), (CHANNELS.index("blue"), CHANNELS.index("red")))
"""Colors of lamps at the pad's two ends, and beside it towards lesser and greater columns."""

COSINES = 1024
"""Entries of the table of what comes through all surfaces, over the cosine in air."""

CRITICAL = np.sqrt(2.0)
"""From this index of refraction on, walls reflect all rays that have entered from above."""

Ends = tuple[Any, Any]


class Meeting(NamedTuple):
    """Where rays meet a pad; arrays over pixels.

    Attributes:
        along: along the membrane from its first end, mm.
        across: from its middle, mm.
        there: whether the pad is before the rays.
        margin: by how much they pass the edges of all that is over the membrane, mm, negative
            where they do not; ``None`` of a bare pad.
        light: part of it that comes through; likewise.
        lamps: of every wall that is a lamp, by how much it is met, mm, and its color.
    """

    along: Float[np.ndarray, "rows columns"]
    across: Float[np.ndarray, "rows columns"]
    there: Bool[np.ndarray, "rows columns"]
    margin: Float[np.ndarray, "rows columns"] | None = None
    light: Float[np.ndarray, "rows columns"] | None = None
    lamps: tuple[tuple[Float[np.ndarray, "rows columns"], int], ...] = ()


class Plate(NamedTuple):
    """A layer: pairs are along the pad and across it, and there of the first and the second end.

    Attributes:
        thickness: mm.
        refraction: its index.
        walls: places of its walls, where it ends towards the membrane, mm.
        kinds: of the walls: clear, lamp, or dark.
        window: what may be passed there.
    """

    thickness: float
    refraction: float
    walls: tuple[Ends, Ends]
    kinds: tuple[Ends, Ends]
    window: tuple[Ends, Ends]


class Plates(NamedTuple):
    """All layers on a pad, for one color.

    Attributes:
        plates: the outermost first.
        top: height of the outermost surface over the membrane, mm.
        opening: what of that surface is free, as `Plate.window`.
        bezel: height of a bezel about it, mm.
        through: part of the light that comes through, at equal steps of the cosine in air.
    """

    plates: tuple[Plate, ...]
    top: float
    opening: tuple[Ends, Ends]
    bezel: float
    through: Float[np.ndarray, "1 cosines"]

    @property
    def mirrored(self) -> tuple[tuple[bool, bool], tuple[bool, bool]]:
        """Which edges of the membrane bound nothing, as clear walls stand on them."""
        last = self.plates[-1]
        of_walls = [
            [kind == "clear" and wall == end for kind, wall, end in zip(*of, strict=True)]
            for of in zip(last.kinds, last.walls, last.window, strict=True)
        ]
        (first, second), (left, right) = of_walls
        return (first, second), (left, right)

    def meet(self, start: Coordinates, way: Coordinates) -> Meeting:
        """Follow rays that are given in the pad's axes: along it, across, and over its membrane."""
        down = np.maximum(-way[2], np.float32(TINY))
        slopes, drop = [way[0] / down, way[1] / down], start[2] - self.top
        places = [begin + drop * slope for begin, slope in zip(start, slopes, strict=False)]
        room = _room(places, self.opening)
        if self.bezel:
            above = [p - self.bezel * slope for p, slope in zip(places, slopes, strict=True)]
            room = np.minimum(room, _room(above, self.opening))
        square = slopes[0] ** 2 + slopes[1] ** 2
        cosine = 1 / np.sqrt(1 + square)
        at = cosine * np.float32(COSINES - 1)
        light = cv2.remap(self.through, at, np.zeros_like(at), cv2.INTER_LINEAR)
        lamps = []
        for plate in self.plates:
            squared = plate.refraction**2
            bend = plate.thickness / np.sqrt(squared + (squared - 1) * square)
            for axis in range(2):
                places[axis] = places[axis] + bend * slopes[axis]
            for axis, end in np.ndindex(2, 2):
                wall, kind, edge = (
                    of[axis][end] for of in (plate.walls, plate.kinds, plate.window)
                )
                out = OUTWARD[end]
                beyond = out * (places[axis] - wall)
                if kind == "clear":
                    met = beyond > 0
                    if plate.refraction < CRITICAL:
                        part = _reflected(np.abs(slopes[axis]) * cosine, plate.refraction)
                        light = np.where(met, light * part, light)
                    places[axis] = wall - out * np.abs(beyond)
                    slopes[axis] = np.where(met, -slopes[axis], slopes[axis])
                    if edge == wall:
                        continue
                if kind == "lamp":
                    lamps.append((np.minimum(beyond, room), LAMPS[axis][end]))
                room = np.minimum(room, out * (edge - places[axis]))
        along, across = places
        return Meeting(along, across, (way[2] < 0) & (drop > 0), room, light, tuple(lamps))


def meet_bare(start: Coordinates, way: Coordinates) -> Meeting:
    """Where rays meet a pad without layers, given in its axes."""
    part = -start[2] / np.where(way[2] == 0, np.float32(TINY), way[2])
    return Meeting(start[0] + part * way[0], start[1] + part * way[1], part > 0)


def plates_of(scene: Scene, width: float, channel: int = GREEN) -> list[Plates | None]:
    """The layers of all pads for one color, by index among `CHANNELS`; ``None`` of a bare pad.

    Args:
        scene: as it was made.
        width: of the pads across the section, mm.
        channel: the color.
    """
    layers, kinds = scene.own_layers, scene.layout.layers
    if layers is None:
        return [None] * len(scene.pads)
    profile = profile_of(scene, layers)
    levels, lower, face, window = (
        np.asarray(part)
        for part in (profile.levels, profile.lower, profile.face(), profile.windows())
    )
    half, found = (-width / 2, width / 2), []
    for pad, own in enumerate(kinds):
        index = np.asarray(layers.index[pad, :, channel])
        lip, bevel = np.asarray(layers.lip[pad]), np.abs(np.asarray(layers.bevel[pad]))
        plates = []
        for layer, of in enumerate(own):
            first, second, beside = (
                kind if kind in ("clear", "lamp") and slant < SQUARE else "dark"
                for kind, slant in zip(of, [*bevel[layer], 0], strict=True)
            )
            plates.append(
                Plate(
                    float(layers.thickness[pad, layer]),
                    float(index[layer]),
                    (tuple(lower[pad, layer].tolist()), half),
                    ((first, second), (beside, beside)),
                    (tuple(window[pad, layer].tolist()), half),
                )
            )
        if not plates:
            found.append(None)
            continue
        free = width / 2 - float(lip.max())
        along = (float(face[pad, 0] + lip[0]), float(face[pad, 1] - lip[1]))
        grazing = jnp.arcsin(jnp.linspace(0, 1, COSINES))
        through = transmission(jnp.asarray(index[: len(own)]), grazing)
        found.append(
            Plates(
                tuple(plates),
                float(levels[pad, 0]),
                (along, (-free, free)),
                float(layers.height[pad]),
                np.asarray(through, np.float32)[None],
            )
        )
    return found


def _room(places: list[np.ndarray], window: tuple[Ends, Ends]) -> np.ndarray:
    """By how much places are within a rectangle, mm."""
    rooms = [
        np.minimum(place - first, last - place)
        for place, (first, last) in zip(places, window, strict=True)
    ]
    return np.minimum(*rooms)


def _reflected(cosine: np.ndarray, index: float) -> np.ndarray:
    """Part of unpolarised light that a clear wall reflects inside (Fresnel).

    Args:
        cosine: index times cosine between ray and normal, which is the cosine in the air above.
        index: of refraction.
    """
    outside = np.sqrt(np.maximum(1 - index**2 + cosine**2, 0))
    across = (cosine - outside) / np.maximum(cosine + outside, TINY)
    inner = cosine / index**2
    within = (inner - outside) / np.maximum(inner + outside, TINY)
    return np.where(outside > 0, (across**2 + within**2) / 2, 1.0).astype(np.float32)
