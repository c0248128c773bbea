"""What a camera sees, by shooting rays: plain NumPy, and nothing of the library.

Every ray goes straight to the nearest surface. At a mirror's reflecting side its direction
d becomes d − 2 (d·n) n; at a pad's sensing side it has arrived; everything else swallows it, save
that a one-sided blocker lets it pass from behind.

Neighbouring rays that arrive at one pad over the same mirrors form a run. What they see of the pad
begins and ends between the last ray inside and the next one outside, continued to the pad's line as
if nothing stood in its way; so every run gives an inner and an outer bound.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

CHUNK = 1 << 14
"""Rays that are shot together: few enough to stay in the cache."""

LIFT = 1e-9
"""A ray from a curved mirror meets it again no nearer than this part of its half chord."""


Word = tuple[int, ...]
"""Indices of the mirrors along a path."""


@dataclass(frozen=True)
class Structure:
    """What all scenes of a batch have in common: mirrors, then pads, then blockers.

    Attributes:
        mirrors: how many.
        pads: how many.
        sides: of all surfaces: +1 if the left side reflects, senses or blocks, −1 if the right
            does, 0 if both do.
    """

    mirrors: int
    pads: int
    sides: tuple[int, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all surfaces: m0, m1, …, then p0, …, then b0, …."""
        counts = {"m": self.mirrors, "p": self.pads}
        counts["b"] = len(self.sides) - sum(counts.values())
        return tuple(f"{kind}{i}" for kind, count in counts.items() for i in range(count))

    @property
    def camera(self) -> slice:
        """Where in a row of numbers the camera's position is.

        A row holds the ends of all surfaces, the camera's position, direction and field of view,
        and the least grazing angles of the pads.
        """
        return slice(4 * len(self.sides), 4 * len(self.sides) + 2)

    def words(self, bounces: int) -> list[Word]:
        """Mirrors along every path (`words`)."""
        return words(self.mirrors, bounces)


def words(mirrors: int, bounces: int) -> list[Word]:
    """Mirrors along every path, shortest paths first; no mirror follows itself."""
    return [
        word
        for length in range(bounces + 1)
        for word in itertools.product(range(mirrors), repeat=length)
        if all(a != b for a, b in itertools.pairwise(word))
    ]


@dataclass(frozen=True)
class Fans:
    """Cameras among surfaces, one per scene.

    Attributes:
        ends: of the surfaces, shape (scenes, surfaces, 2, 2).
        position: of the cameras, shape (scenes, 2).
        direction: of the middle of each fan, rad, shape (scenes,).
        width: of each fan, rad, shape (scenes,).
        grazing: least angle between a pad and a ray that it senses, rad, shape (scenes, pads).
    """

    ends: np.ndarray
    position: np.ndarray
    direction: np.ndarray
    width: np.ndarray
    grazing: np.ndarray

    @staticmethod
    def of_rows(structure: Structure, rows: np.ndarray) -> Fans:
        """The scenes of rows of numbers (`Structure.camera`), shape (scenes, inputs)."""
        first = structure.camera.stop
        ends = rows[:, : structure.camera.start].reshape(-1, len(structure.sides), 2, 2)
        camera = rows[:, structure.camera]
        return Fans(ends, camera, rows[:, first], rows[:, first + 1], rows[:, first + 2 :])

    def surfaces(self, structure: Structure, scene: int) -> Surfaces:
        """Those of one scene."""
        ends = [(start, end) for start, end in (self.ends[scene] @ [1, 1j]).tolist()]
        grazing = self.grazing[scene].tolist()
        return Surfaces(ends, structure.sides, structure.mirrors, grazing, {})

    def part(self, scenes: np.ndarray) -> Fans:
        """Some of the scenes."""
        return Fans(*(getattr(self, name)[scenes] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Bounds:
    """Least and greatest part of the pads that can be seen, by the rays.

    Attributes:
        coverage: by any path of at most so many reflections, shape (2, bounces, scenes, pads);
            first the inner, then the outer bound.
        seen: by each path, shape (2, scenes, paths, pads).
        step: longest part of a pad between two neighbouring rays at the end of a run, shape
            (scenes,).
    """

    coverage: np.ndarray
    seen: np.ndarray
    step: np.ndarray


class Runs(NamedTuple):
    """Neighbouring rays that see one pad by one path, in all scenes.

    Attributes:
        scene: of each run, shape (runs,).
        path: index of its mirrors among `Structure.words`.
        pad: which it sees.
        inner: pad coordinates of what its rays show, shape (runs, 2).
        outer: of what can be seen between the neighbouring rays.
        step: longest part of a pad between the rays at an end of a run, shape (scenes,).
    """

    scene: np.ndarray
    path: np.ndarray
    pad: np.ndarray
    inner: np.ndarray
    outer: np.ndarray
    step: np.ndarray


def find_runs(structure: Structure, fans: Fans, rays: int, bounces: int, between: int = 0) -> Runs:
    """Shoot a fan in every scene.

    Args:
        structure: of all scenes.
        fans: the scenes.
        rays: in each fan, spread evenly.
        bounces: most reflections.
        between: how many more rays to shoot between the two at either end of a run.
    """
    words, pads = structure.words(bounces), structure.pads
    found = [_runs(structure, fans, scene, rays, bounces) for scene in range(len(fans.width))]
    scene = np.repeat(np.arange(len(found)), [len(runs) for runs in found])
    label, *turns = np.concatenate(found).T
    code, pad = np.divmod(label.astype(int) - 1, pads)
    number = fans.surfaces(structure, 0).number
    path = np.searchsorted([(number(word, 0) - 1) // pads for word in words], code)

    def spans(turns: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        coordinates = np.empty((len(scene), 4))
        for index, word in enumerate(words):
            for which in range(pads):
                mine = np.flatnonzero((path == index) & (pad == which))
                some = fans.part(scene[mine])
                for column, turn in enumerate(turns):
                    coordinates[mine, column] = follow(structure, some, turn[mine], word, which)[0]
        return _spans(coordinates)

    inner, outer = spans(turns)
    step = np.zeros(len(found))
    np.maximum.at(step, scene, np.max(abs(outer - inner), axis=1, initial=0.0))
    if between:
        inner, outer = spans(_sharpened(structure, fans, scene, label, turns, bounces, between))
    return Runs(scene, path, pad, inner, outer, step)


def bounds(structure: Structure, fans: Fans, rays: int, bounces: int, between: int = 0) -> Bounds:
    """What the runs of every scene show together; otherwise `find_runs`."""
    runs = find_runs(structure, fans, rays, bounces, between)
    lengths = np.array([len(word) for word in structure.words(bounces)])
    shape = len(fans.width), len(lengths), structure.pads
    coverage, seen = np.empty((2, bounces, shape[0], shape[2])), np.empty((2, *shape))
    for side, bound in enumerate((runs.inner, runs.outer)):
        for most in range(1, bounces + 1):
            few = lengths[runs.path] <= most
            groups = (runs.scene * shape[2] + runs.pad)[few]
            found = union(bound[few], groups, shape[0] * shape[2])
            coverage[side, most - 1] = found.reshape(-1, shape[2])
        groups = np.ravel_multi_index((runs.scene, runs.path, runs.pad), shape)
        seen[side] = union(bound, groups, seen[side].size).reshape(shape)
    return Bounds(coverage, seen, runs.step)


def follow(
    structure: Structure, fans: Fans, turn: np.ndarray, word: Word, pad: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays over the lines of given mirrors to that of a pad, whatever else is in their way.

    A ray that has passed such a line is continued backwards to it, so that where it arrives is
    one smooth function of how it begins.

    Args:
        structure: of all scenes.
        fans: the scenes.
        turn: of each ray, one per scene, rad from the middle of its fan.
        word: mirrors along the path.
        pad: where it ends.

    Returns:
        The pad coordinate at which each ray arrives; the length of its way, parts that it goes
        backwards subtracted; and its coordinates on the mirrors, shape (scenes, mirrors of path).
    """
    place, heading = fans.position @ [1, 1j], np.exp(1j * (fans.direction + turn))
    length, met = np.zeros(len(turn)), []
    for index in [*word, structure.mirrors + pad]:
        start, end = (fans.ends[:, index] @ [1, 1j]).T
        step = end - start
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = _cross(heading, step)
            distance = _cross(start - place, step) / cross
            met.append(_cross(start - place, heading) / cross)
            length, place = length + distance, place + distance * heading
            heading = step * np.conj(heading / step)
    reflections = np.stack(met[:-1], axis=1) if word else np.zeros((len(turn), 0))
    return met[-1], length, reflections


def _cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.imag(np.conj(first) * second)


def _labels(
    structure: Structure, fans: Fans, scene: int, turn: np.ndarray, bounces: int
) -> np.ndarray:
    surfaces = fans.surfaces(structure, scene)
    angles, camera = fans.direction[scene] + turn, complex(*fans.position[scene])
    parts = [angles[i : i + CHUNK] for i in range(0, len(angles), CHUNK)]
    found = [cast(surfaces, camera, (np.cos(part), np.sin(part)), bounces)[0] for part in parts]
    return np.concatenate(found)


def _runs(structure: Structure, fans: Fans, scene: int, rays: int, bounces: int) -> np.ndarray:
    """Rows of a scene's runs: label, turns of the first and last ray and of the next ones."""
    grid = fans.width[scene] * ((np.arange(rays) + 0.5) / rays - 0.5)
    label = _labels(structure, fans, scene, grid, bounces)
    cuts = np.flatnonzero(np.diff(label)) + 1
    first, last = np.append(0, cuts), np.append(cuts, rays) - 1
    # Beyond the last ray of the fan, its limit.
    limit = fans.width[scene] / 2
    turns = np.concatenate([[-limit], grid, [limit]])
    rows = np.stack([label[first], *(turns[i] for i in (first + 1, last + 1, first, last + 2))])
    return rows[:, label[first] > 0].T


def _sharpened(
    structure: Structure,
    fans: Fans,
    scene: np.ndarray,
    label: np.ndarray,
    turns: list[np.ndarray],
    bounces: int,
    between: int,
) -> list[np.ndarray]:
    """Turns of the runs' first and last rays and the next ones, nearer to each other."""
    sharp = np.stack(turns)
    for run, which in enumerate(scene.tolist()):
        for inside, outside in ((0, 2), (1, 3)):
            grid = np.linspace(turns[inside][run], turns[outside][run], between)
            found = _labels(structure, fans, which, grid, bounces)
            # The run goes on to before the first ray that is not of it; the last is not.
            end = np.argmax(np.append(found[1:-1] != label[run], True)) + 1
            sharp[[inside, outside], run] = grid[end - 1 : end + 1]
    return list(sharp)


class Surfaces(NamedTuple):
    """What rays meet: mirrors, then pads, then blockers.

    Attributes:
        ends: of all surfaces, complex.
        sides: as those of `Structure`.
        mirrors: how many.
        grazing: least angle between each pad and a ray that it senses, rad.
        arcs: of the curved mirrors, by index: radius at the vertex, and conic constant.
    """

    ends: Sequence[tuple[complex, complex]]
    sides: Sequence[int]
    mirrors: int
    grazing: Sequence[Any]
    arcs: Mapping[int, tuple[float, float]]

    def number(self, word: Sequence[int], pad: int) -> int:
        """The number that stands for a pad seen over some mirrors."""
        path = 0
        for index in word:
            path = self._longer(path, index)
        return path * len(self.grazing) + pad + 1

    def _longer(self, path: int, index: int) -> int:
        """The number of a path that goes on over one more mirror, in digits of their count."""
        return path * (self.mirrors + 1) + index + 1


Pair = tuple[Any, Any]
"""The x and y of rays, arrays; or of the one place that all come from."""


def cast(
    surfaces: Surfaces, camera: Any, heading: Pair, bounces: int
) -> tuple[np.ndarray, np.ndarray]:
    """Follow rays from surface to surface, each to the nearest.

    Args:
        surfaces: what they meet.
        camera: where they come from, complex; one place, or one for each ray.
        heading: their directions, of length 1.
        bounces: most reflections.

    Returns:
        Of each ray the number of path and pad (`Surfaces.number`), or 0 if it arrives nowhere, and
        the coordinate at which it arrives.
    """
    count, mirrors, pads = len(heading[0]), surfaces.mirrors, len(surfaces.grazing)
    label, along = np.zeros(count, np.int64), np.zeros(count)

    def trace(place: Pair, heading: Pair, rays: np.ndarray, path: int, word: list[int]) -> None:
        hit, distance, at = _nearest(surfaces, place, heading, word)
        for index in range(mirrors + pads):
            mine = np.flatnonzero(hit == index)
            if not len(mine):
                continue
            x, y = (part[mine] for part in heading)
            from_x, from_y = (part if np.ndim(part) == 0 else part[mine] for part in place)
            there = from_x + distance[mine] * x, from_y + distance[mine] * y
            left_x, left_y = _normal(surfaces, index, there)
            toward = x * left_x + y * left_y  # negative from the left
            side = surfaces.sides[index]
            right = toward * side < 0 if side else np.ones(len(mine), bool)
            if index >= mirrors:
                pad = index - mirrors
                right &= abs(toward) >= np.sin(surfaces.grazing[pad])
                shown = rays[mine[right]]
                label[shown], along[shown] = path * pads + pad + 1, at[mine[right]]
            elif len(word) < bounces:
                twice = 2 * toward
                bent = (x - twice * left_x)[right], (y - twice * left_y)[right]
                onward = there[0][right], there[1][right]
                further = surfaces._longer(path, index)
                trace(onward, bent, rays[mine[right]], further, [*word, index])

    trace((camera.real, camera.imag), heading, np.arange(count), 0, [])
    return label, along


def _nearest(
    surfaces: Surfaces, place: Pair, heading: Pair, word: list[int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The surface that each ray meets first (−1 for none), how far it is, and where on it."""
    count = len(heading[0])
    nearest, hit, coordinate = np.full(count, np.inf), np.full(count, -1, np.int8), np.zeros(count)
    passing = surfaces.mirrors + len(surfaces.grazing)
    for index, (start, end) in enumerate(surfaces.ends):
        if index in surfaces.arcs:
            candidates = _arc(surfaces, index, place, heading)
        elif index in word[-1:]:
            continue
        else:
            one_way = surfaces.sides[index] if index >= passing else 0
            candidates = [_segment(start, end, one_way, place, heading)]
        for distance, along, met in candidates:
            met = met & (distance < nearest)
            np.copyto(nearest, distance, where=met)
            np.copyto(coordinate, along, where=met)
            hit[met] = index
    return hit, nearest, coordinate


def _segment(
    start: complex, end: complex, one_way: int, place: Pair, heading: Pair
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    step_x, step_y = (end - start).real, (end - start).imag
    (x, y), arrow_x, arrow_y = heading, start.real - place[0], start.imag - place[1]
    # Rays along a surface divide by 0, and what comes of it is in no range.
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = x * step_y - y * step_x
        inverse = 1 / cross
        distance = (arrow_x * step_y - arrow_y * step_x) * inverse
        along = (arrow_x * y - arrow_y * x) * inverse
        met = (distance > 0) & (along >= 0) & (along <= 1)
    if one_way:
        met &= cross * one_way > 0  # it lets pass what comes from behind
    return distance, along, met


def _frame(surfaces: Surfaces, index: int) -> tuple[complex, complex, float, float, float]:
    """Vertex and direction of an arc, half its chord, its curvature, and 1 + conic constant."""
    start, end = surfaces.ends[index]
    radius, conic = surfaces.arcs[index]
    half = abs(end - start) / 2
    along = (end - start) / (2 * half)
    sag = half**2 / (radius * (1 + np.sqrt(1 - (1 + conic) * (half / radius) ** 2)))
    return (start + end) / 2 - 1j * along * sag, along, half, 1 / radius, 1 + conic


def _arc(
    surfaces: Surfaces, index: int, place: Pair, heading: Pair
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Both places where a ray meets the conic c x² + c s y² = 2 y in the frame of the arc."""
    vertex, along, half, c, s = _frame(surfaces, index)
    p = (place[0] + 1j * place[1] - vertex) / along
    d = (heading[0] + 1j * heading[1]) / along
    squared = c * (d.real**2 + s * d.imag**2)
    halved = c * (p.real * d.real + s * p.imag * d.imag) - d.imag
    constant = c * (p.real**2 + s * p.imag**2) - 2 * p.imag
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(halved**2 - squared * constant)
        q = -(halved + np.copysign(root, halved))
        roots = constant / q, q / squared
    found = []
    for distance in roots:
        distance = np.where(np.isfinite(distance), distance, 0.0)  # a distance of 0 is no meeting
        at = p + distance * d
        met = (distance > LIFT * half) & (np.abs(at.real) <= half) & (c * s * at.imag < 1)
        found.append((distance, at.real / (2 * half) + 0.5, met))
    return found


def _normal(surfaces: Surfaces, index: int, place: Pair) -> Pair:
    """Unit normal to the left of a surface, at places on it."""
    if index not in surfaces.arcs:
        start, end = surfaces.ends[index]
        left = 1j * (end - start) / abs(end - start)
        return left.real, left.imag
    vertex, along, _, c, s = _frame(surfaces, index)
    at = (place[0] + 1j * place[1] - vertex) / along
    left = along * (-c * at.real + 1j * (1 - c * s * at.imag))
    left = left / np.abs(left)
    return left.real, left.imag


def _spans(coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inner and outer pieces, shape (runs, 2), of pad coordinates of first, last and next rays."""
    inner = np.sort(np.clip(coordinates[:, :2], 0, 1), axis=1)
    before, after = coordinates[:, 2], coordinates[:, 3]
    rises = after > before
    low, high = np.where(rises, before, after), np.where(rises, after, before)
    # Next rays between which some ray is parallel to the pad bound nothing.
    lost = ~((low <= inner[:, 0]) & (high >= inner[:, 1]))
    outer = np.stack([np.where(lost, 0.0, low), np.where(lost, 1.0, high)], axis=1)
    return inner, np.clip(outer, 0, 1)


def union(spans: np.ndarray, groups: np.ndarray, count: int) -> np.ndarray:
    """Measure of the union of the spans, all within 0 … 1, of each of ``count`` groups."""
    # Side by side on one line; a shift of up to 1e6 rounds to 1e-10.
    spans = spans + 2 * groups[:, None]
    order = np.argsort(spans[:, 0], kind="stable")
    start, end = spans[order].T
    reached = np.maximum.accumulate(np.append(-np.inf, end))[:-1]
    fresh = np.maximum(end - np.maximum(start, reached), 0)
    return np.bincount(groups[order], fresh, count)
