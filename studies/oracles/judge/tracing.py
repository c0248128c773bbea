"""Rays through a scene: by which mirrors and through what each reaches a membrane, or what ends it.

Geometry decides what is hit and Mitsuba where light goes; here is only the account of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from studies.oracles.judge.contacts import Contacts
from studies.oracles.judge.engine import Engine, Material
from studies.oracles.judge.solids import Face, Pose, Tables, faces_of, frame_of

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

FAINTEST, TURNS = 0.01, 12
"""Within layers, light is followed down to this part of it, and to so many reflections: what takes
more goes almost along the layers, and is less than 0.1 % of a matt membrane's light."""

Walls = Literal["dark", "air", "coupled"]
"""What becomes of light that meets the outside of layers from within: it ends; it is reflected, or
leaves into the air and the lamps there; or it leaves into lamps that touch the layers."""


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
        glow: how much of each lamp's light comes in besides, on the way, shape (rays, 3).
        turns: reflections by the outside of layers, from within.
        distance: length of the way, mm.
        point: its last one, from the tracer's origin, shape (rays, 3).
        way: direction in which the ray came there.
        inside: the pad in whose layers it lies, or −1.
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
    glow: np.ndarray
    turns: np.ndarray
    distance: np.ndarray
    point: np.ndarray
    way: np.ndarray
    inside: np.ndarray

    def labels(self) -> np.ndarray:
        """Pad, path, entrance and end, by which views are separated; shape (rays, 4)."""
        where = [np.where(self.seen, one, -1) for one in (self.pad, self.word, self.entrance)]
        return np.stack([*where, np.where(self.seen, 0, self.end)], axis=-1)


class Tracer:
    """A scene in a pose.

    Args:
        tables: of the scene's file.
        pose: its joint angles, degrees.
        origin: of all rays, a place (x, y, z) or one in the section; the faces are moved so that
            it is at 0, where float32 is finest.
        only: a pad that is to be alone with the mirrors, without ends.
        spare: how far its surfaces then go on, mm.
        lamps: whether the pads have lamps.
        housing: whether there are walls on both sides of everything.
        contacts: what is pressed into membranes.
        solids: further faces.
    """

    def __init__(
        self,
        tables: Tables,
        pose: Pose,
        origin: complex | np.ndarray,
        only: int | None = None,
        spare: float = 0,
        lamps: bool = False,
        housing: bool = False,
        contacts: Contacts | None = None,
        solids: Sequence[Face] = (),
    ) -> None:
        groups: dict[Material, list[Face]] = {}
        for face in (*faces_of(tables, pose, only, spare, lamps, housing), *solids):
            groups.setdefault(face.material, []).append(face)
        moved = origin if isinstance(origin, np.ndarray) else [origin.real, origin.imag, 0.0]
        moved = np.asarray(moved, float)
        self._engine = Engine({m: [f.corners - moved for f in own] for m, own in groups.items()})
        self._first = np.cumsum([0, *map(len, groups.values())])
        self.faces = [face for own in groups.values() for face in own]
        self._part, self._kind, self._outermost, self._one_sided, self._open_behind, self._lamp = (
            np.array([getattr(face, name) for face in self.faces])
            for name in ("part", "kind", "outermost", "one_sided", "open_behind", "lamp")
        )
        pads, mirrors = tables.get("pads", []), tables.get("mirrors", [])
        frames = [frame_of(tables, pose, pad) for pad in pads]
        self.pads = [frame._replace(origin=frame.origin - moved) for frame in frames]
        frames = [frame_of(tables, pose, mirror, 0.5) for mirror in mirrors]
        self._bowed = {
            index: frame._replace(origin=frame.origin - moved)
            for index, frame in enumerate(frames)
            if frame.bow
        }
        bare = [
            face.kind == "membrane" and not pads[face.part].get("layers") for face in self.faces
        ]
        self._bare, self._mirrors = np.array(bare), len(mirrors)
        self._bounces = tables.get("scene", {}).get("bounces", min(self._mirrors, 2))
        self._flat = np.sin([math.radians(pad.get("min_grazing_deg", 0.0)) for pad in pads])
        light = [
            pad.get("min_transmission", TRANSMISSION) if pad.get("layers") else 0 for pad in pads
        ]
        self._dim = np.array(light)
        self._contacts, self._sides = contacts, [pad.get("side", "both") for pad in pads]
        self._membrane, self._level, self._mirror = (
            self._kind == kind for kind in ("membrane", "level", "mirror")
        )
        self._windows = bool(np.any(self._kind == "end"))
        self._layered = [bool(pad.get("layers")) for pad in pads]

    def describe(self, end: int) -> str:
        """What ended a ray, in words."""
        return REASONS[end] if end < 0 else self.faces[end].name

    def by_end(self, traced: Traced) -> np.ndarray:
        """Whether light came into a pad by an end face."""
        return (traced.entrance >= 0) & (self._kind[traced.entrance] == "end")

    def axes(self, pad: int) -> np.ndarray:
        """A pad's own: along, across (towards greater columns), and towards its sensing side."""
        frame = self.pads[pad]
        up = -frame.normal if self._sides[pad] == "right" else frame.normal
        return np.stack([frame.along, frame.across, up])

    def _membranes(self) -> np.ndarray:
        """Faces of the pads' membranes."""
        found = np.zeros(len(self.pads), int)
        mine = np.flatnonzero(self._kind == "membrane")
        found[self._part[mine]] = mine
        return found

    def _meet_contacts(
        self, place: np.ndarray, way: np.ndarray, inside: np.ndarray, point: np.ndarray,
        group: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """How far it is to a bulging membrane, ∞ where none comes first, and of which pad."""
        ahead, pads = np.full(len(place), np.inf), np.zeros(len(place), int)
        if self._contacts is None:
            return ahead, pads
        room = np.where(group >= 0, np.linalg.norm(point - place, axis=-1), np.inf)
        for pad, layered in enumerate(self._layered):
            if not (highest := self._contacts.highest(pad)):
                continue
            axes, origin = self.axes(pad), self.pads[pad].origin
            # Only stretches that end below the top of what bulges can meet it.
            start, slope = (place - origin) @ axes[2], way @ axes[2]
            low = (slope < 0) & (start + room * slope < highest) & (start > 0)
            mine = np.flatnonzero(low & (inside == (pad if layered else -1)))
            local = (place[mine] - origin) @ axes.T
            far = self._contacts.meet(pad, local, way[mine] @ axes.T)
            first = far < np.minimum(room, ahead)[mine]
            ahead[mine[first]], pads[mine[first]] = far[first], pad
        return ahead, pads

    def trace(
        self,
        directions: np.ndarray,
        origins: np.ndarray | None = None,
        inside: np.ndarray | None = None,
        walls: Walls = "dark",
    ) -> Traced:
        """Follow rays.

        Args:
            directions: unit vectors of shape (rays, 3); NaN is no ray.
            origins: from the tracer's own origin, where they do not begin there.
            inside: pads in whose layers rays begin, −1 for air. These rays go on within the layers
                as long as there is light; others leave where more light does than stays.
            walls: the outside of layers, from within.
        """
        walls = walls if self._windows else "dark"
        count = len(directions)
        word, hops, end = np.zeros(count, int), np.zeros(count, int), np.full(count, NOTHING)
        stays = inside is not None
        inside = np.full(count, -1) if inside is None else inside.copy()
        entrance, turns = np.full(count, -1), np.zeros(count, int)
        grazing, light = np.ones(count), np.tile(np.eye(4), (count, 1, 1))
        reached, hit = np.zeros(count, bool), np.zeros((count, 3))
        glow, distance = np.zeros((count, 3)), np.zeros(count)
        place, way = np.zeros((count, 3)), np.array(directions, float)
        if origins is not None:
            place += origins
        live = np.flatnonzero(np.isfinite(way[:, 0]))
        while len(live):
            step = self._engine.step(place[live], way[live], walls != "dark")
            ahead, pads = self._meet_contacts(
                place[live], way[live], inside[live], step.point, step.group
            )
            pressed = ahead < np.inf
            met = (step.group >= 0) | pressed
            if not met.all():
                live, pressed = live[met], pressed[met]
                ahead, pads = ahead[met], pads[met]
                step = type(step)(*(one[met] if len(one) else one for one in step))
            face = self._first[step.group] + step.face
            face[pressed] = self._membranes()[pads[pressed]]
            step.point[pressed] = place[live[pressed]] + ahead[pressed, None] * way[live[pressed]]
            own, level = inside[live] == self._part[face], self._level[face]
            outside, sine = inside[live] < 0, -np.sum(step.normal * way[live], axis=-1)
            front = sine > 0
            end[live], hit[live] = face, step.point
            distance[live] += np.linalg.norm(step.point - place[live], axis=-1)
            # A membrane ends the ray: it is seen from its front, in air or from within its pad.
            bare = outside & self._bare[face] & (front | ~self._one_sided[face]) & ~pressed
            within = ~outside & own & front & self._membrane[face]
            reached[live[bare | within | pressed]] = True
            grazing[live[bare]] = np.abs(sine[bare])
            # Into a pad by its outermost faces, through its levels downwards, and never out of it.
            enters = outside & front & self._outermost[face] & ~pressed
            inner = ~outside & own & ~pressed
            deeper = inner & front & level
            if walls != "dark":
                deeper |= inner & ~front & level & ~self._outermost[face]
            through = enters | deeper
            grazing[live[enters]], entrance[live[enters]] = sine[enters], face[enters]
            inside[live[enters]] = self._part[face[enters]]
            passes = step.light[:, 0, 0] > 0
            end[live[through & ~passes]] = TRAPPED
            way_on, turned = step.onward, through & passes
            light[live[turned]] = step.light[turned] @ light[live[turned]]
            if walls != "dark":
                # From within to the outside: into a lamp, into the air, or back.
                met = np.flatnonzero((inner & ~front & self._outermost[face]) | (deeper & ~passes))
                own_light, lamp = light[live[met]], self._lamp[face[met]]
                out = step.light[met] @ own_light
                lit = (lamp >= 0) & passes[met] | (lamp >= 0) & (walls == "coupled")
                amount = (own_light if walls == "coupled" else out)[:, 0, 0]
                np.add.at(glow, (live[met[lit]], lamp[lit]), amount[lit])
                leaves = (lamp < 0) & (step.reflection[met, 0, 0] < 0.5) & (not stays)
                own_light = np.where(leaves[:, None, None], out, step.reflection[met] @ own_light)
                light[live[met]] = own_light
                inside[live[met[leaves]]] = -1
                turns[live[met[~leaves]]] += 1
                way_on[met[~leaves]] = step.mirrored[met[~leaves]]
                goes = (own_light[:, 0, 0] > FAINTEST) & (turns[live[met]] < TURNS)
                goes &= (lamp < 0) | (walls == "air")
                turned[met[goes]] = True
                end[live[met[~goes]]] = DIM
            mirrored = self._mirror[face] & outside & passes & ~pressed
            end[live[mirrored]] = BOUNCES
            mirrored &= hops[live] < self._bounces
            word[live[mirrored]] *= self._mirrors + 1
            word[live[mirrored]] += self._part[face[mirrored]] + 1
            hops[live[mirrored]] += 1
            for index, frame in self._bowed.items():
                bent = mirrored & (self._part[face] == index)
                way_on[bent] = frame.mirrored(step.point[bent], way[live[bent]])
            unnoticed = outside & ~front & self._open_behind[face] & ~pressed
            end[live[unnoticed]] = NOTHING
            turned |= mirrored
            way[live[turned]] = way_on[turned]
            goes = turned | unnoticed
            end[live[goes]] = NOTHING
            live = live[goes]
            place[live] = hit[live] + NUDGE * way[live]
        pad = np.where(reached, self._part[np.maximum(end, 0)], -1)
        along, across = np.zeros(count), np.zeros(count)
        for index, frame in enumerate(self.pads):
            mine = pad == index
            along[mine] = (hit[mine] - frame.origin) @ frame.along
            across[mine] = (hit[mine] - frame.origin) @ frame.across
        transmission = light[:, 0, 0]
        flat, dim = grazing < self._flat[pad], transmission < self._dim[pad]
        end = np.where(reached & flat, FLAT, np.where(reached & dim, DIM, end))
        views = reached & ~flat & ~dim, reached, word, pad, entrance, end
        more = glow, turns, distance, hit, way, inside
        return Traced(*views, along, across, grazing, transmission, *more)


def path_of(tables: Tables, word: int) -> str:
    """Names of the mirrors of a path as light from the camera meets them, joined by "+"."""
    mirrors, names = tables.get("mirrors", []), []
    while word:
        word, digit = divmod(word, len(mirrors) + 1)
        names.append(mirrors[digit - 1]["name"])
    return "+".join(reversed(names))
