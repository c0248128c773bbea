"""Rays whose source slides with their direction: moving entrance pupils, and layers on mirrors.

In the unfolded picture of a path (`optics.visibility.unfolding`) all rays of a direction d come
from the place

    S(d) = S + (e₂ θ² + e₄ θ⁴) a,     θ the angle between d and the optical axis a,

the entrance pupil for that angle. A mirror behind layers of thicknesses t and indices n on it is
unfolded at their outermost surface. A ray at the angle ϑ from its normal ν leaves 2 Σ t tan ϑ′ from
where it enters, as if it came from a place that lies deeper by

    2 Σ t tan ϑ′ / tan ϑ = 2 Σ t cos ϑ / √(n² − 1 + cos²ϑ)

(Snell's law, n sin ϑ′ = sin ϑ), so S(d) slides along −ν by that, on all legs behind the mirror.
Through a place A goes one ray, with (A − S(d)) × d = 0: that is solved once, and the ray is a
straight line as all others are. Shifts are taken to be small beside the distances of what is seen,
so that rays do not cross before it. On which side of a line the camera is, is asked of the ray to
the line's middle.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from designopt.numerics import safe_arctan2, safe_divide, safe_sqrt
from designopt.vectors import Vector, stack, where
from optics.visibility.refraction import row_of

STEPS = 12
"""Steps to a source, of a first error of a part of a millimetre."""

LEAST = 0.1
"""Of the determinant of the last step: where it is smaller rays cross, and it means nothing."""

LAST = 1 << 30
"""In place of the number of a path's last leg."""


class Rays(NamedTuple):
    """Rays to places.

    Attributes:
        arrow: to the place from where the ray comes from on its leg.
        start: where it comes from on the path's last leg.
    """

    arrow: Vector
    start: Vector


class Slide(eqx.Module):
    """From where rays come in the unfolded picture of a path; or of several, along a first axis.

    Attributes:
        start: the nominal source, the (virtual) camera's position.
        axis: its optical axis, a unit vector.
        pupil: e₂ and e₄ of the entrance pupil, in the unit of length, and the angle from the axis
            beyond which it is taken to stay, rad; ``None`` if it stays anyway.
        normals: of the path's mirrors, unit vectors in the sense in which rays leave them; ``None``
            if no mirror has layers.
        thickness: of the layers on them; 0 where there is none.
        index: of refraction.
    """

    start: Vector
    axis: Vector
    pupil: tuple[Float[Array, "*paths 2"], Float[Array, "*paths"]] | None = None
    normals: Vector | None = None
    thickness: Float[Array, "*paths reflections layers"] | None = None
    index: Float[Array, "*paths reflections layers"] | None = None

    def source(
        self,
        toward: Vector,
        beside: Float[Array, "..."] | None = None,
        leg: Int[Array, "..."] | int = LAST,
    ) -> Vector:
        """From where rays come, by their directions.

        Args:
            toward: their directions in the section, of any length.
            beside: their way across the section for that length; none by default.
            leg: of the path, on which they come from there; the last one by default.
        """
        at = self.start
        for mirror in range(self._count):
            normal, depth, _ = self._sheet(mirror, toward, beside)
            at = at - normal.scaled(jnp.where(mirror < leg, depth, 0.0))
        if self.pupil is None:
            return at + toward.scaled(jnp.zeros_like(toward.x))
        coefficients, widest = self.pupil
        across, ahead = self.axis.cross(toward), self.axis.dot(toward)
        if beside is not None:
            across = safe_sqrt(across * across + beside * beside)
        square = jnp.minimum(jnp.abs(safe_arctan2(across, ahead)), widest) ** 2
        return at + self.axis.scaled(square * (coefficients[0] + square * coefficients[1]))

    def rays_to(
        self,
        places: Vector,
        beside: Float[Array, "..."] | None = None,
        leg: Int[Array, "..."] | int = LAST,
    ) -> Rays:
        """The rays to places on a leg, which may lie beside the section."""

        def move(given: tuple[Slide, Vector, Array | None], at: Vector) -> Vector:
            slide, places, beside = given
            return slide.source(places - at, beside, leg)

        first = self.source(places - self.start, beside, leg)
        start = settle(move, (self, places, beside), first)
        arrow = places - start
        return Rays(arrow, self.source(arrow, beside) if self._count else start)

    def longer(self, toward: Vector) -> Float[Array, "..."]:
        """By how much paths through mirrors' layers are longer than straight ones, by direction."""
        parts = [self._sheet(mirror, toward, None) for mirror in range(self._count)]
        return sum((more for *_, more in parts), jnp.zeros_like(toward.x))

    @property
    def _count(self) -> int:
        return 0 if self.thickness is None else self.thickness.shape[0]

    def _sheet(
        self, mirror: int, toward: Vector, beside: Float[Array, "..."] | None
    ) -> tuple[Vector, Array, Array]:
        """Of a mirror the normal, and for rays by how much S slides and `longer`.

        A path through a layer is 2 t / cos ϑ′ long, 2 t / (n cos ϑ′) of it for a straight one.
        """
        assert self.normals is not None
        assert self.thickness is not None
        assert self.index is not None
        normal, thickness, index = self.normals[mirror], self.thickness[mirror], self.index[mirror]
        length = toward.squared() if beside is None else toward.squared() + beside * beside
        # For rays that would not come from the mirror at all the even function does no harm.
        cosine, _ = safe_divide(jnp.abs(normal.dot(toward)), safe_sqrt(length))
        square = row_of(index**2 - 1, cosine) + (cosine * cosine)[..., None]
        inside, _ = safe_divide(jnp.ones_like(square), safe_sqrt(square))
        depth = cosine * jnp.sum(row_of(2 * thickness, cosine) * inside, axis=-1)
        more = jnp.sum(row_of(2 * thickness * (index - 1), cosine) * inside, axis=-1)
        return normal, depth, more


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
