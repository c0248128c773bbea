"""The bodies of a MuJoCo model: their joints, their looks and masses, and what can be touched."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from matplotlib.colors import to_rgb

from kinematics.export.mjcf_tree import Tree, block_of
from kinematics.model.assembled import zeroed
from kinematics.model.linkage import Linkage
from kinematics.model.topology import WORLD, InputPart
from kinematics.plot.drawing import body_colors
from kinematics.plot.scene import SLOT_END, Scene
from kinematics.plot.symbols import GRAY

MM = 1e-3
"""In m; also N mm in N m."""

DIGITS = 12
"""Of every number."""


def add(parent: Element, tag: str, **attributes: str | float) -> Element:
    """A new element in another one."""
    texts = {
        key: value if isinstance(value, str) else numbers(value)
        for key, value in attributes.items()
    }
    return SubElement(parent, tag, texts)


def numbers(*values: float) -> str:
    """Numbers as an attribute."""
    return " ".join(f"{float(value) + 0.0:.{DIGITS}g}" for value in values)  # no −0


def place(point: Sequence[float] | np.ndarray) -> str:
    """A point of the plane, mm, as one of space."""
    x, y = (zeroed(float(value)) for value in point)
    return numbers(x * MM, y * MM, 0)


def color(name: Any) -> str:
    """One of Matplotlib's colours."""
    return " ".join(f"{part:.3f}" for part in (*to_rgb(name), 1.0))


@dataclass(frozen=True)
class Reading:
    """A quantity that is constant + Σ factor · coordinate, by the outer bodies of the joints."""

    constant: float
    factors: Mapping[str, int]

    @property
    def single(self) -> tuple[str, int] | None:
        """The only joint that changes it and its factor; none if there are several."""
        return next(iter(self.factors.items())) if len(self.factors) == 1 else None


@dataclass(frozen=True)
class Coordinates:
    """What the coordinates of the joints mean, rad or m.

    A hinge that an input drives alone has the input's value for its coordinate, any other hinge
    the turn of its outer body from the assembled sketch; a slide has the place of its slider.

    Attributes:
        tree: whose joints.
        inputs: the inputs' values in the assembled sketch, by name.
        home: the coordinates there.
        signs: −1 where a coordinate grows as the outer body turns clockwise.
    """

    tree: Tree
    inputs: Mapping[str, float]
    home: Mapping[str, float]
    signs: Mapping[str, int]

    @classmethod
    def of(cls, linkage: Linkage, tree: Tree) -> Coordinates:
        """The coordinates of a linkage that was cut open."""
        values = [zeroed(float(value)) for value in linkage.reference.inputs]
        inputs = dict(zip(linkage.input_names, values, strict=True))
        slides = [zeroed(float(slide)) * MM for slide in linkage.reference.slides]
        home = {
            branch.body: 0.0 if branch.slider is None else slides[branch.slider]
            for branch in tree.branches
        }
        signs = dict.fromkeys(home, 1)
        for part in linkage.structure.inputs:
            turn = {} if part.body is None else tree.turn(part.body, part.relative_to)
            if len(turn) == 1:
                ((body, sign),) = turn.items()
                home[body], signs[body] = inputs[part.name], sign
        return cls(tree, inputs, home, signs)

    def angle(self, body: str, reference: str, home: float = 0.0) -> Reading:
        """The angle of a body relative to another one, with its value in the assembled sketch."""
        turn = self.tree.turn(body, reference)
        factors = {name: sign * self.signs[name] for name, sign in turn.items()}
        constant = home - sum(f * self.home[name] for name, f in factors.items())
        return Reading(zeroed(constant), factors)

    def input(self, part: InputPart) -> Reading:
        """The value of an input."""
        if part.body is None:
            sliding = next(b.body for b in self.tree.branches if b.slider == part.slider)
            return Reading(0.0, {sliding: 1})
        return self.angle(part.body, part.relative_to, self.inputs[part.name])


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


@dataclass(frozen=True)
class Volume:
    """A rounded prism of a body: what lies within a radius of lines between its corners.

    Volumes touch each other, but for those of bodies that share a joint; they have no mass.

    Attributes:
        name: of its geoms, which are counted.
        body: which it is part of.
        corners: in the assembled sketch, mm; the lines go from one to the next, all around.
        radius: mm.
        across: where it begins and ends across the plane, mm.
    """

    name: str
    body: str
    corners: Sequence[Point]
    radius: float
    across: tuple[float, float]


@dataclass(frozen=True)
class PinholeCamera:
    """A pinhole camera on a body, with a square picture.

    Attributes:
        name: of it.
        body: which it is part of.
        position: of the pinhole in the assembled sketch, mm.
        direction: of its axis there, counter-clockwise from +x, rad.
        field_of_view: rad.
        pixels: along either side.
    """

    name: str
    body: str
    position: Point
    direction: float
    field_of_view: float
    pixels: int


SOLID = 2
"""Bit of ``contype`` and ``conaffinity`` by which volumes touch each other and nothing else."""


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

    def write(
        self,
        world: Element,
        pads: Sequence[Pad],
        discs: Sequence[Disc],
        volumes: Sequence[Volume],
        cameras: Sequence[PinholeCamera],
    ) -> None:
        """Write everything.

        Args:
            world: ``<worldbody>``.
            pads: of any bodies.
            discs: objects.
            volumes: of any bodies.
            cameras: on any bodies.
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
        for volume in volumes:
            node = self._structure.node(volume.body)
            # What does not move has a body of its own, which leaves objects of the world out of
            # the pairs that do not touch.
            if node == WORLD and volume.body not in elements:
                elements[volume.body] = add(world, "body", name=volume.body)
            own = volume.body if node == WORLD else node
            self._volume(elements[own], volume, origins[node])
        for camera in cameras:
            node = self._structure.node(camera.body)
            self._camera(elements[node], camera, origins[node])

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

    def _camera(self, element: Element, camera: PinholeCamera, origin: np.ndarray) -> None:
        cosine, sine = math.cos(camera.direction), math.sin(camera.direction)
        add(
            element,
            "camera",
            name=camera.name,
            pos=place(np.array(camera.position) - origin),
            # It looks along −z of its own; its x lies in the plane, to the left of its axis.
            xyaxes=numbers(-sine, cosine, 0, 0, 0, -1),
            fovy=math.degrees(camera.field_of_view),  # whatever the unit of other angles
            resolution=f"{camera.pixels} {camera.pixels}",
        )

    def _volume(self, element: Element, volume: Volume, origin: np.ndarray) -> None:
        corners = [np.array(corner) - origin for corner in volume.corners]
        low, high = (end * MM for end in volume.across)
        radius, half, height = volume.radius * MM, (high - low) / 2, (low + high) / 2
        geoms: list[dict[str, str]] = [
            {"type": "cylinder", "size": numbers(radius, half), "pos": numbers(x, y, height)}
            for x, y in (corner * MM for corner in corners)
        ]
        around = corners + corners[:1] if len(corners) > 2 else corners
        for start, end in itertools.pairwise(around):
            length, (x, y) = math.dist(start, end), (start + end) / 2 * MM
            if length > SHORTEST:
                size = numbers(length / 2 * MM, radius, half)
                turn = numbers(0, 0, math.atan2(*(end - start)[::-1]))
                geoms.append(
                    {"type": "box", "size": size, "pos": numbers(x, y, height), "euler": turn}
                )
        for number, geom in enumerate(geoms):
            geom |= {"name": f"{volume.name} {number}", "rgba": color(self._colors[volume.body])}
            add(element, "geom", **geom, contype=SOLID, conaffinity=SOLID, mass=0)


def site_name(joint: str, body: str) -> str:
    """The site of a joint on a body or block, or of a fixed joint on `WORLD`."""
    return f"{joint} on {body}"
