"""Light through the flat layers on a pad, after Snell: where a line of sight meets each level.

From a source at height h over the outermost surface, a ray under the slope w (tangent of the angle
from the normal, in air) has gone along the pad, at the lower side of layers of thicknesses t and
indices n,

    x(w) = h w + Σ t w / √(n² + (n² − 1) w²),

since n sin θ is the same in all layers (M. Born, E. Wolf, *Principles of Optics*, 7th ed., §1.5.1).
For w > 0 it rises and is concave, so Newton's method climbs from any lower bound of the root to the
root and never passes it, down to grazing incidence.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Shaped

from designopt.numerics import safe_divide
from designopt.vectors import Vector

STEPS = 16
"""Newton steps; 600,000 random stacks and heights down to 1e-8 of the offset took 14 at most."""

HALVINGS = 60
"""Bisections of the flattest ray's grazing angle, to rounding in double precision."""


class FrontCover(eqx.Module):
    """Layers behind the outermost surface of a pad; lengths in units of the placed scene.

    Places along the pad are counted from the start of the surface that is free. In the methods a
    face is both ends of that surface and a source is where rays come from, for one pad.

    Attributes:
        own: which surfaces are of the pad's own body and hide nothing of it: not its bezel.
        edges: labels of both ends of the surface that is free.
        flattest: labels of the flattest rays towards both.
        labels: labels of the ends of `windows`.
        thickness: of the layers, the outermost first.
        index: of refraction.
        places: along the pad, first and second end of what rays may pass at the lower side of each
            layer; the last is the membrane.
    """

    own: Bool[Array, "*pads surfaces"]
    edges: Int[Array, "*pads 2"]
    flattest: Int[Array, "*pads 2"]
    labels: Int[Array, "*pads layers 2"]
    thickness: Float[Array, "*pads layers"]
    index: Float[Array, "*pads layers"]
    places: Float[Array, "*pads layers 2"]

    @property
    def length(self) -> Float[Array, "*pads"]:
        """Of the membrane."""
        return self.places[..., -1, 1] - self.places[..., -1, 0]

    def windows(self, face: Vector, source: Vector) -> Float[Array, "layers 2"]:
        """Entries of the lines of sight to both ends of what may be passed behind each layer."""
        height, foot, length = _seen_from(face, source)
        above = jnp.tril(jnp.broadcast_to(self.thickness, (self.thickness.size,) * 2))
        to_level = jax.vmap(jax.vmap(slope_to, (None, None, None, 0)), (None, 0, None, 0))
        slopes = to_level(height, above, self.index, self.places - foot)
        return (foot + height * slopes) / length

    def window(self, face: Vector, source: Vector, number: Int[Array, ""]) -> Float[Array, ""]:
        """One of the `windows`, for a source of its own."""
        height, foot, length = _seen_from(face, source)
        above = jnp.where(jnp.arange(self.thickness.size) <= number // 2, self.thickness, 0.0)
        slope = slope_to(height, above, self.index, self.places.reshape(-1)[number] - foot)
        return (foot + height * slope) / length

    def coordinate(
        self, face: Vector, source: Vector, entries: Float[Array, " points"]
    ) -> Float[Array, " points"]:
        """Pad coordinates that rays reach, from their entries."""
        height, foot, length = _seen_from(face, source)
        slope = (entries * length - foot) / height
        met = foot + along_of(height, self.thickness, self.index, slope)
        first, last = self.places[-1]
        return safe_divide(met - first, jnp.broadcast_to(last - first, met.shape))[0]

    def entries(
        self, face: Vector, source: Vector, coordinates: Float[Array, " points"]
    ) -> Float[Array, " points"]:
        """Entries of the rays that reach given pad coordinates."""
        height, foot, length = _seen_from(face, source)
        first, last = self.places[-1]
        along = first + coordinates * (last - first) - foot
        slopes = jax.vmap(slope_to, (None, None, None, 0))
        return (foot + height * slopes(height, self.thickness, self.index, along)) / length

    def scale(
        self, face: Vector, source: Vector, entries: Float[Array, " points"]
    ) -> tuple[Float[Array, " points"], Float[Array, " points"]]:
        """Angle at the source per length along the pad, dθ/ds = 1 / ((1 + w²) dx/dw); way to it."""
        height, foot, length = _seen_from(face, source)
        slope = (entries * length - foot) / height
        per_length, _ = safe_divide(
            1 / (1 + slope**2), rise_of(height, self.thickness, self.index, slope)
        )
        return per_length, length_of(height, self.thickness, self.index, slope)


def _seen_from(face: Vector, source: Vector) -> tuple[Array, Array, Array]:
    """Height of a source over a surface, the place along it below, and the surface's length.

    The height is positive also of a source behind it.
    """
    step, toward = face[1] - face[0], source - face[0]
    length = step.length()
    length = jnp.where(length > 0, length, 1.0)
    height = jnp.abs(step.cross(toward)) / length
    return jnp.where(height > 0, height, 1.0), step.dot(toward) / length, length


def row_of(
    of_layers: Shaped[Array, " layers"], points: Shaped[Array, "*points"]
) -> Shaped[Array, "..."]:
    """Numbers of the layers along a last axis, to stand beside any points."""
    return of_layers.reshape((1,) * points.ndim + of_layers.shape)


def _cosines(
    index: Float[Array, " layers"], slope: Float[Array, "*points"]
) -> tuple[Float[Array, "*points layers"], Float[Array, "*points 1"]]:
    """√(n² + (n² − 1) w²), index times cosine in each layer over the cosine in air; the slope."""
    w = slope[..., None]
    return jnp.sqrt(row_of(index**2, slope) + row_of(index**2 - 1, slope) * w * w), w


def along_of(
    height: Float[Array, ""],
    thickness: Float[Array, " layers"],
    index: Float[Array, " layers"],
    slope: Float[Array, "*points"],
) -> Float[Array, "*points"]:
    """How far along the pad rays of given slopes go: x(w)."""
    cosine, w = _cosines(index, slope)
    return height * slope + jnp.sum(row_of(thickness, slope) * w / cosine, axis=-1)


def rise_of(
    height: Float[Array, ""],
    thickness: Float[Array, " layers"],
    index: Float[Array, " layers"],
    slope: Float[Array, "*points"],
) -> Float[Array, "*points"]:
    """Derivative of `along_of` with respect to the slope."""
    cosine, _ = _cosines(index, slope)
    return height + jnp.sum(row_of(thickness * index**2, slope) / cosine**3, axis=-1)


def length_of(
    height: Float[Array, ""],
    thickness: Float[Array, " layers"],
    index: Float[Array, " layers"],
    slope: Float[Array, "*points"],
) -> Float[Array, "*points"]:
    """Lengths of rays from the source to the last level."""
    cosine, _ = _cosines(index, slope)
    return jnp.sqrt(1 + slope**2) * (
        height + jnp.sum(row_of(thickness * index, slope) / cosine, axis=-1)
    )


def slope_to(
    height: Float[Array, ""],
    thickness: Float[Array, " layers"],
    index: Float[Array, " layers"],
    along: Float[Array, ""],
) -> Float[Array, ""]:
    """The slope of the ray that goes a distance along the pad: the inverse of `along_of`."""
    h, t, n, x = jax.lax.stop_gradient((height, thickness, index, jnp.abs(along)))
    # Two lower bounds of the root: no layer bends less than for rays along the normal, and none
    # shifts more than at grazing incidence.
    near, _ = safe_divide(x, h + jnp.sum(t / n))
    bends = n > 1
    shift = jnp.sum(jnp.where(bends, t / jnp.sqrt(jnp.where(bends, n**2 - 1, 1.0)), 0.0))
    unbent = jnp.any(~bends & (t > 0))
    far, _ = safe_divide(jnp.where(unbent, 0.0, x - shift), h)
    start = jnp.maximum(near, far)

    def climb(_: Any, w: Float[Array, ""]) -> Float[Array, ""]:
        return w + (x - along_of(h, t, n, w)) / rise_of(h, t, n, w)

    root = jnp.sign(along) * jax.lax.fori_loop(0, STEPS, climb, start)
    root = jax.lax.stop_gradient(root)
    # One more step with all derivatives: those of the root, by the theorem of implicit functions.
    missed = along - along_of(height, thickness, index, root)
    return root + missed / jax.lax.stop_gradient(rise_of(height, thickness, index, root))


def fresnel(
    cosines: Float[Array, "*points media"], index: Float[Array, " media"]
) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
    """Part of light that comes through surfaces: polarised across the plane, and in it.

    Source: E. Hecht, *Optics*, 5th ed., §4.6.3: through one surface comes 4 q q′ / (q + q′)², with
    q = n cos θ for light polarised across the plane of incidence and q = cos θ / n in it. What is
    reflected twice and more is left out.

    Args:
        cosines: n cos θ in every medium, θ between ray and normal.
        index: of refraction of every medium.
    """

    def through(q: Float[Array, "*points media"]) -> Float[Array, "*points"]:
        before, after = q[..., :-1], q[..., 1:]
        return jnp.prod(safe_divide(4 * before * after, (before + after) ** 2)[0], axis=-1)

    return through(cosines), through(cosines / row_of(index**2, cosines[..., 0]))


def transmission(
    index: Float[Array, " layers"], grazing: Float[Array, "*points"]
) -> Float[Array, "*points"]:
    """Part of unpolarised light that comes through all surfaces to the membrane.

    Args:
        index: of refraction, of the layers from the outermost on.
        grazing: angle in air between ray and outermost surface, rad.
    """
    sine = jnp.sin(grazing)[..., None]
    cosines = jnp.concatenate([sine, jnp.sqrt(row_of(index**2 - 1, grazing) + sine**2)], axis=-1)
    across, within = fresnel(cosines, jnp.concatenate([jnp.ones_like(index[:1]), index]))
    return (across + within) / 2


def least_grazing(index: Float[Array, " layers"], least: Float[Array, ""]) -> Float[Array, ""]:
    """Grazing angle in air (rad) under which just a given part of the light comes through.

    A quarter turn if less comes through along the normal; 0 if all rays bring more.
    """
    n, wanted = jax.lax.stop_gradient((index, least))

    def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) / 2
        enough = transmission(n, middle) >= wanted
        return jnp.where(enough, low, middle), jnp.where(enough, middle, high)

    ends = jnp.zeros_like(wanted), jnp.full_like(wanted, jnp.pi / 2)
    root = jax.lax.fori_loop(0, HALVINGS, halve, ends)[1]
    slope = jax.grad(transmission, 1)(n, root)
    step, _ = safe_divide(least - transmission(index, root), slope)
    inside = (wanted > 0) & (root < jnp.pi / 2)
    return root + jnp.where(inside, step - jax.lax.stop_gradient(step), 0.0)
