"""Rays in space through the layers on one pad, by Snell's law in vectors, from face to face.

A place is (along the membrane from its end ``from``, across from its middle, height over it), mm.
Layers are as wide as the membrane. Nothing is unfolded, and no way through a layer is known
beforehand: in every layer a ray goes to the nearest of its planes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from studies.oracles.layers import Layer, Pad

WALLS = ("from", "to", "left", "right")
"""Side walls of a layer: at both ends of the pad, and beside it at negative and positive places."""

NONE = -1
"""Number of a wall that has not reflected a ray."""

FLUSH = 1e-7
"""mm: a ray that meets a wall nearer than this to the membrane's edge ends at that edge."""

SCAN, REACH, HALVINGS = 61, 3.0, 52
"""Steps from the inner ray outwards, how far they go in parts of the way to the outer one, and
bisections of the step in which a view ends."""


@dataclass(frozen=True)
class Block:
    """A layered pad in space.

    Attributes:
        pad: its section; side and place do not count.
        width: across, mm.
        beside: of each layer, whether the walls beside it are clear.
        bezel: whether there is one; beside, its lip is as wide as the wider of its two lips.
    """

    pad: Pad
    width: float
    beside: tuple[bool, ...]
    bezel: bool

    @property
    def length(self) -> float:
        """Of the membrane, mm."""
        return abs(self.pad.end - self.pad.start)

    @property
    def top(self) -> float:
        """Height of the outermost surface, mm."""
        return sum(layer.thickness for layer in self.pad.layers)


class Ends(NamedTuple):
    """How rays end, arrays of one entry for each ray.

    Attributes:
        sensed: whether the membrane is reached.
        place: along, across and height where it ends.
        layer: of the clear wall that has reflected it, `NONE` if none has.
        wall: index of that wall in `WALLS`.
        first: what of the body it meets first that is no way on: ``bezel``, ``wall`` (a ledge
            too), ``membrane`` (it, or beside it).
        met: where.
    """

    sensed: np.ndarray
    place: np.ndarray
    layer: np.ndarray
    wall: np.ndarray
    first: np.ndarray
    met: np.ndarray


def follow(block: Block, camera: np.ndarray, directions: np.ndarray) -> Ends:
    """Follow rays down through the layers; a clear wall reflects each of them once at most.

    Args:
        block: what they meet.
        camera: where they start, in air above layers and bezel.
        directions: downwards, of any length, shape (rays, 3).
    """
    pad, half, count = block.pad, block.width / 2, len(directions)
    heading = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    place = np.broadcast_to(camera, heading.shape).copy()
    first, met = np.full(count, "", "<U8"), np.zeros((count, 3))
    layer_of, wall_of = np.full((2, count), NONE)
    on = np.ones(count, bool)

    def ended(rays: np.ndarray, name: str) -> None:
        """Rays that go no further, or are reflected."""
        new = rays & (first == "")
        first[new], met[new] = name, place[new]

    start, stop = pad.layers[0].spans(block.length)[1]
    lip = max(pad.lip)
    for height in [pad.height] * block.bezel + [0.0]:
        way = (place[:, 2] - block.top - height) / -heading[:, 2]
        place += way[:, None] * heading
        out = (place[:, 0] < start + pad.lip[0]) | (place[:, 0] > stop - pad.lip[1])
        out |= np.abs(place[:, 1]) > half - lip
        ended(on & out, "bezel" if block.bezel else "wall")
        on &= ~out

    below, before = block.top, 1.0
    for number, layer in enumerate(pad.layers):
        # Snell's law at the level above: the part along it, times the index, stays.
        flat = heading[:, :2] * before / layer.index
        squared = 1 - np.sum(flat**2, axis=1)
        on &= squared > 0
        heading = np.column_stack([flat, -np.sqrt(np.maximum(squared, 0.0))])
        before, below = layer.index, below - layer.thickness
        clear = [*layer.clear, block.beside[number], block.beside[number]]
        inside, feet = _planes(block, number, below)
        reflected, left = on.copy(), np.full(count, NONE)
        while np.any(reflected):
            falls = heading[:, 2] < 0
            to_level = np.where(
                falls, (below - place[:, 2]) / np.where(falls, heading[:, 2], 1), 9e9
            )
            speed = -heading @ inside.T  # towards each wall
            room = np.einsum("rwk,wk->rw", place[:, None] - feet, inside)
            ways = np.where(speed > 0, room / np.where(speed > 0, speed, 1.0), np.inf)
            ways = np.where(np.arange(4) == left[:, None], np.inf, ways)
            wall = np.argmin(ways, axis=1)
            nearest = ways[np.arange(count), wall]
            at_wall = reflected & (nearest < to_level)
            step = np.where(reflected, np.minimum(nearest, to_level), 0.0)
            place += step[:, None] * heading
            ended(at_wall, "wall")
            normal = inside[wall]
            cosine = np.sum(heading * normal, axis=1)
            total = layer.index**2 * (1 - cosine**2) >= 1
            turned = at_wall & total & np.array(clear)[wall] & (wall_of == NONE)
            heading = np.where(turned[:, None], heading - 2 * cosine[:, None] * normal, heading)
            layer_of[turned], wall_of[turned] = number, wall[turned]
            on &= ~at_wall | turned
            on &= ~reflected | at_wall | falls
            left, reflected = np.where(turned, wall, NONE), turned
        low, high = (
            pad.layers[number + 1].spans(block.length)[1]
            if number + 1 < len(pad.layers)
            else (0.0, block.length)
        )
        out = (place[:, 0] < low) | (place[:, 0] > high)
        last = number + 1 == len(pad.layers)
        ended(on & (out | last), "membrane" if last else "wall")
        on &= ~out
    return Ends(on, place, layer_of, wall_of, first, met)


def _planes(block: Block, number: int, below: float) -> tuple[np.ndarray, np.ndarray]:
    """Inward normals of a layer's four walls, and a point on each."""
    layer, half = block.pad.layers[number], block.width / 2
    (low, high), _ = layer.spans(block.length)
    tilt = [(np.cos(angle), np.sin(angle)) for angle in layer.bevel]
    inside = [(tilt[0][0], 0, -tilt[0][1]), (-tilt[1][0], 0, -tilt[1][1]), (0, 1, 0), (0, -1, 0)]
    feet = [(low, 0, below), (high, 0, below), (0, -half, below), (0, half, below)]
    return np.array(inside), np.array(feet)


class Edge(NamedTuple):
    """Where a view ends on the way from an inner to outer rays, arrays of one entry for each.

    Attributes:
        part: of the way in the plane of slopes; NaN if the inner ray is not in the view.
        place: along and across on the membrane, of the last ray of the view.
        name: what ends it: ``membrane``, ``bezel`` or ``wall``.
    """

    part: np.ndarray
    place: np.ndarray
    name: np.ndarray


def edges(
    block: Block,
    camera: np.ndarray,
    inner: np.ndarray,
    outer: np.ndarray,
    mirror: tuple[int, int] = (NONE, NONE),
) -> Edge:
    """Where the view through the outermost surface, or a second image, ends.

    Args:
        block: what is seen.
        camera: as in `follow`.
        inner: slope of a ray in the view, or of one for each other: along and across, per height.
        outer: slopes of others, shape (rays, 2).
        mirror: layer and wall that reflect the rays of the view.
    """

    def seen(part: np.ndarray) -> tuple[np.ndarray, Ends]:
        slopes = inner + part[:, None] * (outer - inner)
        ends = follow(block, camera, np.column_stack([slopes, -np.ones(len(slopes))]))
        return ends.sensed & (ends.layer == mirror[0]) & (ends.wall == mirror[1]), ends

    scan = np.linspace(0, REACH, SCAN)
    count = len(outer)
    shown = np.column_stack([seen(np.full(count, part))[0] for part in scan])
    last = np.argmin(shown, axis=1) - 1
    low, high = scan[last], scan[last + 1]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        there, _ = seen(middle)
        low, high = np.where(there, middle, low), np.where(there, high, middle)
    within, beyond = seen(low)[1], seen(high)[1]
    name, rim = beyond.first.copy(), beyond.met
    off = np.abs(rim[:, 0] - block.length / 2) - block.length / 2
    beside = np.abs(rim[:, 1]) - block.width / 2
    flush = (
        (name == "wall") & (rim[:, 2] < FLUSH) & (np.minimum(np.abs(off), np.abs(beside)) < FLUSH)
    )
    name[flush] = "membrane"
    lost = (last < 0) | np.all(shown, axis=1)
    return Edge(np.where(lost, np.nan, low), within.place[:, :2], name)


class Setting(NamedTuple):
    """A camera before a layered pad.

    Attributes:
        block: the pad.
        camera: along, across and height in the pad's own axes, mm.
        pad: its table in a scene file, without its place.
    """

    block: Block
    camera: np.ndarray
    pad: dict[str, Any]


def random_setting(rng: np.random.Generator, structure: int) -> Setting:
    """A pad of 10 to 40 mm under one to three layers, and a camera that looks at it from above.

    Args:
        rng: draws all numbers.
        structure: seed of what there is: how many layers, a bezel, which walls are clear.
    """
    shape = np.random.default_rng(structure)
    layers = []
    for _ in range(shape.integers(1, 4)):
        kinds = shape.choice(["clear", "black"], 3).tolist()
        layers.append(
            {
                "thickness": rng.uniform(0.2, 4),
                "index": rng.uniform(1, 1.8),
                "sides": dict(zip(("from", "to", "beside"), kinds, strict=True)),
                "overhang": (rng.uniform(0, 4, 2) * rng.integers(2, size=2)).tolist(),
                "bevel_deg": (rng.uniform(-45, 45, 2) * rng.integers(2, size=2)).tolist(),
            }
        )
    length, width = rng.uniform(10, 40), rng.uniform(10, 30)
    pad: dict[str, Any] = {"width": width, "layers": layers, "min_transmission": 0.0}
    if bezel := bool(shape.integers(2)):
        pad["bezel"] = {"lip": rng.uniform(0, 2, 2).tolist(), "height": rng.uniform(0, 2)}
    section = Pad(
        0j,
        complex(length),
        1,
        layers=tuple(
            Layer(
                layer["thickness"],
                layer["index"],
                tuple(layer["overhang"]),
                tuple(np.radians(layer["bevel_deg"])),
                (layer["sides"]["from"] == "clear", layer["sides"]["to"] == "clear"),
            )
            for layer in layers
        ),
        lip=tuple(pad["bezel"]["lip"]) if bezel else (0.0, 0.0),
        height=pad["bezel"]["height"] if bezel else 0.0,
    )
    beside = tuple(layer["sides"]["beside"] == "clear" for layer in layers)
    block = Block(section, width, beside, bezel)
    height = block.top + section.height + 10 ** rng.uniform(-0.5, 1.5)
    across = rng.uniform(-0.3, 0.3) * width * rng.integers(2)
    return Setting(block, np.array([rng.uniform(-0.7, 1.7) * length, across, height]), pad)
