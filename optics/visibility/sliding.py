"""Rays whose source slides with their direction: an entrance pupil that moves with the angle.

In the unfolded picture of a path (`optics.visibility.unfolding`) all rays of a direction d come
from the place

    S(d) = S + (e₂ θ² + e₄ θ⁴) a,     θ the angle between d and the optical axis a,

the entrance pupil for that angle. Through a place A goes one ray, with (A − S(d)) × d = 0: that is
solved once, and the ray is a straight line as all others are. Shifts are taken to be small beside
the distances of what is seen, so that rays do not cross before it. On which side of a line the
camera is, is asked of the ray to the line's middle.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_arctan2, safe_divide, safe_sqrt
from designopt.vectors import Vector, stack, where

STEPS = 12
"""Steps to a source, of a first error of a part of a millimetre."""

LEAST = 0.1
"""Of the determinant of the last step: where it is smaller rays cross, and it means nothing."""


class Rays(NamedTuple):
    """Rays to places.

    Attributes:
        arrow: to the place from where the ray comes from.
        start: where it comes from.
    """

    arrow: Vector
    start: Vector


class Slide(eqx.Module):
    """From where rays come in the unfolded picture of a path; or of several, along a first axis.

    Attributes:
        start: the nominal source, the (virtual) camera's position.
        axis: its optical axis, a unit vector.
        pupil: e₂ and e₄ of the entrance pupil, in the unit of length.
        widest: angle from the axis beyond which the pupil is taken to stay, rad.
    """

    start: Vector
    axis: Vector
    pupil: Float[Array, "*paths 2"]
    widest: Float[Array, "*paths"]

    def source(self, toward: Vector, beside: Float[Array, "..."] | None = None) -> Vector:
        """From where rays come, by their directions.

        Args:
            toward: their directions in the section, of any length.
            beside: their way across the section for that length; none by default.
        """
        across, ahead = self.axis.cross(toward), self.axis.dot(toward)
        if beside is not None:
            across = safe_sqrt(across * across + beside * beside)
        square = jnp.minimum(jnp.abs(safe_arctan2(across, ahead)), self.widest) ** 2
        shift = square * (self.pupil[0] + square * self.pupil[1])
        return self.start + self.axis.scaled(shift)

    def rays_to(self, places: Vector, beside: Float[Array, "..."] | None = None) -> Rays:
        """The rays to places, which may lie beside the section."""

        def move(given: tuple[Slide, Vector, Array | None], at: Vector) -> Vector:
            slide, places, beside = given
            return slide.source(places - at, beside)

        start = settle(move, (self, places, beside), self.source(places - self.start, beside))
        return Rays(places - start, start)


def settle(move: Callable[[Any, Vector], Vector], given: Any, start: Vector) -> Vector:
    """Places that ``move(given, places)`` leaves where they are, each on its own.

    They are found without derivatives; a last Newton step carries those with respect to what is
    given. Moving them again and again converges, as shifts are small; that is hastened by what the
    step before has changed (D. G. Anderson, J. ACM 12 (1965) 547, of depth 1).
    """
    still, start = jax.lax.stop_gradient((given, start))

    def hasten(_: Any, state: tuple[Vector, Vector, Vector]) -> tuple[Vector, Vector, Vector]:
        at, before, gap_before = state
        gap = move(still, at) - at
        change = gap - gap_before
        part, _ = safe_divide(gap.dot(change), change.squared())
        back = (at - before + change).scaled(jnp.clip(part, -1.0, 1.0))
        return at + gap - back, at, gap

    moved = move(still, start)
    root = jax.lax.fori_loop(0, STEPS, hasten, (moved, start, moved - start))[0]
    root = jax.lax.stop_gradient(root)
    one, zero = jnp.ones_like(root.x), jnp.zeros_like(root.x)

    @jax.vmap
    def slope(way: Vector) -> Vector:
        return jax.jvp(lambda at: move(still, at), (root,), (way,))[1]

    slopes = slope(stack(Vector(one, zero), Vector(zero, one)))
    by_x, by_y = slopes[0], slopes[1]
    gap, first, second = move(given, root) - root, 1 - by_x.x, 1 - by_y.y
    determinant = first * second - by_x.y * by_y.x
    newton = Vector(second * gap.x + by_y.x * gap.y, by_x.y * gap.x + first * gap.y)
    crossing = determinant < LEAST
    scale = 1 / jnp.where(crossing, 1.0, determinant)
    return root + where(crossing, gap, newton.scaled(scale))
