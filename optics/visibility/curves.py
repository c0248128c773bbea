"""Curved mirrors: arcs of conic sections, and where a ray meets them.

In the frame of an arc, ξ runs along the chord from its middle and ζ to the chord's left, from the
vertex. With curvature c (the reciprocal of the radius at the vertex) and conic constant k the arc
is the part |ξ| ≤ half the chord of

    c ξ² + c (1 + k) ζ² − 2 ζ = 0,     ζ = c ξ² / (1 + √(1 − (1 + k) c² ξ²))

(D. Malacara, *Optical Shop Testing*, 3rd ed., appendix A), so a ray meets it at the roots of a
quadratic equation.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from designopt.numerics import safe_divide, safe_quadratic_roots, safe_sqrt
from designopt.vectors import Vector
from optics.visibility.unfolding import unit


class Arc(eqx.Module):
    """An arc of a conic section.

    Attributes:
        vertex: the vertex, on the perpendicular bisector of the chord.
        along: unit vector along the chord.
        half: half the length of the chord.
        curvature: reciprocal of the radius at the vertex; positive: the centre lies to the left.
        shape: 1 + k of the conic constant k: 1 for a circle, 0 for a parabola.
    """

    vertex: Vector
    along: Vector
    half: Float[Array, "*arcs"]
    curvature: Float[Array, "*arcs"]
    shape: Float[Array, "*arcs"]

    def local(self, arrow: Vector) -> Vector:
        """An arrow in the frame of the arc."""
        return arrow.turned(self.along.conjugate())

    def sag(self, across: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """ζ of the point at ξ."""
        return sag(across, self.curvature, self.shape)

    def place(self, coordinate: Float[Array, "*batch"]) -> Vector:
        """The point at a coordinate: 0 at the first end, 1 at the second, even along the chord."""
        across = (2 * coordinate - 1) * self.half
        return self.vertex + Vector(across, self.sag(across)).turned(self.along)

    def left_normal(self, place: Vector) -> Vector:
        """Normal to the left of the arc at a place in its frame, of any length, in that frame."""
        return Vector(-self.curvature * place.x, 1 - self.curvature * self.shape * place.y)

    def meetings(
        self, position: Vector, direction: Vector, on_arc: Bool[Array, ""]
    ) -> tuple[Float[Array, "2"], Bool[Array, "2"], Float[Array, ""]]:
        """Where a ray meets the conic.

        Args:
            position: where the ray begins, in the frame of the arc.
            direction: its direction, in that frame.
            on_arc: whether it begins on this arc; that point is none of the two.

        Returns:
            Both distances along the ray, which of them are on the arc and ahead, and a number
            that is 0 where the ray only touches the conic.
        """
        c, s = self.curvature, self.shape
        squared = c * (direction.x * direction.x + s * direction.y * direction.y)
        linear = 2 * (c * (position.x * direction.x + s * position.y * direction.y) - direction.y)
        constant = c * (position.x * position.x + s * position.y * position.y) - 2 * position.y
        roots, exist, touching = safe_quadratic_roots(
            squared, linear, jnp.where(on_arc, 0.0, constant)
        )
        x, y = position.x + roots * direction.x, position.y + roots * direction.y
        # The conic's other branch, or the far half of an ellipse, is not the mirror.
        near = c * s * y < 1
        return roots, exist & near & (jnp.abs(x) <= self.half) & (roots > 0), touching


def sag(
    across: Float[Array, "..."], curvature: Float[Array, "..."], shape: Float[Array, "..."]
) -> Float[Array, "..."]:
    """ζ of a conic section at ξ."""
    root = safe_sqrt(1 - shape * (curvature * across) ** 2)
    return curvature * across * across / (1 + root)


def arc_between(
    start: Vector, end: Vector, radius: Float[Array, "*arcs"], conic: Float[Array, "*arcs"]
) -> Arc:
    """The arc between two ends.

    Args:
        start: its first end.
        end: its second end.
        radius: at the vertex; positive if the centre lies to the left.
        conic: 0 for a circle, −1 for a parabola.
    """
    along, half = unit(end - start), (end - start).length() / 2
    curvature, _ = safe_divide(jnp.ones_like(radius), radius)
    shape = 1 + conic
    rise = sag(half, curvature, shape)
    middle = start + along.scaled(half)
    return Arc(middle - along.perpendicular().scaled(rise), along, half, curvature, shape)
