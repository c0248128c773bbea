"""Things pressed into membranes, and how a membrane bulges over them towards the camera.

Each is made of bodies whose surface is round across a segment: spheres, and edges as long as the
segment; or it is a pin, whose end is flat up to a rounded rim. Over a round body pressed in to a
depth d, the membrane lies on it up to a = √(R d) from the segment, and beyond as a half-space does
(Johnson, Contact Mechanics, 1985, §4.2(a), Hertz); of a pin both are integrals (I. N. Sneddon, Int.
J. Eng. Sci. 3 (1965) 47). It fades over `FADE`, since a pad is thin.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy.optimize

FADE = 2.0
"""mm."""

REACH = 2.5 * FADE
"""So far beyond its edge a contact lifts a membrane by 0.1 % of its depth: rays do not meet it."""

STEPS, HALVINGS = 20, 10
"""A ray's way through the height of a bulge is divided so, and then the part where it meets it."""

SHAPES: Mapping[str, tuple[float, float, int]] = {
    "sphere": (8.0, 0.0, 1),
    "ball": (2.5, 0.0, 1),
    "edge": (2.0, 10.0, 1),
    "studs": (0.8, 0.0, 3),
    "pin": (1.5, 0.0, 1),
}
"""Radius, of a pin that of what is flat, and length, mm, and how many stand in a row and in a
column."""

RIM = 0.5
"""Radius of a pin's rim, mm."""

PITCH = 3.0
"""Of studs, mm."""

WIDTH = 24.0
"""Of a pad that gives none, mm."""

RADII, NODES = 400, 24
"""Of a pin's bulge: places at which it is computed, and nodes of each integral."""


class Contact(NamedTuple):
    """One thing pressed into a membrane.

    Attributes:
        pad: its name.
        kind: of the thing.
        along: of its middle, mm from the membrane's end "from".
        across: of its middle, mm towards greater columns.
        depth: mm.
        turn: of its length from along towards across, rad.
        size: radius of its bodies, mm, where it is not that of the kind.
    """

    pad: str
    kind: Literal["sphere", "ball", "edge", "studs", "pin"]
    along: float
    across: float
    depth: float
    turn: float = 0.0
    size: float | None = None

    @property
    def radius(self) -> float:
        """Of its bodies, mm."""
        return SHAPES[self.kind][0] if self.size is None else self.size

    @property
    def edge(self) -> float:
        """How far from a body's segment the membrane leaves it, mm."""
        if self.kind == "pin":
            return pin_edge(self.radius, self.depth)
        return float(np.sqrt(self.radius * self.depth))


class Contacts:
    """All that is pressed into the membranes of a scene.

    Args:
        tables: of the scene.
        contacts: things in any order.
    """

    def __init__(self, tables: Mapping[str, Any], contacts: Sequence[Contact]) -> None:
        pads = tables.get("pads", [])
        self._sizes = [
            (abs(complex(*pad["to"]) - complex(*pad["from"])), pad.get("width", WIDTH) / 2)
            for pad in pads
        ]
        self._contacts = [[one for one in contacts if one.pad == pad["name"]] for pad in pads]

    def of(self, pad: int) -> list[Contact]:
        """Those of a pad."""
        return self._contacts[pad]

    def highest(self, pad: int) -> float:
        """Of a pad's membrane, mm."""
        return max((one.depth for one in self._contacts[pad]), default=0.0)

    def heights(self, pad: int, along: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Of a membrane above its plane, mm."""
        found = np.zeros(np.broadcast(along, across).shape)
        for one in self._contacts[pad]:
            _, length, count = SHAPES[one.kind]
            cosine, sine = np.cos(one.turn), np.sin(one.turn)
            u, v = along - one.along, across - one.across
            u, v = cosine * u + sine * v, cosine * v - sine * u
            places = (np.arange(count) - (count - 1) / 2) * PITCH
            for row in places:
                for column in places:
                    beyond = np.maximum(np.abs(u - row) - length / 2, 0)
                    away = np.hypot(beyond, v - column)
                    over = pin_bulge if one.kind == "pin" else bulge
                    found = np.maximum(found, over(away, one.radius, one.depth))
        return found

    def normals(self, pad: int, along: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Unit normals (along, across, height) of a membrane, shape (…, 3)."""
        step = 1e-3
        slopes = [
            (self.heights(pad, along + a, across + b) - self.heights(pad, along - a, across - b))
            / (2 * step)
            for a, b in ((step, 0.0), (0.0, step))
        ]
        normal = np.stack([-slopes[0], -slopes[1], np.ones_like(slopes[0])], axis=-1)
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def meet(self, pad: int, origins: np.ndarray, ways: np.ndarray) -> np.ndarray:
        """How far rays go until they meet the bulging membrane of a pad, where they do; else ∞.

        Origins and directions are in the pad's own axes: along, across, height.
        """
        far = np.full(len(origins), np.inf)
        if not self._contacts[pad]:
            return far
        length, half = self._sizes[pad]
        low, high = np.array([0.0, -half, 0.0]), np.array([length, half, self.highest(pad)])
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = (low - origins) / ways, (high - origins) / ways
        enter = np.max(np.minimum(one, other), axis=-1)
        leave = np.min(np.maximum(one, other), axis=-1)
        enter = np.maximum(enter, 0.0)
        middle = origins + np.where(enter < leave, (enter + leave) / 2, 0)[:, None] * ways
        near = np.zeros(len(origins), bool)
        for one in self._contacts[pad]:
            _, length, count = SHAPES[one.kind]
            reach = one.edge + REACH + length / 2 + (count - 1) * PITCH * 0.75
            away = np.hypot(middle[:, 0] - one.along, middle[:, 1] - one.across)
            near |= away < reach + (leave - enter) / 2
        # From above, or along: what begins below a bulge has just left its membrane.
        mine = np.flatnonzero((enter < leave) & near)
        origin, way, start, stop = origins[mine], ways[mine], enter[mine], leave[mine]

        def above(distance: np.ndarray) -> np.ndarray:
            place = origin + distance[:, None] * way
            height = self.heights(pad, place[:, 0], place[:, 1])
            return place[:, 2] - height > np.where(height > 1e-4, 0.0, -1.0)

        first, last, open_ = start.copy(), np.full(len(mine), np.inf), np.ones(len(mine), bool)
        for i in range(STEPS + 1):
            now = start + (stop - start) * i / STEPS
            free = above(now)
            last = np.where(open_ & ~free, now, last)
            open_ &= free
            first = np.where(open_, now, first)
        hit = np.flatnonzero(last < np.inf)
        origin, way, first, last = origin[hit], way[hit], first[hit], last[hit]
        for _ in range(HALVINGS):
            middle = (first + last) / 2
            free = above(middle)
            first, last = np.where(free, middle, first), np.where(free, last, middle)
        far[mine[hit]] = last
        return far


def bulge(away: np.ndarray, radius: float, depth: float) -> np.ndarray:
    """Height of a membrane at a distance from the middle of a round body that is pressed in, mm."""
    edge = np.sqrt(radius * depth)
    share = np.maximum(away / edge, 1.0)
    flank = (2 - share**2) * np.arcsin(1 / share) + np.sqrt(share**2 - 1)
    outside = depth / np.pi * flank * _faded(away, edge)
    return np.where(away < edge, depth - away**2 / (2 * radius), outside)


def pin_bulge(away: np.ndarray, flat: float, depth: float) -> np.ndarray:
    """Height of a membrane at a distance from the middle of a pin that is pressed in, mm.

    On it the membrane has the height d - (r - b)² / 2 R, where b is the radius of what is flat and
    R that of the rim. Beyond the edge a it is 2/π ∫ φ(t) (r² - t²)^-½ dt from 0 to a, where
    φ(t) = d - `_sunk`(t), and φ(a) = 0.
    """
    edge, table = pin_edge(flat, depth), _beyond_pin(flat, depth)
    on = depth - np.maximum(np.minimum(away, edge) - flat, 0) ** 2 / (2 * RIM)
    beyond = np.interp(away, *table) * _faded(away, edge)
    return np.where(away < edge, on, beyond)


@functools.lru_cache(maxsize=256)
def _beyond_pin(flat: float, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """Distances from a pin's middle, and the height there of a membrane that does not fade."""
    edge = pin_edge(flat, depth)
    # Over angles t = r sin θ the integral has no pole.
    radii = np.linspace(edge, edge + REACH, RADII)
    low, high = np.arcsin(flat / radii), np.arcsin(np.minimum(edge / radii, 1))
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    angles = low + (high - low) * (nodes[:, None] + 1) / 2
    kept = depth - _sunk(radii * np.sin(angles), flat)
    return radii, 2 / np.pi * (depth * low + (high - low) / 2 * (weights @ kept))


@functools.lru_cache(maxsize=256)
def pin_edge(flat: float, depth: float) -> float:
    """How far from the middle of a pin the membrane leaves it, mm."""
    # A sphere of the rim's radius leaves it at √(R d), and a pin less far beyond what is flat.
    far = flat + RIM + depth
    found: Any = scipy.optimize.brentq(lambda edge: _sunk(edge, flat) - depth, flat, far)
    return float(found)


def _sunk(edge: Any, flat: float) -> Any:
    """How deep a pin is pressed in whose membrane leaves it there, mm."""
    inner = np.minimum(flat / edge, 1)
    return edge**2 / RIM * (np.sqrt(1 - inner**2) - inner * np.arccos(inner))


def _faded(away: np.ndarray, edge: float) -> np.ndarray:
    return np.exp(-(((np.maximum(away, edge) - edge) / FADE) ** 2))
