"""The reference: millions of rays in plain NumPy, each followed to the nearest surface.

Neighbouring rays that reach one pad over the same mirrors form a run, and each stands for its share
of the field of view: the run is continued by half a step beyond its outermost rays. So its ends are
right to about half a step, whatever bounds it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from studies.oracles.scenes import Plain

BLOCK = 1 << 14
"""Rays that are followed at a time, so that they stay in the cache."""

NOTHING = -1
LIFT = 1e-9
"""A ray from a curved mirror meets it again no nearer than this part of its half chord."""


class _Rays(NamedTuple):
    """Rays under way: where they are, where they head, where they come from, and which they are."""

    place: np.ndarray
    heading: np.ndarray
    last: np.ndarray
    number: np.ndarray


class Seen(NamedTuple):
    """How much of each pad is seen.

    Attributes:
        coverage: part that is seen by any path.
        redundancy: number of paths by which a point is seen, on average.
    """

    coverage: np.ndarray
    redundancy: np.ndarray


def seen_by_fan(scene: Plain, rays: int) -> Seen:
    """What a fan of rays over the field of view shows of each pad."""
    steps = (2 * np.arange(rays) + 1) / rays - 1
    label, along = np.zeros(rays, np.int64), np.zeros(rays)
    for first in range(0, rays, BLOCK):
        part = slice(first, first + BLOCK)
        heading = scene.axis * np.exp(1j * scene.half * steps[part])
        label[part], along[part] = followed(scene, heading)
    low, high, pad = _runs(label, along, len(scene.pads))
    runs = [(low[pad == i], high[pad == i]) for i in range(len(scene.pads))]
    return Seen(
        np.array([_union(*ends) for ends in runs]), np.array([np.sum(b - a) for a, b in runs])
    )


def followed(scene: Plain, heading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What rays from the camera see, from their directions of length 1.

    Returns:
        0 or a number for path and pad (`number_of`), and the coordinate on the pad.
    """
    mirrors, pads = len(scene.layout.mirrors), len(scene.pads)
    count = len(heading)
    label, along = np.zeros(count, np.int64), np.zeros(count)
    path = np.zeros(count, np.int64)  # the mirrors so far, as digits
    start = np.full(count, scene.camera)
    rays = _Rays(start, heading, np.full(count, NOTHING), np.arange(count))
    for bounce in range(scene.layout.bounces + 1):
        surface, distance, coordinate = nearest(scene, rays)
        place = rays.place + distance * rays.heading
        normal = _normals(scene, surface, place)
        toward = np.real(np.conj(normal) * rays.heading)
        active = (surface != NOTHING) & (np.array([*scene.sides, 0])[surface] * toward <= 0)
        pad = surface - mirrors
        limit = np.sin([*scene.grazing, 0.0])[np.where((pad >= 0) & (pad < pads), pad, pads)]
        shown = active & (pad >= 0) & (pad < pads) & (np.abs(toward) >= limit)
        mine = rays.number[shown]
        label[mine] = path[mine] * pads + pad[shown] + 1
        along[mine] = coordinate[shown]
        on = active & (surface < mirrors)
        if bounce == scene.layout.bounces or not on.any():
            break
        path[rays.number[on]] = _longer(scene, path[rays.number[on]], surface[on])
        bent = rays.heading - 2 * toward * normal
        rays = _Rays(place[on], bent[on], surface[on], rays.number[on])
    return label, along


def number_of(scene: Plain, word: tuple[int, ...], pad: int) -> int:
    """The number that stands for a pad, by its index among the pads, seen over some mirrors."""
    path = 0
    for index in word:
        path = _longer(scene, path, index)
    return path * len(scene.pads) + pad + 1


def _longer(scene: Plain, path: Any, mirror: Any) -> Any:
    """The number of a path that goes on over one more mirror, in digits of their count."""
    return path * (len(scene.layout.mirrors) + 1) + mirror + 1


def nearest(scene: Plain, rays: _Rays) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of every ray, the first surface, how far it is, and where on the surface it is met."""
    found = np.full(len(rays.place), NOTHING)
    nearest, coordinate = np.full(len(rays.place), np.inf), np.zeros(len(rays.place))
    for index, (start, end) in enumerate(scene.ends):
        if index in scene.arcs:
            candidates = _arc(scene, index, rays)
        else:
            one_way = scene.sides[index] if index >= scene.pads.stop else 0
            candidates = [_segment(start, end, one_way, rays.last == index, rays)]
        for distance, at, met in candidates:
            better = met & (distance < nearest)
            nearest[better], coordinate[better] = distance[better], at[better]
            found[better] = index
    return found, np.where(found == NOTHING, 0.0, nearest), coordinate


def _segment(
    start: complex, end: complex, one_way: int, own: np.ndarray, rays: _Rays
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    step, toward = end - start, start - rays.place
    cross = np.imag(np.conj(rays.heading) * step)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.imag(np.conj(toward) * step) / cross
        at = np.imag(np.conj(toward) * rays.heading) / cross
    met = (distance > 0) & (at >= 0) & (at <= 1) & ~own & np.isfinite(distance)
    if one_way:
        met &= one_way * cross > 0  # it lets pass what comes from behind
    return distance, at, met


def _frame(scene: Plain, index: int) -> tuple[complex, complex, float, float, float]:
    """Vertex and direction of an arc, half its chord, its curvature, and 1 + conic constant."""
    start, end = scene.ends[index]
    radius, conic = scene.arcs[index]
    half = abs(end - start) / 2
    along = (end - start) / (2 * half)
    sag = half**2 / (radius * (1 + np.sqrt(1 - (1 + conic) * (half / radius) ** 2)))
    return (start + end) / 2 - 1j * along * sag, along, half, 1 / radius, 1 + conic


def _arc(scene: Plain, index: int, rays: _Rays) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Both places where a ray meets the conic c x² + c s y² = 2 y in the frame of the arc."""
    vertex, along, half, c, s = _frame(scene, index)
    p, d = (rays.place - vertex) / along, rays.heading / along
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


def _normals(scene: Plain, surface: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Unit normals to the left of what is met."""
    steps = np.array([end - start for start, end in scene.ends] + [1.0])
    normal = (1j * steps / np.abs(steps))[surface]
    for index in scene.arcs:
        vertex, along, _, c, s = _frame(scene, index)
        on = surface == index
        at = (place[on] - vertex) / along
        left = -c * at.real + 1j * (1 - c * s * at.imag)
        normal[on] = along * left / np.abs(left)
    return normal


def _runs(
    label: np.ndarray, along: np.ndarray, pads: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower and upper end of what each run of rays sees, and of which pad."""
    cuts = np.flatnonzero(np.diff(label)) + 1
    firsts, lasts = np.append(0, cuts), np.append(cuts, len(label)) - 1
    low, high = (which.reduceat(along, firsts) for which in (np.minimum, np.maximum))
    for end, inward in (
        (firsts, np.minimum(firsts + 1, lasts)),
        (lasts, np.maximum(lasts - 1, firsts)),
    ):
        beyond = np.clip(along[end] + (along[end] - along[inward]) / 2, 0, 1)
        low, high = np.minimum(low, beyond), np.maximum(high, beyond)
    seen = label[firsts] > 0
    return low[seen], high[seen], (label[firsts][seen] - 1) % pads


def _union(low: np.ndarray, high: np.ndarray) -> float:
    order = np.argsort(low)
    total, reached = 0.0, 0.0
    for start, end in zip(low[order].tolist(), high[order].tolist(), strict=True):
        total += max(0.0, end - max(start, reached))
        reached = max(reached, end)
    return total
