"""What stands in front of the camera: faces in space, from the plain tables of a scene file.

Places in the section are complex numbers, x + i y. A face is named by what it is.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from studies.physical_check.judge.engine import Material

Tables = Mapping[str, Any]
"""Of a scene file, as `tomllib` gives them."""

Pose = Mapping[str, float]
"""Joint angles by name, degrees."""

Kind = Literal["mirror", "membrane", "blocker", "body", "level", "end"]

REACH = 60.0
"""Mirrors and blockers reach so far to both sides of the section, mm."""

WIDTH = 24.0
"""Of a pad that gives none, mm."""


class Face(NamedTuple):
    """A flat face.

    Attributes:
        kind: "body" is any opaque part of a pad, "level" a refracting surface along the membrane,
            "end" a clear end face.
        name: what it is, for people.
        corners: in space, counter-clockwise seen from its front, shape (4, 3).
        material: of it.
        part: index of the pad or mirror that it belongs to.
        outermost: whether light enters the pad here.
        one_sided: only the front of this membrane senses, or of this blocker blocks.
    """

    kind: Kind
    name: str
    corners: np.ndarray
    material: Material = "opaque"
    part: int = -1
    outermost: bool = False
    one_sided: bool = False


def motion_of(tables: Tables, pose: Pose, body: str = "world") -> tuple[complex, complex]:
    """The motion p ↦ a p + b of a frame from the reference pose."""
    if body == "world":
        return 1, 0
    frame = tables["frames"][body]
    degrees = pose.get(frame["angle"], 0.0)
    if frame.get("positive", "counterclockwise") == "clockwise":
        degrees = -degrees
    turn, hinge = cmath.exp(1j * math.radians(degrees)), complex(*frame["hinge"])
    outer, shift = motion_of(tables, pose, frame.get("parent", "world"))
    return outer * turn, outer * (hinge - turn * hinge) + shift


def strip(start: complex, end: complex, low: float, high: float) -> np.ndarray:
    """A segment of the section between two places across; its front is to its left."""
    ends = [(start, low), (start, high), (end, high), (end, low)]
    return np.array([(place.real, place.imag, z) for place, z in ends])


def sheet(outline: Sequence[complex], z: float) -> np.ndarray:
    """Four places of the section, moved across it."""
    return np.array([(place.real, place.imag, z) for place in outline])


def faces_of(tables: Tables, pose: Pose, only: int | None = None, spare: float = 0) -> list[Face]:
    """All faces of a scene in a pose.

    Args:
        tables: of the scene's file.
        pose: its joint angles.
        only: a pad that is to be alone with the mirrors.
        spare: how far its surfaces go on, without ends, beyond where they end, mm.
    """
    found: list[Face] = []
    for index, mirror in enumerate(tables.get("mirrors", [])):
        if "radius" in mirror:
            raise ValueError(f"mirror {mirror['name']} is curved, and the judge's faces are flat")
        line = _line(tables, pose, mirror)
        material = "two-sided mirror" if mirror.get("side", "both") == "both" else "mirror"
        found.append(Face("mirror", mirror["name"], strip(*line, -REACH, REACH), material, index))
    for index, pad in enumerate(tables.get("pads", [])):
        if only in (None, index):
            found += _pad_faces(
                pad, index, _line(tables, pose, pad), None if only is None else spare
            )
    if only is None:
        for part in tables.get("blockers", []):
            corners = strip(*_line(tables, pose, part), -REACH, REACH)
            one_sided = part.get("side", "both") != "both"
            found.append(Face("blocker", part["name"], corners, one_sided=one_sided))
    return found


def _line(tables: Tables, pose: Pose, part: Mapping[str, Any]) -> tuple[complex, complex]:
    """Both ends in the pose, so that the side that matters is the left one."""
    turn, shift = motion_of(tables, pose, part.get("body", "world"))
    start, end = (turn * complex(*part[key]) + shift for key in ("from", "to"))
    return (end, start) if part.get("side") == "right" else (start, end)


def both_ends(value: Any) -> tuple[float, float]:
    """A number for both ends of a layer, or one for each."""
    return (value, value) if isinstance(value, (int, float)) else tuple(value)


class Layer(NamedTuple):
    """A layer in the pad's own frame, whose x runs along the membrane from its left end.

    Attributes:
        low: height of its lower level, on the membrane's side.
        high: of its upper level.
        bottom: where its lower level begins and ends.
        top: where its upper level does.
        refraction: its index.
        clear: whether its first and its last end are.
        names: of these ends.
    """

    low: float
    high: float
    bottom: tuple[float, float]
    top: tuple[float, float]
    refraction: float
    clear: tuple[bool, bool]
    names: tuple[str, str]


def layers_of(pad: Mapping[str, Any], length: float) -> list[Layer]:
    """A pad's layers from the membrane upwards; x runs with the sensing side on the left."""
    flip = -1 if pad.get("side") == "right" else 1
    made, low = [], 0.0
    for table in reversed(pad.get("layers", [])):
        over, bevel = (both_ends(table.get(key, 0))[::flip] for key in ("overhang", "bevel_deg"))
        names = ("from", "to") if flip > 0 else ("to", "from")
        sides = table.get("sides", "black")
        clear = [(sides if isinstance(sides, str) else sides.get(n, "")) == "clear" for n in names]
        index, high = table["index"], low + table["thickness"]
        cut = [table["thickness"] * math.tan(math.radians(angle)) for angle in bevel]
        bottom = -over[0], length + over[1]
        top = bottom[0] + cut[0], bottom[1] - cut[1]
        green = float(index["green"] if isinstance(index, Mapping) else index)
        made.append(Layer(low, high, bottom, top, green, (clear[0], clear[1]), names))
        low = high
    return made


def _pad_faces(
    pad: Mapping[str, Any], part: int, line: tuple[complex, complex], spare: float | None
) -> Iterator[Face]:
    """Membrane, layers and bezel of one pad, or, with room to spare, levels without ends."""
    start, end = line
    along = (end - start) / abs(end - start)
    half, length = float(pad.get("width", WIDTH)) / 2, abs(end - start)
    layers, name, room = layers_of(pad, length), pad["name"], spare or 0.0
    wide, pairs = half + room, list(zip(layers, [*layers[1:], None], strict=False))

    def flat(height: float, left: float, right: float, z: float = wide) -> np.ndarray:
        return strip(
            start + along * (left + 1j * height), start + along * (right + 1j * height), -z, z
        )

    one_sided = pad.get("side", "both") != "both"
    membrane = flat(0, -room, length + room)
    yield Face("membrane", f"pad {name}", membrane, part=part, one_sided=one_sided)
    if spare is not None:
        for lower, upper in pairs:
            material = (upper.refraction if upper else 1.0, lower.refraction)
            face = flat(lower.high, -room, length + room)
            yield Face("level", "top", face, material, part, upper is None)
        return
    bezel = _bezel(pad, layers)
    for left, right in ((layers[0].bottom[0], 0), (length, layers[0].bottom[1])) if layers else ():
        if left < right:
            yield Face("body", f"underside of pad {name}", flat(0, left, right), part=part)
    for number, (lower, upper) in enumerate(pairs):
        # A level is clear where both lie on it (or between the lips), and opaque elsewhere.
        over = upper.bottom if upper else (lower.top[0] + bezel[0], lower.top[1] - bezel[1])
        low, high = max(lower.top[0], over[0]), min(lower.top[1], over[1])
        ends = sorted([lower.top[0], over[0]]), sorted([lower.top[1], over[1]])
        material = (upper.refraction if upper else 1.0, lower.refraction)
        side = half if upper else half - max(bezel[:2])
        if low < high:
            face = flat(lower.high, low, high, side)
            yield Face("level", "top", face, material, part, upper is None)
        what = f"ledge of pad {name}" if upper else f"lip of pad {name}"
        for left, right in ends:
            if left < right:
                yield Face("body", what, flat(lower.high, left, right), part=part)
        yield from _layer_sides(lower, name, part, start, along, half, len(layers) - number)
    if layers and bezel[2] > 0:
        yield from _lips(layers[-1], name, part, start, along, half, bezel)


def _layer_sides(
    layer: Layer, name: str, part: int, start: complex, along: complex, half: float, number: int
) -> Iterator[Face]:
    """Its two ends and its two lateral faces."""
    low, high = (
        [start + along * (x + 1j * y) for x in ends]
        for y, ends in ((layer.low, layer.bottom), (layer.high, layer.top))
    )
    for which in range(2):
        # Fronts look outwards: to the left, going up at the first end and down at the last.
        line = (low[0], high[0]) if which == 0 else (high[1], low[1])
        clear, corners = layer.clear[which], strip(*line, -half, half)
        material: Material = (1.0, layer.refraction) if clear else "opaque"
        what = f"end '{layer.names[which]}' of layer {number} of pad {name}"
        yield Face("end" if clear else "body", what, corners, material, part, clear)
    outline = [low[0], low[1], high[1], high[0]]
    for corners in (sheet(outline, z) for z in (-half, half)):
        yield Face("body", f"side of pad {name}", corners, part=part)


def _bezel(pad: Mapping[str, Any], layers: list[Layer]) -> tuple[float, float, float]:
    """How far its lips reach inwards at the first and the last end, and how high they stand."""
    table = pad.get("bezel")
    if not table or not layers:
        return 0.0, 0.0, 0.0
    flip = -1 if pad.get("side") == "right" else 1
    first, last = both_ends(table["lip"])[::flip]
    return float(first), float(last), float(table["height"])


def _lips(
    layer: Layer, name: str, part: int, start: complex, along: complex, half: float,
    bezel: tuple[float, float, float],
) -> Iterator[Face]:  # fmt: skip
    """The lips at both ends and at both sides, as bodies on the outermost surface."""
    first, last, height = bezel
    (left, right), wide, what = layer.top, max(first, last), f"lip of pad {name}"
    boxes = [
        (left, left + first, -half, half),
        (right - last, right, -half, half),
        (left, right, -half, wide - half),
        (left, right, half - wide, half),
    ]
    for x0, x1, z0, z1 in boxes:
        if x0 < x1 and z0 < z1:
            floor = [start + along * (x + 1j * layer.high) for x in (x0, x1)]
            roof = [place + 1j * along * height for place in floor]
            lines = [(floor[0], roof[0]), (roof[1], floor[1]), (roof[0], roof[1])]
            sides = [strip(*line, z0, z1) for line in lines]
            outline = [floor[0], floor[1], roof[1], roof[0]]
            sides += [sheet(outline, z) for z in (z0, z1)]
            yield from (Face("body", what, corners, part=part) for corners in sides)
