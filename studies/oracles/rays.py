"""What a camera sees, by shooting rays: plain NumPy, and nothing of the library.

Every ray of a fan goes straight to the nearest surface. At a mirror's reflecting side its direction
d becomes d − 2 (d·n) n; at a pad's sensing side it has arrived; everything else swallows it, save
that a one-sided blocker lets it pass from behind.

Neighbouring rays that arrive at one pad over the same mirrors form a run. What they see of the pad
begins and ends between the last ray inside and the next one outside, continued to the pad's line as
if nothing stood in its way; so every run gives an inner and an outer bound.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

CHUNK = 20_000
"""Rays that are shot together: few enough to stay in the cache."""


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

    def words(self, bounces: int) -> list[tuple[int, ...]]:
        """Mirrors along every path, shortest paths first; no mirror follows itself."""
        return [
            word
            for length in range(bounces + 1)
            for word in itertools.product(range(self.mirrors), repeat=length)
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


def bounds(structure: Structure, fans: Fans, rays: int, bounces: int, between: int = 0) -> Bounds:
    """Shoot a fan in every scene.

    Args:
        structure: of all scenes.
        fans: the scenes.
        rays: in each fan, spread evenly.
        bounces: most reflections.
        between: how many more rays to shoot between the two at either end of a run.
    """
    words = structure.words(bounces)
    scenes, paths, pads = len(fans.width), len(words), structure.pads
    found = [_runs(structure, fans, scene, rays, words) for scene in range(scenes)]
    scene = np.repeat(np.arange(scenes), [len(runs) for runs in found])
    label, *turns = np.concatenate(found).T
    path, pad = np.divmod(label.astype(int) - 1, pads)

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
    step = np.zeros(scenes)
    np.maximum.at(step, scene, np.max(abs(outer - inner), axis=1, initial=0.0))
    if between:
        inner, outer = spans(_sharpened(structure, fans, scene, label, turns, words, between))
    lengths = np.array([len(word) for word in words])[path]
    coverage = np.empty((2, bounces, scenes, pads))
    seen = np.empty((2, scenes, paths, pads))
    for side, bound in enumerate((inner, outer)):
        for most in range(1, bounces + 1):
            few = lengths <= most
            groups = (scene * pads + pad)[few]
            coverage[side, most - 1] = _union(bound[few], groups, scenes * pads).reshape(-1, pads)
        groups = (scene * paths + path) * pads + pad
        seen[side] = _union(bound, groups, seen[side].size).reshape(scenes, paths, pads)
    return Bounds(coverage, seen, step)


def follow(
    structure: Structure, fans: Fans, turn: np.ndarray, word: tuple[int, ...], pad: int
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
    place, angle = fans.position, fans.direction + turn
    heading = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    length, met = np.zeros(len(turn)), []
    for index in [*word, structure.mirrors + pad]:
        start, step = fans.ends[:, index, 0], fans.ends[:, index, 1] - fans.ends[:, index, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = _cross(heading, step)
            distance = _cross(start - place, step) / cross
            met.append(_cross(start - place, heading) / cross)
        length = length + distance
        place = place + distance[:, None] * heading
        normal = np.stack([-step[:, 1], step[:, 0]], axis=1)
        square = np.sum(step * step, axis=1)
        along = np.sum(heading * normal, axis=1) / np.where(square > 0, square, 1.0)
        heading = heading - 2 * along[:, None] * normal
    reflections = np.stack(met[:-1], axis=1) if word else np.zeros((len(turn), 0))
    return met[-1], length, reflections


def _cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]


def _runs(
    structure: Structure, fans: Fans, scene: int, rays: int, words: list[tuple[int, ...]]
) -> np.ndarray:
    """Rows of a scene's runs: label, turns of the first and last ray and of the next ones."""
    grid = fans.width[scene] * ((np.arange(rays) + 0.5) / rays - 0.5)
    label = np.concatenate(
        [
            _labels(structure, fans, scene, fans.direction[scene] + grid[i : i + CHUNK], words)
            for i in range(0, rays, CHUNK)
        ]
    )
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
    words: list[tuple[int, ...]],
    between: int,
) -> list[np.ndarray]:
    """Turns of the runs' first and last rays and the next ones, nearer to each other."""
    sharp = np.stack(turns)
    for run, which in enumerate(scene.tolist()):
        for inside, outside in ((0, 2), (1, 3)):
            grid = np.linspace(turns[inside][run], turns[outside][run], between)
            found = _labels(structure, fans, which, fans.direction[which] + grid, words)
            # The run goes on to before the first ray that is not of it; the last is not.
            end = np.argmax(np.append(found[1:-1] != label[run], True)) + 1
            sharp[[inside, outside], run] = grid[end - 1 : end + 1]
    return list(sharp)


def _labels(
    structure: Structure, fans: Fans, scene: int, angles: np.ndarray, words: list[tuple[int, ...]]
) -> np.ndarray:
    """Of each ray 1 + (path · pads + pad), or 0 if it arrives nowhere."""
    labels = np.zeros(len(angles), np.int16)
    starts = fans.ends[scene, :, 0].tolist()
    steps = (fans.ends[scene, :, 1] - fans.ends[scene, :, 0]).tolist()
    pads = range(structure.mirrors, structure.mirrors + structure.pads)

    def trace(
        place: tuple[Any, Any],
        heading: tuple[np.ndarray, np.ndarray],
        rays: np.ndarray,
        word: tuple[int, ...],
    ) -> None:
        hit, distance = _nearest(structure, starts, steps, place, heading, word)
        for index in range(pads.stop):
            of_hit = np.flatnonzero(hit == index)
            if not len(of_hit):
                continue
            (step_x, step_y), (x, y) = steps[index], (part[of_hit] for part in heading)
            length = np.hypot(step_x, step_y)
            # notation: sine of the angle from the ray to the surface; positive from its left.
            sine = (y * step_x - x * step_y) / -length
            side = structure.sides[index]
            right = sine * side > 0 if side else np.ones(len(of_hit), bool)
            if index in pads:
                pad = index - structure.mirrors
                right &= abs(sine) >= np.sin(fans.grazing[scene, pad])
                labels[rays[of_hit[right]]] = 1 + words.index(word) * structure.pads + pad
            elif len(word) < len(words[-1]):
                of_hit, sine, x, y = of_hit[right], sine[right], x[right], y[right]
                origin = [part if np.ndim(part) == 0 else part[of_hit] for part in place]
                way = distance[of_hit]
                there = (origin[0] + way * x, origin[1] + way * y)
                # notation: d − 2 (d·n) n with n the normal on the left, −sine = d·n.
                twice = 2 * sine / length
                bent = (x - twice * step_y, y + twice * step_x)
                trace(there, bent, rays[of_hit], (*word, index))

    heading = (np.cos(angles), np.sin(angles))
    trace(tuple(fans.position[scene].tolist()), heading, np.arange(len(angles)), ())
    return labels


def _nearest(
    structure: Structure,
    starts: list[list[float]],
    steps: list[list[float]],
    place: tuple[Any, Any],
    heading: tuple[np.ndarray, np.ndarray],
    word: tuple[int, ...],
) -> tuple[np.ndarray, np.ndarray]:
    """Which surface each ray meets first, −1 for none, and how far away."""
    (place_x, place_y), (x, y) = place, heading
    nearest, hit = np.full(len(x), np.inf), np.full(len(x), -1, np.int8)
    passing = structure.mirrors + structure.pads
    for index, ((start_x, start_y), (step_x, step_y)) in enumerate(zip(starts, steps, strict=True)):
        if index in word[-1:]:
            continue
        arrow_x, arrow_y = start_x - place_x, start_y - place_y
        # Rays along a surface divide by 0, and what comes of it is in no range.
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = x * step_y - y * step_x
            inverse = 1 / cross
            distance = (arrow_x * step_y - arrow_y * step_x) * inverse
            along = (arrow_x * y - arrow_y * x) * inverse
            met = (distance > 0) & (distance < nearest) & (along >= 0) & (along <= 1)
        if index >= passing and structure.sides[index]:
            met &= cross * structure.sides[index] > 0
        np.copyto(nearest, distance, where=met)
        hit[met] = index
    return hit, nearest


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


def _union(spans: np.ndarray, groups: np.ndarray, count: int) -> np.ndarray:
    """Measure of the union of the spans, all within 0 … 1, of each of ``count`` groups."""
    # Side by side on one line; a shift of up to 1e6 rounds to 1e-10.
    spans = spans + 2 * groups[:, None]
    order = np.argsort(spans[:, 0], kind="stable")
    start, end = spans[order].T
    reached = np.maximum.accumulate(np.append(-np.inf, end))[:-1]
    fresh = np.maximum(end - np.maximum(start, reached), 0)
    return np.bincount(groups[order], fresh, count)
