"""A linkage as a drawing to build from, and its numbers, in the sketched pose."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from designopt.export.drawing import (
    Circle,
    Drawing,
    Label,
    Layer,
    LinearDimension,
    Place,
    Polyline,
    round_down,
)
from designopt.export.json import Quantity
from designopt.io.files import printable
from kinematics.model.assembled import (
    assembled_angles,
    assembled_joints,
    assembled_size,
    own_places,
    zeroed,
)
from kinematics.model.linkage import Linkage
from kinematics.model.topology import WORLD, BodyPart, InputPart, Structure
from kinematics.plot.scene import Scene

if TYPE_CHECKING:
    from kinematics.io.designed import DesignedLinkage

PIN = 0.03
"""A pin's radius is at most this part of the linkage's size, …"""

APART = 0.3
"""… and this part of the least distance between two joints of a body."""

COINCIDENT = 1e-9
"""Joints so near to each other, as a part of the linkage's size, have no distance to measure."""

MOST_NOTED = 5
"""More springs than these leave no room for the drawing; they are but counted."""


def make_linkage_drawing(design: DesignedLinkage, *, pose: bool = True) -> Drawing:
    """The drawing of a linkage in its sketched pose: `draw_linkage`, dimensions and notes.

    Args:
        design: the linkage.
        pose: whether a note names the pose.
    """
    linkage = design.linkage
    structure = linkage.structure
    scene = sketched_scene(linkage)
    measures: dict[frozenset[str], LinearDimension] = {}
    for part in structure.bodies:
        for pair in itertools.combinations(part.joints, 2):
            first, second = (_at(scene, joint) for joint in pair)
            if math.dist(first, second) > COINCIDENT * scene.size:
                measures.setdefault(frozenset(pair), LinearDimension(first, second))
    notes = [
        *(["in the sketched pose"] if pose else []),
        f"pins are drawn {2 * _pin_radius(scene):g} mm wide, whatever their diameter will be",
    ]
    if structure.sliders:
        notes.append("lines that joints slide along are drawn a little way to both sides")
    springs = [
        f"spring {first} – {second}: {float(spring.stiffness):g} N mm/rad, "
        f"preload {float(spring.preload):g} rad"
        for (first, second), spring in zip(structure.springs, linkage.springs, strict=True)
    ]
    notes += springs if len(springs) <= MOST_NOTED else [f"{len(springs)} springs"]
    drawing = draw_linkage(scene, title=printable(design.name))
    return drawing._replace(dimensions=list(measures.values()), notes=notes)


def sketched_scene(linkage: Linkage) -> Scene:
    """The sketched pose of a linkage; nothing is solved or compiled."""
    return Scene.at(
        linkage.structure,
        assembled_size(linkage),
        {
            name: np.array([place.real, place.imag])
            for name, place in assembled_joints(linkage).items()
        },
        assembled_angles(linkage),
        [
            (float(line.angle), slide)
            for line, slide in zip(linkage.lines, _slides(linkage), strict=True)
        ],
    )


def draw_linkage(scene: Scene, *, title: str = "") -> Drawing:
    """The shapes of a linkage in any pose, without dimensions and notes.

    Every body has a layer of its own with its bars or its outline, its slots, and a circle at each
    of its pins: those of two bodies lie on each other. Joints that join nothing are crosses.

    Args:
        scene: the pose: `sketched_scene`, or ``Scene.of(linkage, pose)`` of a pose that is not
            batched.
        title: of the drawing.
    """
    structure = scene.structure
    radius = _pin_radius(scene)
    polylines, circles = [], []
    labels: dict[str, Label] = {}
    for part in structure.bodies:
        for line in _lines(scene, part):
            polylines.append(_stroke(part.name, line))
        for joint in part.joints:
            place = _at(scene, joint)
            if _partners(structure, joint) > 1:
                circles.append(Circle(part.name, joint, place, radius))
            else:
                polylines += _cross(part.name, joint, place, radius)
            labels.setdefault(joint, Label(part.name, place, joint))
    return Drawing(
        title=title,
        layers=[Layer(part.name, "body") for part in structure.bodies],
        polylines=polylines,
        circles=circles,
        labels=list(labels.values()),
    )


def linkage_quantities(design: DesignedLinkage) -> list[Quantity]:
    """Every number of a linkage.

    Of every joint its place in the sketched pose and in its body's own frame (first joint at the
    origin, second along +x; a fixed body's is the world's), and of every body the distances
    between its joints and its angle in the sketched pose; then sliders, called as their joints,
    inputs, and springs, called as their bodies. Where names repeat a number follows.
    """
    linkage = design.linkage
    structure = linkage.structure
    joints = assembled_joints(linkage)
    found = [
        Quantity(f"joints.{joint}.{axis}", value, "mm")
        for joint in structure.joints
        for axis, value in zip("xy", _place(joints[joint]), strict=True)
    ]
    for part in structure.bodies:
        found += _body_quantities(linkage, part)
    names = _told_apart([f"sliders.{part.joint}" for part in structure.sliders])
    for name, line, slide in zip(names, linkage.lines, _slides(linkage), strict=True):
        x, y = np.asarray(line.point, float).tolist()
        found += [
            Quantity(f"{name}.point.x", x, "mm"),
            Quantity(f"{name}.point.y", y, "mm"),
            Quantity(f"{name}.angle", _degrees(float(line.angle)), "°"),
            Quantity(f"{name}.slide", slide, "mm"),
        ]
        if line.turn is not None:
            found.append(Quantity(f"{name}.turn", _degrees(float(line.turn)), "°"))
    homes = np.asarray(linkage.reference.inputs, float).tolist()
    for part, value in zip(structure.inputs, homes, strict=True):
        number = (zeroed(value), "mm") if part.body is None else (_degrees(value), "°")
        found.append(Quantity(f"inputs.{part.name}", *number, note=_meaning(structure, part)))
    names = _told_apart([f"springs.{'-'.join(pair)}" for pair in structure.springs])
    for name, spring in zip(names, linkage.springs, strict=True):
        found += [
            Quantity(f"{name}.stiffness", float(spring.stiffness), "N mm/rad"),
            Quantity(f"{name}.preload", float(spring.preload), "rad"),
        ]
    return found


def _told_apart(names: Sequence[str]) -> list[str]:
    """Names, with a number after each that there is more than once."""
    found = []
    for index, name in enumerate(names):
        number = names[: index + 1].count(name)
        found.append(f"{name}.{number}" if names.count(name) > 1 else name)
    return found


def _meaning(structure: Structure, part: InputPart) -> str:
    """What an input's value is."""
    if part.body is None:
        assert part.slider is not None  # it is the one or the other
        slider = structure.sliders[part.slider]
        return f"place of {slider.joint} along its line on {slider.on}"
    return f"angle of {_way(structure, part.body)} from {_way(structure, part.relative_to)}"


def _way(structure: Structure, body: str) -> str:
    """The direction that a body's angle is that of."""
    joints = () if body == WORLD else structure.body(body).joints[:2]
    return f"{body} ({'-'.join(joints)})" if len(joints) == 2 else "+x"


def _body_quantities(linkage: Linkage, part: BodyPart) -> Iterator[Quantity]:
    name, own = f"bodies.{part.name}", own_places(linkage, part)
    for first, second in itertools.combinations(part.joints, 2):
        yield Quantity(f"{name}.{first}-{second}", abs(own[second] - own[first]), "mm")
    if part.fixed:  # its joints' own places are those in the world
        return
    for joint in part.joints:
        for axis, value in zip("xy", _place(own[joint]), strict=True):
            yield Quantity(f"{name}.{joint}.{axis}", value, "mm")
    yield Quantity(f"{name}.angle", _degrees(float(linkage.home_angle(part.name))), "°")


def _slides(linkage: Linkage) -> list[float]:
    return [zeroed(slide) for slide in np.asarray(linkage.reference.slides, float).tolist()]


def _degrees(angle: float) -> float:
    return zeroed(math.degrees(angle))


def _lines(scene: Scene, part: BodyPart) -> list[np.ndarray]:
    """What is drawn of a body: bars or an outline, its slots and, of a moving one, bars to them."""
    outlines = scene.outlines(part.name)
    if part.fixed:
        outlines = outlines[: len(part.joints) > 1]
    return [*outlines, *scene.strips(part.name)]


def _pin_radius(scene: Scene) -> float:
    """Of all pins, mm: files give places of pins, not their diameters."""
    joints = {name: place.tolist() for name, place in scene.joints.items()}
    apart = [
        math.dist(joints[first], joints[second])
        for part in scene.structure.bodies
        for first, second in itertools.combinations(part.joints, 2)
    ]
    clear = [APART * distance for distance in apart if distance > COINCIDENT * scene.size]
    return round_down(min([PIN * scene.size, *clear]))


def _partners(structure: Structure, joint: str) -> int:
    """How many bodies meet at a joint: that hold it, or on which it slides."""
    moving = sum(joint in part.joints for part in structure.moving)
    sliding = sum(part.joint == joint for part in structure.sliders)
    return moving + sliding + (joint in structure.fixed_joints)


def _cross(layer: str, joint: str, place: Place, radius: float) -> list[Polyline]:
    x, y = place
    return [
        Polyline(layer, [(x - radius, y), (x + radius, y)], name=joint),
        Polyline(layer, [(x, y - radius), (x, y + radius)], name=joint),
    ]


def _stroke(layer: str, line: np.ndarray) -> Polyline:
    places = [(x, y) for x, y in line.tolist()]
    closed = len(places) > 2 and places[0] == places[-1]
    return Polyline(layer, places[:-1] if closed else places, closed)


def _place(place: complex) -> Place:
    return place.real, place.imag


def _at(scene: Scene, joint: str) -> Place:
    x, y = scene.joints[joint].tolist()
    return x, y
