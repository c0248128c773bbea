"""What a camera sees of pads under clear layers, by rays that Snell's law bends at every face.

Every ray goes straight to the nearest face that looks at the medium it is in. A mirror reflects it,
clear material bends it, a membrane senses it, and all else ends it: backs of mirrors and pads,
blockers, black ends, ledges, the bezel's lips, an end of a layer or the outermost surface met from
inside, and total reflection. Nothing is unfolded, and no way through a layer is known beforehand.

Rays start on the optical axis, where the entrance pupil is for their angle. A mirror under layers
reflects at their back: a ray is bent on its way in and out.

A face has a front, the medium from which it is met, and what is behind it; from behind, it is not
there. So a mirror is two faces, one that reflects and its back, and so is a surface between two
layers.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from studies.oracles.rays import Word, union

AIR = 0
"""The medium around everything; layers are the numbers that follow."""
SOLID, MIRROR, MEMBRANE = -1, -2, -3
"""What is behind a face that no ray passes."""
OUT = -4
"""Behind a mirror's surface met from inside: air, into which light leaves."""

BESIDE = 1e-6
"""Angle between the ends of faces and the rays that go past them, rad."""
REFINED = 2
"""How often rays are shot between neighbours that end differently."""
PARTS = 15
"""Into how many parts rays divide the angle between two others: odd, so that none meets a corner
that both pass."""
AIMS = 30
"""How often rays that go past the ends of faces are aimed anew from where they start."""
ROUNDS = 10
"""How often the angle at the end of a run is divided: to 15⁻¹² of that between rays of the fan."""

Pair = tuple[float, float]
"""Of the ends at ``from`` and at ``to``."""


@dataclass(frozen=True)
class Layer:
    """A clear layer.

    Attributes:
        thickness: mm.
        index: of refraction, for the light that is followed.
        overhang: of its membrane-side surface beyond the membrane's ends, mm.
        bevel: of its end faces, rad; positive: shorter on the camera's side.
        clear: whether its end faces are.
    """

    thickness: float
    index: float
    overhang: Pair = (0.0, 0.0)
    bevel: Pair = (0.0, 0.0)
    clear: tuple[bool, bool] = (False, False)

    def spans(self, length: float) -> tuple[Pair, Pair]:
        """Where its membrane-side and its camera-side surface begin and end along the pad, mm."""
        cut = [self.thickness * np.tan(angle) for angle in self.bevel]
        lower = -self.overhang[0], length + self.overhang[1]
        return lower, (lower[0] + cut[0], lower[1] - cut[1])


class Surface(NamedTuple):
    """A mirror or a blocker; a place is x + iy, mm.

    Attributes:
        start: one end.
        end: the other.
        side: +1 if the left side reflects or blocks, −1 if the right does, 0 if both do.
        layers: of a mirror that reflects at their back, from the outside on; side is not 0.
    """

    start: complex
    end: complex
    side: int
    layers: tuple[Layer, ...] = ()


class Pad(NamedTuple):
    """A membrane, and what is on it.

    Attributes:
        start: of the membrane.
        end: of it.
        side: the side that senses, as that of `Surface`; with layers not 0.
        grazing: least angle in air between a ray and the surface that it enters, rad.
        transmission: least part of the light that reaches the membrane.
        layers: from the camera's side to the membrane.
        lip: of the bezel, what it covers of the outermost surface, mm.
        height: of its lips, mm.
    """

    start: complex
    end: complex
    side: int
    grazing: float = 0.0
    transmission: float = 0.0
    layers: tuple[Layer, ...] = ()
    lip: Pair = (0.0, 0.0)
    height: float = 0.0


Span = tuple[float, float, int]
"""From where to where along a pad there is some medium."""


class Face(NamedTuple):
    """One side of a surface.

    Attributes:
        owner: m0, m1, … for mirrors, p0, … for pads, b0, … for blockers, s0, … for what lies on
            mirrors or behind them.
        part: of a pad: ``membrane``; ``outer``, the first layer's surface towards the camera, and
            ``level 1``, … that of the others; ``from 0``, ``to 0``, … ends of layers; ``lip``.
        start: one end of it.
        end: the other.
        side: +1 if its front is to the left, −1 if to the right.
        front: the medium in front of it.
        behind: the medium behind it, or what ends or reflects the ray.
    """

    owner: str
    part: str
    start: complex
    end: complex
    side: int
    front: int
    behind: int


class Table(NamedTuple):
    """All faces of a scene as columns.

    Attributes:
        start: x and y of one end.
        step: x and y of the way to the other end; turned round where the front is to the right.
        side: as that of `Face`.
        owner: the number of the mirror, pad or blocker among all of them, in this order.
        front: the medium in front.
        behind: what is behind.
        normal: towards the front, of length 1.
        ratio: index of refraction in front, in parts of that behind, where there is a medium.
        looking: of each medium, the faces that look at it.
        glass: whether it is of a mirror's layers.
    """

    start: np.ndarray
    step: np.ndarray
    side: np.ndarray
    owner: np.ndarray
    front: np.ndarray
    behind: np.ndarray
    normal: np.ndarray
    ratio: np.ndarray
    looking: list[np.ndarray]
    glass: np.ndarray


class Seen(NamedTuple):
    """How rays from the camera end, arrays of one entry for each ray.

    Attributes:
        seen: whether it reaches a membrane, steeply and bright enough.
        path: the mirrors on its way, as a number (`Scene.word`).
        entrance: index of the pad's face (`Scene.faces`) that it meets in air; −1 if none.
        end: index of the face where it ends; −1 if none.
        at: the coordinate on the membrane, 0 … 1; NaN if it reaches none.
        grazing: angle in air between it and its entrance, rad; NaN if there is none.
        transmission: part of unpolarised light that all surfaces on its way let through.
        heading: its last direction, of length 1.
    """

    seen: np.ndarray
    path: np.ndarray
    entrance: np.ndarray
    end: np.ndarray
    at: np.ndarray
    grazing: np.ndarray
    transmission: np.ndarray
    heading: np.ndarray


class Run(NamedTuple):
    """Neighbouring rays that see one pad over the same mirrors through one face.

    Attributes:
        word: the mirrors.
        pad: its index.
        entrance: part of the pad (`Face`) through which it is seen.
        angles: of its first and last ray, counter-clockwise from the optical axis, rad.
        at: the coordinates on the membrane that they reach.
    """

    word: Word
    pad: int
    entrance: str
    angles: Pair
    at: Pair


@dataclass(frozen=True)
class Scene:
    """A scene in one pose; a place is x + iy, mm.

    Attributes:
        camera: position of the camera, in air.
        axis: its optical axis, of length 1.
        half: half the field of view, rad.
        mirrors: all of them straight.
        pads: with layers or without.
        blockers: one-sided ones let a ray pass from behind.
        bounces: most reflections of a path.
        pupil: e₂ and e₄: rays at θ from the axis start e₂ θ² + e₄ θ⁴ before the camera, mm.
    """

    camera: complex
    axis: complex
    half: float
    mirrors: Sequence[Surface]
    pads: Sequence[Pad]
    blockers: Sequence[Surface]
    bounces: int
    pupil: Pair = (0.0, 0.0)

    def start(self, angles: np.ndarray) -> np.ndarray:
        """Where rays start, from their angles to the optical axis, rad."""
        square = np.asarray(angles) ** 2
        return self.camera + self.axis * square * (self.pupil[0] + square * self.pupil[1])

    @cached_property
    def faces(self) -> list[Face]:
        """Of everything; media are numbered pad by pad, from the membrane up."""
        found, sheets, medium = [], [], AIR + 1
        for i, mirror in enumerate(self.mirrors):
            if mirror.layers:
                coat, *others = _sheets(f"m{i}", f"s{i}", mirror, medium)
                found.append(coat)
                sheets += others
                medium += len(mirror.layers)
            else:
                found += _sided(f"m{i}", "", mirror, MIRROR)
        for i, pad in enumerate(self.pads):
            found += body(f"p{i}", pad, medium)
            medium += len(pad.layers)
        for i, blocker in enumerate(self.blockers):
            met = _sided(f"b{i}", "", blocker, SOLID)
            found += [face for face in met if blocker.side in (0, face.side)]
        return found + sheets

    @cached_property
    def table(self) -> Table:
        """The faces as columns."""
        owners, _, *columns = zip(*self.faces, strict=True)
        start, end, side, front, behind = map(np.array, columns)
        number = {owner: i for i, owner in enumerate(dict.fromkeys(owners))}
        layers = [layer for on in (*self.mirrors, *self.pads) for layer in reversed(on.layers)]
        index = np.array([1.0, *(layer.index for layer in layers)])
        step = side * (end - start)
        return Table(
            np.stack([np.real(start), np.imag(start)]),
            np.stack([np.real(step), np.imag(step)]),
            side,
            np.array([number[owner] for owner in owners]),
            front,
            behind,
            1j * step / np.abs(step),
            index[front] / index[np.maximum(behind, AIR)],
            [np.flatnonzero(front == medium) for medium in range(len(index))],
            np.array([owner[0] == "s" for owner in owners]),
        )

    def word(self, path: int) -> Word:
        """The mirrors of a path, whose number has their digits, each one more than the index."""
        base = len(self.mirrors) + 1
        return (*self.word(path // base), path % base - 1) if path else ()


def body(owner: str, pad: Pad, medium: int) -> list[Face]:
    """The faces of a pad: its outline, the surfaces between its layers, and its membrane.

    Args:
        owner: its name.
        pad: what it is made of.
        medium: the number of the layer on its membrane; those above it follow.
    """
    if not pad.layers:
        return _sided(owner, "membrane", Surface(pad.start, pad.end, pad.side), MEMBRANE)
    length = abs(pad.end - pad.start)
    along = (pad.end - pad.start) / length

    def placed(place: complex) -> complex:
        return pad.start + along * (place if pad.side > 0 else place.conjugate())

    return [
        Face(owner, part, placed(start), placed(end), side * pad.side, front, behind)
        for part, start, end, side, front, behind in _stack(pad, length, medium)
    ]


def _sheets(owner: str, sheet: str, mirror: Surface, medium: int) -> Iterator[Face]:
    """The coat at the back of a mirror's layers, then its back and the faces of the layers."""
    start, end, side, layers = mirror
    up = 1j * side * (end - start) / abs(end - start)
    yield Face(owner, "", start, end, side, medium, MIRROR)
    yield Face(sheet, "back", start, end, -side, AIR, SOLID)
    for layer in reversed(layers):
        above = start + up * layer.thickness, end + up * layer.thickness
        outermost = layer is layers[0]
        beyond = AIR if outermost else medium + 1
        yield Face(sheet, "surface", *above, side, beyond, medium)
        yield Face(sheet, "surface", *above, -side, medium, OUT if outermost else beyond)
        for foot, head, outward in ((start, above[0], side), (end, above[1], -side)):
            yield Face(sheet, "end", foot, head, outward, AIR, SOLID)
            yield Face(sheet, "end", foot, head, -outward, medium, SOLID)
        (start, end), medium = above, medium + 1


def _sided(owner: str, part: str, surface: Surface, kind: int) -> list[Face]:
    """Both faces of a surface in air: of its kind in front, solid at the back."""
    start, end, chosen, _ = surface
    return [
        Face(owner, part, start, end, side, AIR, kind if chosen in (0, side) else SOLID)
        for side in (1, -1)
    ]


Part = tuple[str, complex, complex, int, int, int]
"""A `Face` without its owner."""


def _stack(pad: Pad, length: float, medium: int) -> Iterator[Part]:
    """The faces of layers on a membrane from 0 to its length, with the camera above."""
    part, level, below = "membrane", 0.0, (0.0, length, MEMBRANE)
    yield from _sheet(part, 0j, complex(length), SOLID, AIR)  # its back
    for number, layer in reversed(list(enumerate(pad.layers))):
        lower, upper = layer.spans(length)
        yield from _level(part, level, below, [(*lower, medium)])
        raised = level + layer.thickness
        for end, left, right in ((0, AIR, medium), (1, medium, AIR)):
            foot, head = lower[end] + 1j * level, upper[end] + 1j * raised
            name = f"{('from', 'to')[end]} {number}"
            yield from _sheet(name, foot, head, left, right, layer.clear[end])
        part, level, below = f"level {number}", raised, (*upper, medium)
        medium += 1
    start, stop, _ = below
    lips = [(start, start + pad.lip[0], SOLID), (stop - pad.lip[1], stop, SOLID)]
    yield from _level("outer", level, below, lips, clear=True)
    for left, right, _ in lips:
        base, rim = 1j * level, 1j * (level + pad.height)
        outline = left + base, left + rim, right + rim, right + base
        for foot, head in itertools.pairwise(outline):
            if foot != head:
                yield from _sheet("lip", foot, head, AIR, SOLID)


def _level(
    part: str, height: float, below: Span, above: Sequence[Span], clear: bool = False
) -> Iterator[Part]:
    """The faces where what is below some height touches what is above it."""
    cuts = sorted({cut for span in (below, *above) for cut in span[:2]})
    for start, stop in itertools.pairwise(cuts):
        left, right = (
            next((medium for a, b, medium in spans if a <= start and stop <= b), AIR)
            for spans in (above, [below])
        )
        yield from _sheet(part, start + 1j * height, stop + 1j * height, left, right, clear)


def _sheet(
    part: str, start: complex, end: complex, left: int, right: int, clear: bool = False
) -> Iterator[Part]:
    """The faces between two media, of which one into a layer from air is shut unless clear."""
    for side, front, behind in ((1, left, right), (-1, right, left)):
        if front >= AIR and front != behind:
            shut = front == AIR and not clear
            yield part, start, end, side, front, SOLID if shut else behind


def follow(scene: Scene, angles: np.ndarray) -> Seen:
    """Follow rays from the camera, each from face to face.

    Snell's law is taken in vectors; of light polarised either way each surface lets through
    1 − r², with Fresnel's amplitude r (Hecht, Optics, 5th ed., 4.6.2), and unpolarised light is
    half of each.

    Args:
        scene: what they meet.
        angles: of the rays, counter-clockwise from the optical axis, rad, shape (rays,).
    """
    table, mirrors, count = scene.table, len(scene.mirrors), len(angles)
    place, heading = scene.start(angles), scene.axis * np.exp(1j * angles)
    medium, bounces, path = np.zeros((3, count), np.int64)
    left, entrance, end = np.full((3, count), -1)  # left: the mirror that the ray comes from
    at, grazing = np.full((2, count), np.nan)
    polarised = np.ones((2, count))  # light polarised across the plane of incidence, and in it
    on = np.arange(count)
    while len(on):
        end[on], along, distance = _nearest(table, place[on], heading[on], medium[on], left[on])
        hit = end[on] >= 0
        on, along = on[hit], along[hit]
        place[on] += distance[hit] * heading[on]
        face, ray = end[on], heading[on]
        behind, normal, ratio = table.behind[face], table.normal[face], table.ratio[face]
        cosine = -np.real(np.conj(normal) * ray)
        # Nothing goes on out of a layer into air, but from a mirror.
        through, senses = (behind > AIR) | (behind == OUT), behind == MEMBRANE
        entering = (table.front[face] == AIR) & (through | senses)
        entrance[on[entering]] = face[entering]
        grazing[on[entering]] = np.arcsin(np.minimum(cosine[entering], 1.0))
        at[on[senses]] = along[senses]
        squared = 1 - ratio**2 * (1 - cosine**2)
        beyond = np.sqrt(np.maximum(squared, 0.0))  # cosine of the angle behind
        across = (ratio * cosine - beyond) / (ratio * cosine + beyond)
        within = (ratio * beyond - cosine) / (ratio * beyond + cosine)
        # What a mirror's layers lose is part of how well it reflects.
        counts = through & ~table.glass[face]
        polarised[:, on[counts]] *= 1 - np.stack([across, within])[:, counts] ** 2
        mirrored = (behind == MIRROR) & (bounces[on] < scene.bounces)
        bent = ratio * ray + (ratio * cosine - beyond) * normal
        turned = np.where(mirrored, ray + 2 * cosine * normal, bent)
        onward = mirrored | (through & (squared > 0))
        on, face, mirrored = on[onward], face[onward], mirrored[onward]
        heading[on] = turned[onward]
        medium[on] = np.where(mirrored, medium[on], np.maximum(behind[onward], AIR))
        left[on] = np.where(mirrored, table.owner[face], -1)
        path[on] = np.where(mirrored, path[on] * (mirrors + 1) + left[on] + 1, path[on])
        bounces[on] += mirrored
    transmission = np.mean(polarised, axis=0)
    limits = np.array([(pad.grazing, pad.transmission) for pad in scene.pads])
    sensed = np.flatnonzero(np.isfinite(at))
    least, dimmest = limits[table.owner[entrance[sensed]] - mirrors].T
    seen = np.zeros(count, bool)
    seen[sensed] = (grazing[sensed] >= least) & (transmission[sensed] >= dimmest)
    return Seen(seen, path, entrance, end, at, grazing, transmission, heading)


def _nearest(
    table: Table, place: np.ndarray, heading: np.ndarray, medium: np.ndarray, left: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The face that each ray meets first (−1 for none), where on it, and how far it is."""
    nearest, (coordinate, least) = np.full(len(place), -1), np.full((2, len(place)), np.inf)
    for which in np.flatnonzero(np.bincount(medium)):
        rays, faces = np.flatnonzero(medium == which), table.looking[which]
        step_x, step_y = table.step[:, faces, None]
        x, y = np.real(heading[rays]), np.imag(heading[rays])
        away_x = table.start[0, faces, None] - np.real(place[rays])
        away_y = table.start[1, faces, None] - np.imag(place[rays])
        cross = x * step_y - y * step_x  # positive where a ray meets the front
        gap = away_x * step_y - away_y * step_x
        along = (away_x * y - away_y * x) * table.side[faces, None]
        met = (gap > 0) & (along >= 0) & (along <= cross) & (cross > 0)
        met &= table.owner[faces, None] != left[rays]
        distance = np.divide(gap, cross, out=np.full(cross.shape, np.inf), where=met)
        first = np.argmin(distance, axis=0), np.arange(len(rays))
        some = met[first]
        least[rays] = distance[first]
        nearest[rays[some]] = faces[first[0][some]]
        coordinate[rays[some]] = along[first][some] / cross[first][some]
    return nearest, coordinate, least


def runs(scene: Scene, rays: int) -> list[Run]:
    """What a fan of rays over the field of view shows, in the order of the angles.

    More rays go past the ends of all faces. Where neighbours end differently the fan is made finer;
    then the angle between the last ray of a run and the next one is divided until it is that of
    rounding. So a run is exact unless it, or a gap in it, is lost between rays.

    Args:
        scene: what is seen.
        rays: in the fan, spread evenly from one limit of the field of view to the other.
    """
    angles, label, at = _fan(scene, rays)
    cuts = np.flatnonzero(label[1:] != label[:-1])
    first, last = np.append(0, cuts + 1), np.append(cuts, len(label) - 1)
    first, last = first[label[first] >= 0], last[label[first] >= 0]
    inside = np.append(first, last)
    outside = np.append(np.maximum(first - 1, 0), np.minimum(last + 1, len(label) - 1))
    label, turn, at, beyond = label[inside], angles[inside], at[inside], angles[outside]
    every = np.arange(len(inside))
    for _ in range(ROUNDS):
        finer = _between(turn, beyond)
        found, there = (part.reshape(finer.shape) for part in _label(scene, finer.ravel()))
        # The run goes on to before the first ray that is not of it; the last is not.
        same = np.column_stack([found == label[:, None], np.zeros(len(every), bool)])
        end = np.argmin(same, axis=1)
        grid = np.column_stack([turn, finer, beyond])
        turn, beyond = grid[every, end], grid[every, end + 1]
        at = np.column_stack([at, there])[every, end]
    ends = np.concatenate([turn, at]).reshape(4, -1)
    return [
        _run(scene, *numbers)
        for numbers in zip(label[: len(first)].tolist(), *ends.tolist(), strict=True)
    ]


def _fan(scene: Scene, rays: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles in order, and of their rays what `_label` returns."""
    ends = np.array([place for face in scene.faces for place in (face.start, face.end)])
    aimed = np.angle((ends - scene.camera) / scene.axis)
    for _ in range(AIMS):
        aimed = np.angle((ends - scene.start(aimed)) / scene.axis)
    aimed = np.append(aimed - BESIDE, aimed + BESIDE)
    even = np.linspace(-scene.half, scene.half, rays)
    angles = np.sort(np.append(even, aimed[np.abs(aimed) < scene.half]))
    label, at = _label(scene, angles)
    for _ in range(REFINED):
        cuts = np.flatnonzero(label[1:] != label[:-1])
        finer = _between(angles[cuts], angles[cuts + 1]).ravel()
        places = np.repeat(cuts + 1, PARTS - 1)
        found = finer, *_label(scene, finer)
        angles, label, at = (
            np.insert(old, places, new) for old, new in zip((angles, label, at), found, strict=True)
        )
    return angles, label, at


def _label(scene: Scene, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A number for the way of each ray, negative unless it sees a pad, and where it sees it."""
    ray, base = follow(scene, angles), len(scene.faces) + 1
    way = (ray.path * base + ray.entrance + 1) * base + ray.end + 1
    return np.where(ray.seen, way, -1 - way), ray.at


def _run(scene: Scene, label: int, first: float, last: float, start: float, end: float) -> Run:
    path, entrance = divmod(label // (len(scene.faces) + 1), len(scene.faces) + 1)
    face = scene.faces[entrance - 1]
    return Run(scene.word(path), int(face.owner[1:]), face.part, (first, last), (start, end))


def _between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Values that divide intervals evenly, shape (intervals, PARTS − 1)."""
    return start[:, None] + (end - start)[:, None] * np.arange(1, PARTS) / PARTS


def coverage(scene: Scene, pieces: Sequence[Run]) -> np.ndarray:
    """The part of each pad that all pieces together show."""
    spans = np.sort(np.array([piece.at for piece in pieces]).reshape(-1, 2), axis=1)
    return union(spans, np.array([piece.pad for piece in pieces], int), len(scene.pads))
