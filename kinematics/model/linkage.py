"""A linkage as a pytree: every dimension an array leaf, everything structural static."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_divide
from designopt.vectors import Vector, rotation, vector
from kinematics.model.topology import WORLD, Structure


def direction_of(step: Vector) -> Vector:
    """The unit vector along a step; +x, without derivative, for the zero vector."""
    inverse, apart = safe_divide(jnp.ones_like(step.x), step.length())
    return Vector(jnp.where(apart, step.x * inverse, 1.0), step.y * inverse)


class Link(eqx.Module):
    """A moving rigid body, in its own frame: first joint at the origin, second along +x.

    Attributes:
        length: from the first to the second joint, mm.
        places: coordinates of the third and every further joint, mm, shape (joints − 2, 2).
    """

    length: Float[Array, "*design"]
    places: Float[Array, "*design rest 2"]

    def place(self, index: int) -> Vector:
        """Coordinates of the joint at ``index`` in the body's list, in the body's frame."""
        if index == 0:
            return Vector(jnp.zeros_like(self.length), jnp.zeros_like(self.length))
        if index == 1:
            return Vector(self.length, jnp.zeros_like(self.length))
        return vector(self.places[..., index - 2, :])


class Line(eqx.Module):
    """The line that a joint slides along, in the frame of the body it is fixed in.

    The fixed body's frame is the world's.

    Attributes:
        point: its first point, from which the slide is measured, mm.
        angle: its direction, rad.
        turn: angle of the body that is kept from turning, relative to the body of the line, rad;
            ``None`` for a pin in a slot.
    """

    point: Float[Array, "*design 2"]
    angle: Float[Array, "*design"]
    turn: Float[Array, "*design"] | None


class Spring(eqx.Module):
    """A torsion spring between two bodies.

    Its moment is stiffness · (Δ + preload), where Δ is the angle of the second body relative to
    the first, measured from the assembled sketch.

    Attributes:
        stiffness: N mm/rad.
        preload: rad.
    """

    stiffness: Float[Array, "*design"]
    preload: Float[Array, "*design"]


class ReferenceConfiguration(eqx.Module):
    """The assembled sketch: where poses that need an iteration start, and springs are measured.

    It is no dimension: nothing has a derivative with respect to it.

    Attributes:
        inputs: value of each input there, rad or mm.
        angles: angle of each moving body, rad.
        slides: place of each slider, mm.
    """

    inputs: Float[Array, "*design inputs"]
    angles: Float[Array, "*design moving"]
    slides: Float[Array, "*design sliders"]


class Linkage(eqx.Module):
    """A planar linkage. Read one from a file with `read_linkage`.

    Dimensions are array leaves, so `jax.grad` and `jax.vmap` apply to the linkage itself, and a
    tolerance or a bound is a linkage whose leaves are spreads or limits.

    Attributes:
        anchors: positions of the fixed joints, mm, in the order of ``structure.fixed_joints``.
        links: the moving bodies by name.
        lines: the sliders' lines, in order.
        springs: the springs, in order.
        reference: the assembled sketch.
        structure: who is joined to whom.
        assembly: one sign per closed-form group of the plan: on which side it is assembled (0
            for a group that has no choice or is followed by continuation).
    """

    anchors: Float[Array, "*design fixed 2"]
    links: dict[str, Link]
    lines: tuple[Line, ...]
    springs: tuple[Spring, ...]
    reference: ReferenceConfiguration
    structure: Structure = eqx.field(static=True)
    assembly: tuple[int, ...] = eqx.field(static=True)

    @classmethod
    def of(
        cls, numbers: Mapping[str, Any], structure: Structure, assembly: tuple[int, ...]
    ) -> Linkage:
        """The linkage of numbers by the attributes' names, in JAX's default float type.

        Args:
            numbers: `AssembledSketch.numbers`.
            structure: who is joined to whom.
            assembly: the signs.
        """
        arrays: Any = jax.tree.map(lambda one: jnp.asarray(one, float), dict(numbers))
        return cls(
            arrays["anchors"],
            {body.name: Link(**arrays["links"][body.name]) for body in structure.moving},
            tuple(Line(**line) for line in arrays["lines"]),
            tuple(Spring(**spring) for spring in arrays["springs"]),
            ReferenceConfiguration(**arrays["reference"]),
            structure,
            assembly,
        )

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, in the order in which their values are given."""
        return tuple(part.name for part in self.structure.inputs)

    @property
    def origin(self) -> Vector:
        """The first fixed joint; poses are computed relative to it, wherever the world's is."""
        return vector(self.anchors[..., 0, :])

    def anchor(self, joint: str) -> Vector:
        """Position of a fixed joint relative to `origin`, mm."""
        index = self.structure.fixed_joints.index(joint)
        return vector(self.anchors[..., index, :]) - self.origin

    def home_angle(self, body: str) -> Float[Array, "*design"]:
        """Angle of a moving body in the assembled sketch, rad."""
        names = [part.name for part in self.structure.moving]
        return jax.lax.stop_gradient(self.reference.angles[..., names.index(body)])

    def fixed_direction(self, body: str) -> Vector:
        """Direction of a fixed body: from its first to its second joint, +x if it has but one."""
        joints = self.structure.body(body).joints
        if len(joints) == 1:
            one = jnp.ones_like(self.anchors[..., 0, 0])
            return Vector(one, jnp.zeros_like(one))
        return direction_of(self.anchor(joints[1]) - self.anchor(joints[0]))

    def place(self, body: str, joint: str) -> Vector:
        """Coordinates of a joint in the frame of its body (`WORLD`: relative to `origin`), mm."""
        if body == WORLD:
            return self.anchor(joint)
        return self.links[body].place(self.structure.body(body).joints.index(joint))

    def line_point(self, slider: int) -> Vector:
        """First point of a slider's line in the frame of its body (`WORLD`: from `origin`), mm."""
        point = vector(self.lines[slider].point)
        fixed = self.structure.node(self.structure.sliders[slider].on) == WORLD
        return point - self.origin if fixed else point

    def slide_shift(self, slider: int) -> Float[Array, "*design"]:
        """How far a line's first point is from the foot of the perpendicular to it, mm."""
        return rotation(self.lines[slider].angle).dot(self.line_point(slider))

    def scaled(self) -> tuple[Linkage, Float[Array, "*design"]]:
        """The linkage with its `origin` at 0 and all lengths in units of `size`, and that size.

        The lines' first points move along them to the feet of the perpendiculars from the origin
        of their body (`slide_shift`).
        """
        size = self.size()
        origin = self.origin.stacked()

        def moved(slider: int, line: Line) -> Line:
            # Its foot, not its first point: that may lie anywhere along it.
            along = rotation(line.angle)
            foot = along.perpendicular().scaled(along.cross(self.line_point(slider)))
            return eqx.tree_at(lambda line: line.point, line, foot.stacked() / size)

        links = {
            name: Link(link.length / size, link.places / size) for name, link in self.links.items()
        }
        lines = tuple(moved(slider, line) for slider, line in enumerate(self.lines))
        anchors = (self.anchors - origin[..., None, :]) / size
        return eqx.tree_at(
            lambda linkage: (linkage.anchors, linkage.links, linkage.lines),
            self,
            (anchors, links, lines),
        ), size

    def size(self) -> Float[Array, "*design"]:
        """The largest dimension, mm: the unit in which poses are computed. It has no gradient."""
        lengths = [jnp.abs(link.length) for link in self.links.values()]
        joints = self.structure.fixed_joints
        lengths += [self.anchor(joint).length() for joint in joints[1:]]
        for slider, part in enumerate(self.structure.sliders):
            if self.structure.node(part.on) == WORLD:
                # Only the line's distance counts: its first point may lie anywhere on it.
                along = rotation(self.lines[slider].angle)
                lengths.append(jnp.abs(along.cross(self.line_point(slider))))
        largest = lengths[0]
        for length in lengths[1:]:
            largest = jnp.maximum(largest, length)
        return jax.lax.stop_gradient(jnp.where(largest > 0, largest, 1.0))
