"""Plane vectors as two arrays, and the few operations on them that a plane problem needs."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from designopt.numerics import safe_arctan2, safe_sqrt


class Vector(eqx.Module):
    """A plane vector, batched or not: two arrays of one shape, which stay apart in memory.

    A rotation is a unit vector (cos φ, sin φ), applied by `turned`.
    """

    x: Float[Array, "*batch"]
    y: Float[Array, "*batch"]

    def __add__(self, other: Vector) -> Vector:
        return Vector(self.x + other.x, self.y + other.y)

    def __sub__(self, other: Vector) -> Vector:
        return Vector(self.x - other.x, self.y - other.y)

    def __neg__(self) -> Vector:
        return Vector(-self.x, -self.y)

    def __getitem__(self, index: Any) -> Vector:
        return Vector(self.x[index], self.y[index])

    __iter__ = None  # it would never end: indices beyond the last one give the last one

    def scaled(self, factor: Float[Array, "*batch"]) -> Vector:
        """The vector times a number, or times each of several; shapes broadcast."""
        return Vector(factor * self.x, factor * self.y)

    def turned(self, rotation: Vector) -> Vector:
        """The vector turned by a rotation: the product of two complex numbers."""
        return Vector(
            rotation.x * self.x - rotation.y * self.y, rotation.x * self.y + rotation.y * self.x
        )

    def conjugate(self) -> Vector:
        """The mirror image in the x axis; of a rotation, its inverse."""
        return Vector(self.x, -self.y)

    def perpendicular(self) -> Vector:
        """The vector turned by a quarter turn counter-clockwise."""
        return Vector(-self.y, self.x)

    def dot(self, other: Vector) -> Float[Array, "*batch"]:
        """The scalar product."""
        return self.x * other.x + self.y * other.y

    def cross(self, other: Vector) -> Float[Array, "*batch"]:
        """The z component of the vector product."""
        return self.x * other.y - self.y * other.x

    def squared(self) -> Float[Array, "*batch"]:
        """The squared length."""
        return self.dot(self)

    def length(self) -> Float[Array, "*batch"]:
        """The length; 0 with zero slope for the zero vector."""
        return safe_sqrt(self.squared())

    def angle(self) -> Float[Array, "*batch"]:
        """The angle from +x in radians, −π to π; 0 with zero slope for the zero vector."""
        return safe_arctan2(self.y, self.x)

    def stacked(self) -> Float[Array, "*batch 2"]:
        """The vector as one array whose last axis is (x, y)."""
        return jnp.stack([self.x, self.y], axis=-1)


def rotation(angle: Float[Array, "*batch"]) -> Vector:
    """The unit vector at an angle in radians, counter-clockwise from +x."""
    return Vector(jnp.cos(angle), jnp.sin(angle))


def vector(array: Float[Array, "*batch 2"]) -> Vector:
    """A vector from an array whose last axis is (x, y)."""
    return Vector(array[..., 0], array[..., 1])


def stack(*vectors: Vector) -> Vector:
    """Several vectors of one shape as one, along a new first axis."""
    return Vector(jnp.stack([v.x for v in vectors]), jnp.stack([v.y for v in vectors]))


def where(condition: Bool[Array, "*batch"], yes: Vector, no: Vector) -> Vector:
    """One vector where a condition holds, another elsewhere; shapes broadcast."""
    return Vector(jnp.where(condition, yes.x, no.x), jnp.where(condition, yes.y, no.y))


def fold_angle(first: Vector, second: Vector) -> Float[Array, "*batch"]:
    """The angle between the lines along two vectors, radians, 0 to π/2; finite for zero vectors.

    Example:
        >>> import math
        >>> east, northwest = vector(jnp.array([1.0, 0.0])), vector(jnp.array([-1.0, 1.0]))
        >>> round(math.degrees(fold_angle(east, northwest)), 4)
        45.0
    """
    return safe_arctan2(jnp.abs(first.cross(second)), jnp.abs(first.dot(second)))


def direction_to_meeting(
    point: Vector, first: tuple[Vector, Vector], second: tuple[Vector, Vector]
) -> Vector:
    """Direction of the line from a point to where two lines meet, such as an instant centre.

    In homogeneous coordinates, so that parallel lines meet as well: far away, along themselves.

    Args:
        point: where to look from, mm.
        first: two points of one line, mm.
        second: two points of the other, mm.

    Returns:
        A vector along that line, of either sense and any length.

    Example:
        >>> o, x, y = (vector(jnp.array(place)) for place in ([0.0, 0.0], [1.0, 0.0], [0.0, 1.0]))
        >>> way = direction_to_meeting(vector(jnp.array([-1.0, -1.0])), (o, x), (o, y))
        >>> float(way.x) == float(way.y)  # both lines meet at the origin
        True
    """
    along, other = first[1] - first[0], second[1] - second[0]
    scale = along.cross(other)
    return (first[0] - point).scaled(scale) + along.scaled((second[0] - first[0]).cross(other))
