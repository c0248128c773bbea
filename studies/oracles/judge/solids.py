"""What stands in front of the camera: faces in space, from the plain tables of a scene file.

Places in the section are complex numbers, x + i y. A face is named by what it is.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from studies.oracles.judge.engine import Material

Tables = Mapping[str, Any]
"""Of a scene file, as `tomllib` gives them."""

Pose = Mapping[str, float]
"""Joint angles by name, degrees."""

Kind = Literal["mirror", "membrane", "blocker", "body", "level", "end", "lamp"]

REACH = 60.0
"""Mirrors and blockers reach so far to both sides of the section, mm."""

WIDTH = 24.0
"""Of a pad that gives none, mm."""

STRIPS = 64
"""Flat strips of a bowed mirror: 0.2 mm of sag are right to 1e-5 mm; its normals are exact."""

GAP, FOOT, TOP = 3.0, 1.0, 2.5
"""Lamps in air stand so far beside a pad, between these heights above its membrane, mm."""


ROOM = 1.0
"""Between lamps and housing, mm."""


class Face(NamedTuple):
    """A flat face.

    Attributes:
        kind: "body" is any opaque part of a pad, "level" a refracting surface along the membrane,
            "end" a clear end or side face.
        name: what it is, for people.
        corners: in space, counter-clockwise seen from its front, shape (4, 3).
        material: of it.
        part: index of the pad or mirror that it belongs to.
        outermost: whether light enters the pad here.
        one_sided: only the front of this membrane senses.
        open_behind: what meets it from behind goes on.
        lamp: which one shines from it, or into it from behind: 0 at the greater columns, 1 at the
            end "from", 2 at the lesser columns, the channels that they light; −1 for none.
    """

    kind: Kind
    name: str
    corners: np.ndarray
    material: Material = "opaque"
    part: int = -1
    outermost: bool = False
    one_sided: bool = False
    open_behind: bool = False
    lamp: int = -1


class Frame3(NamedTuple):
    """A mirror or a pad in space, in a pose.

    Attributes:
        origin: its end "from", or the middle of a mirror.
        along: unit vector from "from" to "to".
        normal: to the left of it.
        across: towards greater columns where it does not lean.
        length: from end to end.
        bow: of a mirror.
    """

    origin: np.ndarray
    along: np.ndarray
    normal: np.ndarray
    across: np.ndarray
    length: float
    bow: float

    def mirrored(self, points: np.ndarray, ways: np.ndarray) -> np.ndarray:
        """Directions after reflection by a mirror that is bowed to a parabola."""
        slope = -8 * self.bow / self.length**2 * ((points - self.origin) @ self.along)
        normal = self.normal - slope[:, None] * self.along
        share = 2 * np.sum(ways * normal, axis=-1) / (1 + slope * slope)
        onward = ways - share[:, None] * normal
        return onward / np.linalg.norm(onward, axis=-1, keepdims=True)


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


def prism(outline: Sequence[complex], low: float, high: float) -> list[np.ndarray]:
    """The outer faces over the four edges of an outline, counter-clockwise, and both lids."""
    edges = zip([*outline[1:], outline[0]], outline, strict=True)
    lids = ([(place.real, place.imag, z) for place in outline] for z in (low, high))
    return [*(strip(*edge, low, high) for edge in edges), *map(np.array, lids)]


def frame_of(tables: Tables, pose: Pose, part: Mapping[str, Any], share: float = 0.0) -> Frame3:
    """A mirror's or a pad's own axes; its origin lies at a share of the way to "to"."""
    turn, shift = motion_of(tables, pose, part.get("body", "world"))
    start, end = (turn * complex(*part[key]) + shift for key in ("from", "to"))
    toward, lean, z = (end - start) / abs(end - start), part.get("lean", 0.0), np.eye(3)[2]
    origin = start + share * (end - start)
    place, along, left = (np.array([p.real, p.imag, 0.0]) for p in (origin, toward, 1j * toward))
    normal = math.cos(lean) * left + math.sin(lean) * z
    across = math.cos(lean) * z - math.sin(lean) * left
    return Frame3(place, along, normal, across, abs(end - start), part.get("bow", 0.0))


def _leaning(
    tables: Tables, pose: Pose, part: Mapping[str, Any], faces: Iterable[Face]
) -> Iterator[Face]:
    """The faces of a part that leans, from those of one that does not."""
    straight = frame_of(tables, pose, {**part, "lean": 0.0})
    leaning = frame_of(tables, pose, part)
    turn = sum(np.outer(new, old) for new, old in zip(leaning[1:4], straight[1:4], strict=True))
    for face in faces:
        corners = straight.origin + (face.corners - straight.origin) @ np.transpose(turn)
        yield face._replace(corners=corners)


def _mirror_faces(
    mirror: Mapping[str, Any], index: int, line: tuple[complex, complex]
) -> Iterator[Face]:
    """One face, or the strips of a bowed mirror."""
    start, end = line
    bow = mirror.get("bow", 0.0) * (-1 if mirror.get("side") == "right" else 1)
    places = np.linspace(-1, 1, STRIPS + 1 if bow else 2)
    normal = 1j * (end - start) / abs(end - start)
    points = (start + end) / 2 + (end - start) / 2 * places + normal * bow * (1 - places**2)
    material = "two-sided mirror" if mirror.get("side", "both") == "both" else "mirror"
    for one, other in itertools.pairwise(points.tolist()):
        yield Face("mirror", mirror["name"], strip(one, other, -REACH, REACH), material, index)


def faces_of(
    tables: Tables,
    pose: Pose,
    only: int | None = None,
    spare: float = 0,
    lamps: bool = False,
    housing: bool = False,
) -> list[Face]:
    """All faces of a scene in a pose.

    Args:
        tables: of the scene's file.
        pose: its joint angles.
        only: a pad that is to be alone with the mirrors.
        spare: how far its surfaces go on, without ends, beyond where they end, mm.
        lamps: whether the pads have theirs.
        housing: whether there are walls on both sides of everything.
    """
    found: list[Face] = []
    for index, mirror in enumerate(tables.get("mirrors", [])):
        if "radius" in mirror:
            raise ValueError(f"mirror {mirror['name']} is curved, and the judge's faces are flat")
        faces = _mirror_faces(mirror, index, _line(tables, pose, mirror))
        found += _leaning(tables, pose, mirror, faces)
    for index, pad in enumerate(tables.get("pads", [])):
        if only in (None, index):
            line = _line(tables, pose, pad)
            faces = [*_pad_faces(pad, index, line, None if only is None else spare)]
            faces += _lamps(pad, index, line) if lamps and not pad.get("layers") else []
            faces = faces if lamps else [face._replace(lamp=-1) for face in faces]
            found += _leaning(tables, pose, pad, faces)
    if only is None:
        for part in tables.get("blockers", []):
            corners = strip(*_line(tables, pose, part), -REACH, REACH)
            open_behind = part.get("side", "both") != "both"
            found.append(Face("blocker", part["name"], corners, open_behind=open_behind))
    if housing:
        widest = max(pad.get("width", WIDTH) for pad in tables["pads"])
        square = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * 4 * REACH
        for z in (-1, 1):
            beside = [0, 0, z * (widest / 2 + GAP + ROOM)]
            found.append(Face("blocker", "housing", square + beside))
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
        clear: whether its first and its last end are, and its sides.
        names: of these ends.
        number: counted from the camera's side.
    """

    low: float
    high: float
    bottom: tuple[float, float]
    top: tuple[float, float]
    refraction: float
    clear: tuple[bool, bool, bool]
    names: tuple[str, str]
    number: int


def layers_of(pad: Mapping[str, Any], length: float) -> list[Layer]:
    """A pad's layers from the membrane upwards; x runs with the sensing side on the left."""
    flip = -1 if pad.get("side") == "right" else 1
    made, low, tables = [], 0.0, pad.get("layers", [])
    for number, table in reversed(list(enumerate(tables, 1))):
        over, bevel = (both_ends(table.get(key, 0))[::flip] for key in ("overhang", "bevel_deg"))
        names = ("from", "to") if flip > 0 else ("to", "from")
        sides = table.get("sides", "black")
        first, last, beside = (
            (sides if isinstance(sides, str) else sides.get(name, "")) == "clear"
            for name in (*names, "beside")
        )
        index, high = table["index"], low + table["thickness"]
        cut = [table["thickness"] * math.tan(math.radians(angle)) for angle in bevel]
        bottom = -over[0], length + over[1]
        top = bottom[0] + cut[0], bottom[1] - cut[1]
        green = float(index["green"] if isinstance(index, Mapping) else index)
        made.append(Layer(low, high, bottom, top, green, (first, last, beside), names, number))
        low = high
    return made


def _pad_faces(
    pad: Mapping[str, Any], part: int, line: tuple[complex, complex], spare: float | None
) -> Iterator[Face]:
    """Membrane, layers and bezel of one pad, or, with room to spare, levels without ends.

    What goes on beyond its edges hides nothing behind it: a whole pad would not be there.
    """
    start, end = line
    along, half = (end - start) / abs(end - start), float(pad.get("width", WIDTH)) / 2
    name, length, room = pad["name"], abs(end - start), spare or 0.0
    layers = layers_of(pad, length)

    def at(x: float, y: float) -> complex:
        return start + along * complex(x, y)

    def flat(y: float, left: float, right: float, z: float = half) -> np.ndarray:
        return strip(at(left, y), at(right, y), -z, z)

    def body(what: str, corners: np.ndarray) -> Face:
        return Face("body", f"{what} of pad {name}", corners, part=part)

    one_sided = pad.get("side", "both") != "both"
    membrane = flat(0, -room, length + room, half + room)
    sides = {"one_sided": one_sided, "open_behind": spare is not None}
    yield Face("membrane", f"pad {name}", membrane, part=part, **sides)
    first, last, height = _bezel(pad)
    for lower, upper in zip(layers, [*layers[1:], None], strict=False):
        # A level is clear where both layers lie on it, or between the lips, and opaque elsewhere.
        free = lower.top[0] + first, lower.top[1] - last
        edges = list(zip(lower.top, upper.bottom if upper else free, strict=True))
        low, high, side = max(edges[0]), min(edges[1]), half
        side -= 0 if upper else max(first, last)
        if spare is not None:
            low, high, side = -room, length + room, half + room
        if low < high:
            material = (upper.refraction if upper else 1.0, lower.refraction)
            face = Face(
                "level", "top", flat(lower.high, low, high, side), material, part, not upper
            )
            yield face._replace(open_behind=spare is not None)
        if spare is not None:
            continue
        for one, other in edges:
            if one != other:
                left, right = min(one, other), max(one, other)
                yield body("ledge" if upper else "lip", flat(lower.high, left, right))
        (x0, x1), (x2, x3) = lower.bottom, lower.top
        outline = [at(x0, lower.low), at(x1, lower.low), at(x3, lower.high), at(x2, lower.high)]
        _, right, _, left, nearer, farther = prism(outline, -half, half)
        ends = [f"end '{name}' of layer {lower.number}" for name in lower.names]
        walls = (left, right, nearer[::-1], farther)
        for clear, what, corners, lamp in zip(
            (*lower.clear, lower.clear[2]),
            (*ends, "side", "side"),
            walls,
            (1, 1, 2, 0),
            strict=True,
        ):
            face, glass = body(what, corners), (1.0, lower.refraction)
            lamp = -1 if "'to'" in what else lamp
            window = face._replace(kind="end", material=glass, outermost=True, lamp=lamp)
            yield window if clear else face
    if not layers or spare is not None:
        return
    for left, right in ((layers[0].bottom[0], 0.0), (length, layers[0].bottom[1])):
        if left < right:
            yield body("underside", flat(0, left, right))
    (left, right), low, wide = layers[-1].top, layers[-1].high, max(first, last)
    for x0, x1, z0, z1 in (
        (left, left + first, -half, half),
        (right - last, right, -half, half),
        (left, right, -half, wide - half),
        (left, right, half - wide, half),
    ):
        if x0 < x1 and z0 < z1 and height > 0:
            high = low + height
            outline = [at(x0, low), at(x1, low), at(x1, high), at(x0, high)]
            yield from (body("lip", corners) for corners in prism(outline, z0, z1))


def _lamps(pad: Mapping[str, Any], part: int, line: tuple[complex, complex]) -> Iterator[Face]:
    """Line lamps in air, beside a pad and before its end "from"; they shine towards it."""
    start, end = line
    length, half = abs(end - start), float(pad.get("width", WIDTH)) / 2
    along = (end - start) / length
    origin, onward = (start, along) if pad.get("side") != "right" else (end, -along)
    for lamp, z in ((0, half + GAP), (2, -half - GAP)):
        places = [(x, y) for x, y in ((0, FOOT), (length, FOOT), (length, TOP), (0, TOP))]
        corners = [start + along * complex(*place) for place in places]
        face = np.array([(place.real, place.imag, z) for place in corners])
        face = face if z < 0 else face[::-1]
        yield Face("lamp", f"lamp of pad {pad['name']}", face, part=part, lamp=lamp)
    up = 1j * along
    foot, top = (origin - GAP * onward + height * up for height in (FOOT, TOP))
    ends = (top, foot) if onward == along else (foot, top)
    yield Face("lamp", f"lamp of pad {pad['name']}", strip(*ends, -half, half), part=part, lamp=1)


def _bezel(pad: Mapping[str, Any]) -> tuple[float, float, float]:
    """How far its lips reach inwards at the first and the last end, and how high they stand."""
    table = pad.get("bezel") or {"lip": 0.0, "height": 0.0}
    first, last = both_ends(table["lip"])
    first, last = (last, first) if pad.get("side") == "right" else (first, last)
    return first, last, table["height"]
