"""Rays through a scene: by which mirrors and through what each reaches a membrane, or what ends it.

Geometry decides what is hit and Mitsuba where light goes; here is only the account of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from studies.oracles.judge.engine import Engine, Material
from studies.oracles.judge.solids import Face, Pose, Tables, faces_of, motion_of

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
        transmission: part of unpolarised light that comes through.
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
        groups: dict[Material, list[Face]] = {}
        for face in faces_of(tables, pose, only, spare):
            groups.setdefault(face.material, []).append(face)
        moved = np.array([origin.real, origin.imag, 0.0])
        self._engine = Engine({m: [f.corners - moved for f in own] for m, own in groups.items()})
        self._first = np.cumsum([0, *map(len, groups.values())])
        self._faces = [face for own in groups.values() for face in own]
        self._part, self._kind, self._outermost, self._one_sided, self._open_behind = (
            np.array([getattr(face, name) for face in self._faces])
            for name in ("part", "kind", "outermost", "one_sided", "open_behind")
        )
        pads = tables.get("pads", [])
        self.lines = np.array([membrane(tables, pose, pad) for pad in pads]) - origin
        bare = [
            face.kind == "membrane" and not pads[face.part].get("layers") for face in self._faces
        ]
        self._bare, self._mirrors = np.array(bare), len(tables.get("mirrors", []))
        self._bounces = tables.get("scene", {}).get("bounces", min(self._mirrors, 2))
        self._flat = np.sin([math.radians(pad.get("min_grazing_deg", 0.0)) for pad in pads])
        light = [
            pad.get("min_transmission", TRANSMISSION) if pad.get("layers") else 0 for pad in pads
        ]
        self._dim = np.array(light)

    def describe(self, end: int) -> str:
        """What ended a ray, in words."""
        return REASONS[end] if end < 0 else self._faces[end].name

    def by_end(self, traced: Traced) -> np.ndarray:
        """Whether light came into a pad by an end face."""
        return (traced.entrance >= 0) & (self._kind[traced.entrance] == "end")

    def trace(self, directions: np.ndarray) -> Traced:
        """Follow rays from the origin, unit vectors of shape (rays, 3); NaN is no ray."""
        count = len(directions)
        word, hops, end = np.zeros(count, int), np.zeros(count, int), np.full(count, NOTHING)
        inside, entrance = np.full(count, -1), np.full(count, -1)
        grazing, light = np.ones(count), np.tile(np.eye(4), (count, 1, 1))
        reached, hit = np.zeros(count, bool), np.zeros((count, 3))
        place, way = np.zeros((count, 3)), np.array(directions, float)
        live = np.flatnonzero(np.isfinite(way[:, 0]))
        while len(live):
            step = self._engine.step(place[live], way[live])
            met = step.group >= 0
            live, step = live[met], type(step)(*(one[met] for one in step))
            face = self._first[step.group] + step.face
            kind, own = self._kind[face], inside[live] == self._part[face]
            outside, sine = inside[live] < 0, -np.sum(step.normal * way[live], axis=-1)
            front = sine > 0
            end[live], hit[live] = face, step.point
            # A membrane ends the ray: it is seen from its front, in air or from within its pad.
            bare = outside & self._bare[face] & (front | ~self._one_sided[face])
            reached[live[bare | (~outside & own & front & (kind == "membrane"))]] = True
            grazing[live[bare]] = np.abs(sine[bare])
            # Into a pad by its outermost faces, through its levels downwards, and never out of it.
            enters = outside & front & self._outermost[face]
            deeper = ~outside & own & front & (kind == "level")
            through = enters | deeper
            grazing[live[enters]], entrance[live[enters]] = sine[enters], face[enters]
            inside[live[enters]] = self._part[face[enters]]
            light[live[through]] = step.light[through] @ light[live[through]]
            passes = step.light[:, 0, 0] > 0
            end[live[through & ~passes]] = TRAPPED
            mirrored = (kind == "mirror") & outside & passes
            end[live[mirrored]] = BOUNCES
            mirrored &= hops[live] < self._bounces
            word[live[mirrored]] *= self._mirrors + 1
            word[live[mirrored]] += self._part[face[mirrored]] + 1
            hops[live[mirrored]] += 1
            unnoticed = outside & ~front & self._open_behind[face]
            end[live[unnoticed]] = NOTHING
            turned = (through & passes) | mirrored
            way[live[turned]] = step.onward[turned]
            goes = turned | unnoticed
            end[live[goes]] = NOTHING
            live = live[goes]
            place[live] = hit[live] + NUDGE * way[live]
        pad = np.where(reached, self._part[np.maximum(end, 0)], -1)
        start, line = self.lines[pad, 0], self.lines[pad, 1] - self.lines[pad, 0]
        along = ((hit[:, 0] + 1j * hit[:, 1] - start) * np.conj(line)).real / np.abs(line)
        transmission = light[:, 0, 0]
        flat, dim = grazing < self._flat[pad], transmission < self._dim[pad]
        end = np.where(reached & flat, FLAT, np.where(reached & dim, DIM, end))
        views = reached & ~flat & ~dim, reached, word, pad, entrance, end
        return Traced(*views, along, hit[:, 2], grazing, transmission)


def membrane(tables: Tables, pose: Pose, pad: Tables) -> tuple[complex, complex]:
    """Where the ends "from" and "to" of a pad are in a pose."""
    turn, shift = motion_of(tables, pose, pad.get("body", "world"))
    return turn * complex(*pad["from"]) + shift, turn * complex(*pad["to"]) + shift


def path_of(tables: Tables, word: int) -> str:
    """Names of the mirrors of a path as light from the camera meets them, joined by "+"."""
    mirrors, names = tables.get("mirrors", []), []
    while word:
        word, digit = divmod(word, len(mirrors) + 1)
        names.append(mirrors[digit - 1]["name"])
    return "+".join(reversed(names))
