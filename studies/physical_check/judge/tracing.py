"""Rays through a scene: by which mirrors and through what each reaches a membrane, or what ends it.

Geometry decides what is hit and Mitsuba where light goes; here is only the account of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from studies.physical_check.judge.engine import Engine, Material
from studies.physical_check.judge.solids import Pose, Tables, faces_of, motion_of

NUDGE = 2e-4
"""A ray goes on so far behind what it has met (mm), 30 times float32's rounding of a place."""

NOTHING, TRAPPED, FLAT, DIM, BOUNCES = range(-5, 0)
"""Ends of rays that no face is to blame for."""

REASONS = {
    NOTHING: "nothing",
    TRAPPED: "total reflection",
    FLAT: "least grazing angle",
    DIM: "least transmission",
    BOUNCES: "more reflections than allowed",
}

TRANSMISSION = 0.3
"""Least of a pad with layers that states none."""


class Traced(NamedTuple):
    """Where rays end; arrays are over rays.

    Attributes:
        seen: whether it is on a membrane that counts as seen.
        reached: the same, whatever the grazing angle and the transmission.
        word: mirrors on the way as digits, the last one lowest, to the base of their number + 1.
        pad: whose membrane, where it is reached.
        entrance: index of the face by which the light came into the pad.
        end: index of the face that ended it, or one of `REASONS`.
        along: membrane coordinate, mm from its end "from".
        across: mm from the section.
        grazing: sine of the angle between ray and outermost surface, in air.
        transmission: part of the light that comes through.
    """

    seen: np.ndarray
    reached: np.ndarray
    word: np.ndarray
    pad: np.ndarray
    entrance: np.ndarray
    end: np.ndarray
    along: np.ndarray
    across: np.ndarray
    grazing: np.ndarray
    transmission: np.ndarray

    def labels(self) -> np.ndarray:
        """What tells views and all else apart: pad, path, entrance, end; shape (rays, 4)."""
        where = [np.where(self.seen, one, -1) for one in (self.pad, self.word, self.entrance)]
        return np.stack([*where, np.where(self.seen, 0, self.end)], axis=-1)


class Tracer:
    """A scene in a pose.

    Args:
        tables: of the scene's file.
        pose: its joint angles, degrees.
        origin: of all rays, in the section; the faces are moved so that it is at 0, where float32
            is finest.
        only: a pad that is to be alone with the mirrors, without ends.
        spare: how far its surfaces then go on, mm.
    """

    def __init__(
        self, tables: Tables, pose: Pose, origin: complex, only: int | None = None, spare: float = 0
    ) -> None:
        self.faces = faces_of(tables, pose, only, spare)
        self._mirrors = len(tables.get("mirrors", []))
        self._bounces = bounces_of(tables)
        by_material: dict[Material, list[int]] = {}
        for index, face in enumerate(self.faces):
            by_material.setdefault(face.material, []).append(index)
        moved = np.array([origin.real, origin.imag, 0.0])
        self._engine = Engine(
            {m: [self.faces[i].corners - moved for i in own] for m, own in by_material.items()}
        )
        self._index = np.full((len(by_material), max(map(len, by_material.values()))), -1)
        for row, own in zip(self._index, by_material.values(), strict=True):
            row[: len(own)] = own
        self._part = np.array([face.part for face in self.faces])
        self._kind = np.array([face.kind for face in self.faces])
        self._outermost = np.array([face.outermost for face in self.faces])
        self._one_sided = np.array([face.one_sided for face in self.faces])
        pads = tables.get("pads", [])
        self.lines = np.array([membrane(tables, pose, pad) for pad in pads]) - origin
        self._layered = np.array([bool(pad.get("layers")) for pad in pads])
        grazing = [math.radians(pad.get("min_grazing_deg", 0.0)) for pad in pads]
        self._least = (
            np.sin(grazing),
            np.array([pad.get("min_transmission", TRANSMISSION) for pad in pads]),
        )

    def describe(self, end: int) -> str:
        """What ended a ray, in words."""
        return REASONS[end] if end < 0 else self.faces[end].name

    def by_end(self, traced: Traced) -> np.ndarray:
        """Whether light came into a pad by an end face."""
        return (traced.entrance >= 0) & (self._kind[traced.entrance] == "end")

    def trace(self, directions: np.ndarray) -> Traced:
        """Follow rays from the origin, unit vectors of shape (rays, 3); NaN is no ray."""
        count = len(directions)
        word, hops, end = np.zeros(count, int), np.zeros(count, int), np.full(count, NOTHING)
        inside, entrance = np.full(count, -1), np.full(count, -1)
        grazing, transmission = np.ones(count), np.ones(count)
        reached, hit = np.zeros(count, bool), np.zeros((count, 3))
        place, way = np.zeros((count, 3)), np.array(directions, float)
        live = np.flatnonzero(np.isfinite(way[:, 0]))
        while len(live):
            step = self._engine.step(place[live], way[live])
            met = step.group >= 0
            live, step = live[met], type(step)(*(one[met] for one in step))
            face = self._index[step.group, step.face]
            kind, own = self._kind[face], inside[live] == self._part[face]
            outside, layered = inside[live] < 0, self._layered[self._part[face]]
            sine = -np.sum(step.normal * way[live], axis=-1)
            front = sine > 0
            end[live], hit[live] = face, step.point
            # A membrane ends the ray: it is seen from its front, in air or from within its pad.
            bare = outside & ~layered & (front | ~self._one_sided[face])
            on = (kind == "membrane") & (bare | (~outside & own & front))
            reached[live[on]] = True
            grazing[live[on & outside]] = np.abs(sine[on & outside])
            # Into a pad by its outermost faces, through its levels downwards, and never out of it.
            enters = outside & front & self._outermost[face]
            deeper = ~outside & own & front & (kind == "level")
            through = enters | deeper
            grazing[live[enters]], entrance[live[enters]] = sine[enters], face[enters]
            inside[live[enters]] = self._part[face[enters]]
            transmission[live[through]] *= step.weight[through]
            end[live[through & (step.weight <= 0)]] = TRAPPED
            mirrored = (kind == "mirror") & outside & (step.weight > 0)
            end[live[mirrored]] = BOUNCES
            mirrored &= hops[live] < self._bounces
            word[live[mirrored]] *= self._mirrors + 1
            word[live[mirrored]] += self._part[face[mirrored]] + 1
            hops[live[mirrored]] += 1
            unnoticed = (kind == "blocker") & outside & ~front & self._one_sided[face]
            end[live[unnoticed]] = NOTHING
            turned = (through & (step.weight > 0)) | mirrored
            way[live[turned]] = step.onward[turned]
            goes = turned | unnoticed
            end[live[goes]] = NOTHING
            live = live[goes]
            place[live] = hit[live] + NUDGE * way[live]
        return self._account(reached, word, entrance, end, hit, grazing, transmission)

    def _account(
        self, reached: np.ndarray, word: np.ndarray, entrance: np.ndarray, end: np.ndarray,
        hit: np.ndarray, grazing: np.ndarray, transmission: np.ndarray,
    ) -> Traced:  # fmt: skip
        pad = np.where(reached, self._part[np.maximum(end, 0)], -1)
        start, line = self.lines[pad, 0], self.lines[pad, 1] - self.lines[pad, 0]
        along = ((hit[:, 0] + 1j * hit[:, 1] - start) * np.conj(line)).real / np.abs(line)
        least, dim = self._least[0][pad], np.where(self._layered[pad], self._least[1][pad], 0.0)
        end = np.where(reached & (transmission < dim), DIM, end)
        end = np.where(reached & (grazing < least), FLAT, end)
        seen = reached & (grazing >= least) & (transmission >= dim)
        return Traced(
            seen, reached, word, pad, entrance, end, along, hit[:, 2], grazing, transmission
        )


def membrane(tables: Tables, pose: Pose, pad: Tables) -> tuple[complex, complex]:
    """Where the ends "from" and "to" of a pad are in a pose."""
    turn, shift = motion_of(tables, pose, pad.get("body", "world"))
    return turn * complex(*pad["from"]) + shift, turn * complex(*pad["to"]) + shift


def bounces_of(tables: Tables) -> int:
    """Most reflections of a ray: as the file states, or two, or one of a single mirror."""
    return tables.get("scene", {}).get("bounces", min(len(tables.get("mirrors", [])), 2))


def mirrors_of(tables: Tables, word: int) -> tuple[str, ...]:
    """Names of the mirrors of a path, in the order in which light from the camera meets them."""
    mirrors, names = tables.get("mirrors", []), []
    while word:
        word, digit = divmod(word, len(mirrors) + 1)
        names.append(mirrors[digit - 1]["name"])
    return tuple(reversed(names))
