"""A linkage's dimensions as distances between joints, each of which a person can turn."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.numerics import safe_sqrt
from designopt.vectors import Vector
from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import SliderTable
from kinematics.io.sketch_geometry import measure_sketch
from kinematics.model.linkage import Link, Linkage
from kinematics.model.topology import WORLD, Structure

TOGETHER = 1e-9
"""How far, relative to their body, joints may be apart, or beside a line, and count as on it."""

Distances = Float[Array, " distances"]


@dataclass(frozen=True)
class Distance:
    """How far two joints of a body are apart.

    Attributes:
        body: the body's name; ``"fixed"`` of joints of several fixed bodies.
        ends: its joints.
    """

    body: str
    ends: tuple[str, str]

    @property
    def name(self) -> str:
        """As in the JSON export."""
        return f"bodies.{self.body}.{'-'.join(self.ends)}"

    @property
    def label(self) -> str:
        """For people."""
        return f"{self.body} {'–'.join(self.ends)}"


@dataclass(frozen=True)
class Corner:
    """How a body's third or further joint is placed.

    Attributes:
        to_first: number of its distance to the first joint; none where it is at that joint.
        to_second: number of its distance to the second; none where it is in line with both.
        side: −1 or +1: on which side of the line from first to second; or of the first joint.
    """

    to_first: int | None
    to_second: int | None
    side: float


@dataclass(frozen=True)
class Frame:
    """How the joints of a body, or all fixed ones (`WORLD`), are placed by distances.

    Attributes:
        body: its name.
        joints: in order.
        base: number of the distance of the first two.
        corners: of all others.
    """

    body: str
    joints: tuple[str, ...]
    base: int
    corners: tuple[Corner, ...]

    def triangles(self) -> list[tuple[int, int, int]]:
        """Numbers of the three distances of each triangle."""
        return [
            (self.base, part.to_first, part.to_second)
            for part in self.corners
            if part.to_first is not None and part.to_second is not None
        ]


@dataclass(frozen=True)
class Tie:
    """A slider's line that goes through joints of its body.

    Attributes:
        slider: its number.
        start: joint of its first point; none where that is at none.
        end: joint of its second point.
        points: both in the frame of the body, mm, as drawn.
    """

    slider: int
    start: str | None
    end: str | None
    points: tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Dimensions:
    """Which distances make a linkage.

    Attributes:
        distances: all of them.
        frames: what they place.
        ties: lines that follow joints.
        free: numbers of the distances that a person may change, the links' own lengths first.
    """

    distances: tuple[Distance, ...]
    frames: tuple[Frame, ...]
    ties: tuple[Tie, ...]
    free: tuple[int, ...]

    @classmethod
    def of(cls, design: DesignedLinkage) -> tuple[Dimensions, np.ndarray]:
        """The distances of a design, and their values, mm."""
        linkage, structure = design.linkage, design.linkage.structure
        drawn = measure_sketch(design.sketch, design.name)
        distances: list[Distance] = []
        values: list[float] = []
        frames: list[Frame] = []
        for body in structure.moving:
            places = _link_places(linkage.links[body.name])
            frames.append(_framed(body.name, body.joints, places, distances, values))
        fixed = [body.name for body in structure.bodies if body.fixed]
        anchors = np.asarray(linkage.anchors, float)
        if len(anchors) > 1 and np.hypot(*(anchors[1] - anchors[0])) > 0:
            step = (anchors[1] - anchors[0]) / np.hypot(*(anchors[1] - anchors[0]))
            turn = np.array([[step[0], step[1]], [-step[1], step[0]]])
            places = (anchors - anchors[0]) @ turn.T
            name = fixed[0] if len(fixed) == 1 else "fixed"
            frame = _framed(name, structure.fixed_joints, places, distances, values)
            frames.append(replace(frame, body=WORLD))
        sliders = drawn.sketch.sliders
        ties = tuple(_ties(sliders, drawn.dimensions.points, structure, design))
        own = [frame.base for frame in frames if frame.body != WORLD]
        ground = [frame.base for frame in frames if frame.body == WORLD]
        further = [n for n in range(len(distances)) if n not in own and n not in ground]
        held = _held(structure, sliders, design.sketch.sliders, ties)
        order = (*own, *further, *ground)
        free = tuple(n for n in order if distances[n].body not in held)
        return cls(tuple(distances), tuple(frames), ties, free), np.array(values)

    def broken(self, values: Sequence[float]) -> str:
        """What is wrong with a triangle that cannot be, and its cure; empty if all can be."""
        for frame in self.frames:
            for triangle in frame.triangles():
                longest = max(triangle, key=lambda n: values[n])
                if 2 * values[longest] > sum(values[n] for n in triangle) * (1 + 1e-12):
                    said = ", ".join(
                        f"{'-'.join(self.distances[n].ends)} = {values[n]:.6g}" for n in triangle
                    )
                    return (
                        f"{self.distances[triangle[0]].body}: {said} mm make no triangle; "
                        "change one of them."
                    )
        return ""

    def slack(self, values: Distances) -> Float[Array, " triangles"]:
        """How far each triangle is from being flat: twice its area over its longest sides' product.

        Negative where the distances make no triangle; the sine of an angle, squared.
        """
        found = [
            _height(values, *triangle)[1] for frame in self.frames for triangle in frame.triangles()
        ]
        return jnp.stack(found) if found else jnp.ones(1, values.dtype)

    def linkage(self, linkage: Linkage, values: Distances) -> Linkage:
        """The linkage with these distances. Traced by JAX.

        Args:
            linkage: the design that these are the dimensions of.
            values: every distance, mm.
        """
        known: dict[str, dict[str, Vector]] = {}
        anchors, links = linkage.anchors, {}
        for frame in self.frames:
            places = _placed(frame, values)
            if frame.body == WORLD:
                step = linkage.anchors[1] - linkage.anchors[0]
                along = Vector(step[0], step[1]).scaled(1 / jnp.hypot(step[0], step[1]))
                places = [place.turned(along) + linkage.origin for place in places]
                anchors = jnp.stack([place.stacked() for place in places])
            else:
                rest = [place.stacked() for place in places[2:]]
                shape = linkage.links[frame.body].places
                links[frame.body] = Link(
                    values[frame.base], jnp.stack(rest) if rest else jnp.zeros_like(shape)
                )
            known[frame.body] = dict(zip(frame.joints, places, strict=True))
        return replace(
            linkage,
            anchors=anchors,
            links={**linkage.links, **links},
            lines=self._lines(linkage, known),
        )

    def _lines(self, linkage: Linkage, known: Mapping[str, Mapping[str, Vector]]) -> tuple:
        lines = list(linkage.lines)
        for tie in self.ties:
            body = linkage.structure.node(linkage.structure.sliders[tie.slider].on)
            if body not in known:
                continue
            start, end = (
                Vector(*map(jnp.asarray, point)) if joint is None else known[body][joint]
                for joint, point in zip((tie.start, tie.end), tie.points, strict=True)
            )
            lines[tie.slider] = replace(
                lines[tie.slider], point=start.stacked(), angle=(end - start).angle()
            )
        return tuple(lines)


def _link_places(link: Link) -> np.ndarray:
    return np.vstack([[0.0, 0.0], [float(link.length), 0.0], np.asarray(link.places, float)])


def _framed(
    name: str,
    joints: tuple[str, ...],
    places: np.ndarray,
    distances: list[Distance],
    values: list[float],
) -> Frame:
    """The frame of a body with the first joint at the origin, the second along +x."""

    def number(first: int, second: int) -> int:
        distances.append(Distance(name, (joints[first], joints[second])))
        values.append(math.dist(places[first], places[second]))
        return len(distances) - 1

    base = number(0, 1)
    size = float(np.max(np.hypot(*places.T)))
    corners = []
    for index in range(2, len(joints)):
        x, y = places[index]
        if math.hypot(x, y) <= TOGETHER * size:
            corners.append(Corner(None, None, 1.0))
        elif abs(y) <= TOGETHER * math.hypot(x, y):
            corners.append(Corner(number(0, index), None, math.copysign(1.0, x)))
        else:
            first, second = number(0, index), number(1, index)
            corners.append(Corner(first, second, math.copysign(1.0, y)))
    return Frame(name, joints, base, tuple(corners))


def _placed(frame: Frame, values: Distances) -> list[Vector]:
    zero = jnp.zeros_like(values[0])
    places = [Vector(zero, zero), Vector(values[frame.base], zero)]
    for part in frame.corners:
        if part.to_first is None:
            places.append(places[0])
        elif part.to_second is None:
            places.append(Vector(part.side * values[part.to_first], zero))
        else:
            along, square = _height(values, frame.base, part.to_first, part.to_second)
            height = values[part.to_first] * safe_sqrt(square)
            places.append(Vector(along, part.side * height))
    return places


def _height(
    values: Distances, base: int, first: int, second: int
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Of a triangle's corner: its place along the base, and the first angle's sine, squared."""
    length, a, b = values[base], values[first], values[second]
    along = (length * length + a * a - b * b) / (2 * length)
    cosine = along / a
    return along, 1 - cosine * cosine


def _ties(
    sliders: Sequence[SliderTable],
    points: np.ndarray,
    structure: Structure,
    design: DesignedLinkage,
) -> list[Tie]:
    """Lines with a point at a joint of their body."""
    places = design.sketch.joints
    found = []
    for index, slider in enumerate(sliders):
        body = structure.body(slider.on)
        held = {places[joint]: joint for joint in reversed(body.joints)}
        start, end = (held.get(point) for point in slider.line)
        if start is None and end is None:
            continue
        angle, length = float(design.linkage.lines[index].angle), math.dist(*slider.line)
        x, y = points[index].tolist()
        last = x + length * math.cos(angle), y + length * math.sin(angle)
        found.append(Tie(index, start, end, ((x, y), last)))
    return found


def _held(
    structure: Structure,
    merged: Sequence[SliderTable],
    drawn: Sequence[SliderTable],
    ties: Sequence[Tie],
) -> set[str]:
    """Bodies whose shape also says how another one is kept from turning."""
    written = [(slider.joint, slider.keeps) for slider in drawn]
    held: set[str] = set()
    for index, slider in enumerate(merged):
        if slider.keeps is None:
            continue
        if (slider.joint, slider.keeps) not in written:
            held.add(slider.keeps)
        first = structure.body(slider.on).joints[0]
        for tie in ties:
            if tie.slider == index and {tie.start, tie.end} - {None, first}:
                held.add(slider.on)
    return held
