"""A lens in space: where points before a camera are imaged, whose pupil moves with the angle.

The camera frame has x towards greater columns, y towards greater rows and z along the optical axis;
its origin is the entrance pupil for rays along the axis. Lengths are mm; image places are (column,
row), with whole numbers at pixel centres.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import as_float, safe_sqrt
from optics.scene.camera import KannalaBrandt, shift_pupil

NEWTON_STEPS = 5
"""Of the angle at which a ray leaves the axis; the pupil moves by little against the distance."""


class Fisheye(eqx.Module):
    """A Kannala-Brandt lens before square pixels; every dimension is an array leaf.

    A point at the angle θ from the axis is imaged f (θ + k₁ θ³ + k₂ θ⁵ + …) from the principal
    point; its ray passes the axis e₂ θ² + e₄ θ⁴ before the origin.

    Attributes:
        focal: length f, px.
        principal: where the optical axis is imaged, column and row.
        coefficients: k₁, k₂, …
        pupil_shift: e₂ (mm/rad²) and e₄ (mm/rad⁴).

    Example:
        >>> lens = Fisheye(400.0, jnp.array([639.5, 479.5]), jnp.zeros(4), jnp.zeros(2))
        >>> lens.places(jnp.array([30.0, 0.0, 30.0])).round(2).tolist()  # at 45°
        [953.66, 479.5]
    """

    focal: Float[Array, ""] = eqx.field(converter=as_float)
    principal: Float[Array, "2"] = eqx.field(converter=as_float)
    coefficients: Float[Array, " coefficients"] = eqx.field(converter=as_float)
    pupil_shift: Float[Array, "2"] = eqx.field(converter=as_float)

    @property
    def projection(self) -> KannalaBrandt:
        """From angles to image heights, in focal lengths."""
        return KannalaBrandt(self.coefficients)

    def shift(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """How far before the origin a ray at an angle (rad) from the axis passes it, mm."""
        return shift_pupil(self.pupil_shift, angle)

    @eqx.filter_jit  # the loop would be compiled at every call
    def angles(self, points: Float[Array, "*batch 3"]) -> Float[Array, "*batch"]:
        """Angle from the axis (rad) at which the ray of each point passes the axis.

        The root of ρ cos θ − (z − e(θ)) sin θ, with ρ the point's distance from the axis.
        """
        off, along = _off_axis(points), points[..., 2]

        def step(angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
            sine, cosine, square = jnp.sin(angle), jnp.cos(angle), angle * angle
            rate = angle * (2 * self.pupil_shift[0] + 4 * square * self.pupil_shift[1])
            before = along - self.shift(angle)
            slope = -off * sine - before * cosine + rate * sine
            # A point at the pupil itself has no ray.
            slope = jnp.where(jnp.abs(slope) > 1e-9, slope, -1.0)
            return angle - (off * cosine - before * sine) / jax.lax.stop_gradient(slope)

        start = jax.lax.stop_gradient(jnp.arctan2(off, along))
        near = jax.lax.fori_loop(
            0, NEWTON_STEPS - 1, lambda _, angle: jax.lax.stop_gradient(step(angle)), start
        )
        # The derivative of one more step, its slope held, is that of the root.
        return step(jax.lax.stop_gradient(near))

    @eqx.filter_jit
    def places(self, points: Float[Array, "*batch 3"]) -> Float[Array, "*batch 2"]:
        """Column and row at which points (mm, camera frame) are imaged."""
        off = _off_axis(points)
        aside = off > 1e-9
        radius = self.focal * self.projection.height(self.angles(points))
        straight = jnp.where(points[..., 2] != 0, points[..., 2], 1.0)
        scale = jnp.where(aside, radius / jnp.where(aside, off, 1.0), self.focal / straight)
        away = scale[..., None] * points[..., :2]
        return jnp.broadcast_to(self.principal, away.shape) + away

    @eqx.filter_jit
    def rays(
        self, places: Float[Array, "*batch 2"]
    ) -> tuple[Float[Array, "*batch 3"], Float[Array, "*batch"]]:
        """Unit vectors of what is imaged at places, and how far before the origin each begins."""
        away = places - jnp.broadcast_to(self.principal, places.shape)
        radius = safe_sqrt(jnp.sum(away * away, axis=-1))
        angle = self.projection.angle(radius / self.focal)
        there = radius > 0
        scale = jnp.where(there, jnp.sin(angle) / jnp.where(there, radius, 1.0), 1 / self.focal)
        across = scale[..., None] * away
        return jnp.concatenate([across, jnp.cos(angle)[..., None]], axis=-1), self.shift(angle)


def _off_axis(points: Float[Array, "*batch 3"]) -> Float[Array, "*batch"]:
    x, y = points[..., 0], points[..., 1]
    return safe_sqrt(x * x + y * y)
