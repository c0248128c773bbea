"""What a camera sees, by shooting rays: plain NumPy, written apart from the library.

Every ray goes straight to the nearest surface. At a mirror's reflecting side its direction d
becomes d − 2 (d·n) n; a pad's sensing side is a hit; everything else swallows it. Neighbouring rays
that reach the same pad over the same mirrors form a run; the piece of the pad that they see begins
and ends somewhere between the last ray inside and the next one outside, continued to the pad's line
as if nothing had come in its way. So every run gives an inner and an outer bound of what is seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Surfaces:
    """Mirrors, then pads, then blockers: ends (n, 2, 2), sides (+1 left, −1 right, 0 both)."""

    ends: np.ndarray
    sides: np.ndarray
    mirrors: int
    pads: int
    grazing: np.ndarray


@dataclass(frozen=True)
class Run:
    """Neighbouring rays that see one pad by one path; pad coordinates."""

    path: tuple[int, ...]
    pad: int
    inner: tuple[float, float]
    outer: tuple[float, float]


def shoot(
    surfaces: Surfaces,
    position: np.ndarray,
    direction: float,
    field_of_view: float,
    rays: int,
    bounces: int,
) -> list[Run]:
    """All runs of a fan of rays spread evenly over the field of view."""
    angles = direction + field_of_view * ((np.arange(rays) + 0.5) / rays - 0.5)
    place = np.broadcast_to(position, (rays, 2)).copy()
    heading = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    code = np.zeros(rays, np.int64)  # mirrors so far, as digits
    pad = np.full(rays, -1)
    alive = np.arange(rays)
    last = np.full(rays, -1)
    base = surfaces.mirrors + 1
    for bounce in range(bounces + 1):
        nearest, hit = _nearest(surfaces, place[alive], heading[alive], last[alive])
        point = place[alive] + nearest[:, None] * heading[alive]
        is_pad = (hit >= surfaces.mirrors) & (hit < surfaces.mirrors + surfaces.pads)
        is_mirror = (hit >= 0) & (hit < surfaces.mirrors)
        _, step, side = _data(surfaces, hit)
        from_left = step[:, 0] * heading[alive][:, 1] - step[:, 1] * heading[alive][:, 0] < 0
        right_side = (side == 0) | ((side > 0) == from_left)
        length = np.linalg.norm(step, axis=1)
        sine = np.abs(
            step[:, 0] * heading[alive][:, 1] - step[:, 1] * heading[alive][:, 0]
        ) / np.where(length > 0, length, 1)
        least = np.zeros(len(alive))
        least[is_pad] = surfaces.grazing[hit[is_pad] - surfaces.mirrors]
        seen = is_pad & right_side & (sine >= np.sin(least))
        pad[alive[seen]] = hit[seen] - surfaces.mirrors
        on = is_mirror & right_side
        if bounce == bounces or not on.any():
            break
        normal = np.stack([-step[:, 1], step[:, 0]], axis=1) / length[:, None].clip(1e-300)
        bent = heading[alive] - 2 * np.sum(heading[alive] * normal, axis=1)[:, None] * normal
        place[alive[on]], heading[alive[on]] = point[on], bent[on]
        code[alive[on]] = code[alive[on]] * base + hit[on] + 1
        last[alive[on]] = hit[on]
        alive = alive[on]
    return _runs(surfaces, position, angles, code, pad, base)


def coverage(runs: list[Run], pads: int) -> tuple[np.ndarray, np.ndarray]:
    """Inner and outer bound of the part of each pad that is seen by any path."""
    inner = [_union([run.inner for run in runs if run.pad == pad]) for pad in range(pads)]
    outer = [_union([run.outer for run in runs if run.pad == pad]) for pad in range(pads)]
    return np.array(inner), np.array(outer)


def _union(pieces: list[tuple[float, float]]) -> float:
    total, reached = 0.0, -np.inf
    for start, end in sorted(pieces):
        total += max(0.0, end - max(start, reached))
        reached = max(reached, end)
    return total


def _data(surfaces: Surfaces, hit: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    ends = surfaces.ends[hit]
    return ends[:, 0], ends[:, 1] - ends[:, 0], surfaces.sides[hit]


def _nearest(
    surfaces: Surfaces, place: np.ndarray, heading: np.ndarray, last: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    nearest, hit = np.full(len(place), np.inf), np.full(len(place), -1)
    for index, (a, b) in enumerate(surfaces.ends):
        step = b - a
        cross = heading[:, 0] * step[1] - heading[:, 1] * step[0]
        arrow = a - place
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (arrow[:, 0] * step[1] - arrow[:, 1] * step[0]) / cross
            along = (arrow[:, 0] * heading[:, 1] - arrow[:, 1] * heading[:, 0]) / cross
        ok = (cross != 0) & (distance > 0) & (along >= 0) & (along <= 1) & (last != index)
        if index >= surfaces.mirrors + surfaces.pads and surfaces.sides[index]:
            ok &= (cross > 0) == (surfaces.sides[index] > 0)  # it lets rays pass from behind
        better = ok & (distance < nearest)
        nearest[better], hit[better] = distance[better], index
    return nearest, hit


def _runs(
    surfaces: Surfaces,
    position: np.ndarray,
    angles: np.ndarray,
    code: np.ndarray,
    pad: np.ndarray,
    base: int,
) -> list[Run]:
    label = np.where(pad >= 0, code * (surfaces.pads + 1) + pad + 1, 0)
    cuts = np.flatnonzero(np.diff(label)) + 1
    firsts, lasts = np.append(0, cuts), np.append(cuts, len(label)) - 1
    half = (angles[1] - angles[0]) / 2
    runs = []
    for first, last in zip(firsts, lasts, strict=True):
        if label[first] == 0:
            continue
        path, rest = [], int(code[first])
        while rest:
            rest, digit = divmod(rest, base)
            path.insert(0, digit - 1)
        # At an end of the field of view the next ray is half a step away.
        before = angles[first] - 2 * half if first > 0 else angles[0] - half
        after = angles[last] + 2 * half if last < len(label) - 1 else angles[-1] + half
        at = np.array([angles[first], angles[last], before, after])
        u = _continued(surfaces, position, at, path, int(pad[first]))
        inner = tuple(sorted(np.clip(u[:2], 0, 1)))
        outer = tuple(sorted(u[2:])) if np.isfinite(u).all() else (0.0, 1.0)
        if outer[1] < inner[1] or outer[0] > inner[0]:  # a neighbour that goes the other way
            outer = (min(inner[0], 0.0), max(inner[1], 1.0))
        outer = tuple(np.clip(outer, 0, 1))
        runs.append(Run(tuple(path), int(pad[first]), inner, outer))
    return runs


def _continued(
    surfaces: Surfaces, position: np.ndarray, angles: np.ndarray, path: list[int], pad: int
) -> np.ndarray:
    """Pad coordinates at which rays over a path meet the pad's line; NaN if they never do."""
    place = np.broadcast_to(position, (len(angles), 2)).copy()
    heading = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    along = np.full(len(angles), np.nan)
    for index in [*path, surfaces.mirrors + pad]:
        a, b = surfaces.ends[index]
        step = b - a
        cross = heading[:, 0] * step[1] - heading[:, 1] * step[0]
        arrow = a - place
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (arrow[:, 0] * step[1] - arrow[:, 1] * step[0]) / cross
            along = (arrow[:, 0] * heading[:, 1] - arrow[:, 1] * heading[:, 0]) / cross
        along[~(distance > 0)] = np.nan
        if index < surfaces.mirrors:
            place = place + distance[:, None] * heading
            normal = np.array([-step[1], step[0]]) / np.linalg.norm(step)
            heading = heading - 2 * (heading @ normal)[:, None] * normal
            place[np.isnan(along)] = np.nan
    return along
