"""The bodies of a MuJoCo model: their joints, their looks and masses, and what can be touched."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from kinematics.export.mjcf_coordinates import Coordinates
from kinematics.export.mjcf_tree import block_of
from kinematics.export.mjcf_xml import MM, add, color, numbers, place
from kinematics.model.linkage import Linkage
from kinematics.model.topology import WORLD
from kinematics.plot.drawing import SLOT_END, Scene, body_colors
from kinematics.plot.symbols import GRAY

Point = tuple[float, float]
Rod = tuple[np.ndarray, np.ndarray]

RADIUS = 0.02
"""Of the rods, in linkage sizes."""

DENSITY = 2700.0
"""Of all that moves, kg/m³: aluminium."""

SHORTEST = 1e-3
"""Rods shorter than this, mm, are left out: MuJoCo refuses capsules between places so near."""

SLIDE = "slide"
"""Class of the joints that slide."""

WIDTH = 0.2
"""Of pads and discs across the plane, in linkage sizes."""


@dataclass(frozen=True)
class Pad:
    """A straight face of a body. Discs touch it without friction.

    Attributes:
        name: of its site.
        body: which it is part of.
        start: its one end in the assembled sketch, mm.
        end: the other one; the body lies to the left of the way from start to end.
    """

    name: str
    body: str
    start: Point
    end: Point


@dataclass(frozen=True)
class Disc:
    """A round object that does not move.

    Attributes:
        name: of its geom.
        center: mm.
        radius: mm.
    """

    name: str
    center: Point
    radius: float


def rods(linkage: Linkage, coordinates: Coordinates) -> dict[str, list[Rod]]:
    """What every body consists of: rods along its outline in the assembled sketch, mm."""
    tree, size = coordinates.tree, float(linkage.size())
    reach = np.array([[-SLOT_END], [SLOT_END]]) * size
    ends = tuple(
        tree.joints[part.joint] + reach * along
        for part, along in zip(linkage.structure.sliders, tree.directions, strict=True)
    )
    scene = Scene(linkage.structure, size, tree.joints, {}, tree.directions, ends)
    return {
        part.name: [
            pair
            for line in scene.outlines(part.name)
            for pair in itertools.pairwise(line)
            if math.dist(*pair) > SHORTEST
        ]
        for part in linkage.structure.bodies
    }


def inertia(linkage: Linkage, parts: Mapping[str, Sequence[Rod]]) -> float:
    """The mass of all moving rods times the square of the linkage's size, kg m²: a scale."""
    size = float(linkage.size()) * MM
    length = sum(math.dist(*rod) for part in linkage.structure.moving for rod in parts[part.name])
    return DENSITY * math.pi * (RADIUS * size) ** 2 * length * MM * size**2


class Bodies:
    """Writes the bodies into ``<worldbody>``.

    Attributes:
        joints: elements of the joints, by their outer bodies.
    """

    def __init__(
        self, linkage: Linkage, coordinates: Coordinates, parts: Mapping[str, Sequence[Rod]]
    ) -> None:
        self.joints: dict[str, Element] = {}
        self._structure, self._coordinates, self._parts = linkage.structure, coordinates, parts
        self._size = float(linkage.size())
        self._colors = body_colors(linkage.structure)

    def write(self, world: Element, pads: Sequence[Pad], discs: Sequence[Disc]) -> None:
        """Write everything.

        Args:
            world: ``<worldbody>``.
            pads: of any bodies.
            discs: objects.
        """
        tree, at = self._coordinates.tree, self._coordinates.tree.joints
        blocks = [block_of(self._structure, i) for i in range(len(tree.directions))]
        elements, origins = {WORLD: world}, {WORLD: np.zeros(2)}
        for part in self._structure.bodies:
            if part.fixed:
                self._rods(world, part.name, origins[WORLD])
        for joint in self._structure.fixed_joints:
            add(world, "site", name=site_name(joint, WORLD), pos=place(at[joint]))
        for disc in discs:
            self._disc(world, disc)
        for branch in tree.branches:
            body, origin = branch.body, at[branch.joint]
            step = origin - origins[branch.parent]
            element = add(elements[branch.parent], "body", name=body, pos=place(step))
            elements[body], origins[body] = element, origin
            self.joints[body] = add(
                element,
                "joint",
                name=f"{body} on {branch.parent}",
                type="hinge" if branch.slider is None else "slide",
                axis=numbers(0, 0, self._coordinates.signs[body]),
                ref=self._coordinates.home[body],
            )
            if branch.slider is not None:
                along = tree.directions[branch.slider] * (1 if branch.forward else -1)
                self.joints[body].set("class", SLIDE)
                self.joints[body].set("axis", numbers(*along, 0))
            if body in self._parts:
                self._rods(element, body, origin)
            else:
                self._block(element, tree.directions[blocks.index(body)])
            for joint in tree.members[body]:
                add(element, "site", name=site_name(joint, body), pos=place(at[joint] - origin))
        for pad in pads:
            node = self._structure.node(pad.body)
            self._pad(elements[node], pad, origins[node])

    def _rods(self, element: Element, body: str, origin: np.ndarray) -> None:
        for start, end in self._parts[body]:
            add(
                element,
                "geom",
                type="capsule",
                size=RADIUS * self._size * MM,
                fromto=f"{place(start - origin)} {place(end - origin)}",
                rgba=color(self._colors[body]),
            )

    def _block(self, element: Element, along: np.ndarray) -> None:
        radius = RADIUS * self._size * MM
        add(
            element,
            "geom",
            type="box",
            size=numbers(2 * radius, radius, radius),
            euler=numbers(0, 0, math.atan2(along[1], along[0])),
            rgba=color(GRAY),
            **{"class": SLIDE},
        )

    def _disc(self, world: Element, disc: Disc) -> None:
        # A capsule touches a box in places that MuJoCo has in closed form; a cylinder's chatter.
        half = WIDTH / 2 * self._size * MM
        size = numbers(disc.radius * MM, half)
        geom = {"name": disc.name, "type": "capsule", "size": size, "pos": place(disc.center)}
        add(world, "geom", **geom, conaffinity=1, rgba=color(GRAY))

    def _pad(self, element: Element, pad: Pad, origin: np.ndarray) -> None:
        start, end = np.array(pad.start) - origin, np.array(pad.end) - origin
        length, thick = math.dist(start, end), RADIUS * self._size
        along = (end - start) / length
        middle = (start + end) / 2 + thick * np.array([-along[1], along[0]])
        half = numbers(length / 2 * MM, thick * MM, WIDTH / 2 * self._size * MM)
        box = {"name": pad.name, "type": "box", "size": half, "pos": place(middle)}
        box["euler"] = numbers(0, 0, math.atan2(along[1], along[0]))
        box["rgba"] = color(self._colors[pad.body])
        add(element, "site", **box)
        add(element, "geom", **box, contype=1)  # touches what has conaffinity=1


def site_name(joint: str, body: str) -> str:
    """The site of a joint on a body or block, or of a fixed joint on `WORLD`."""
    return f"{joint} on {body}"
