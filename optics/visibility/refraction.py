"""Light through the flat layers on a pad, after Snell: where a line of sight meets each level.

From a source at height h over the outermost surface, a ray under the slope w (tangent of the angle
from the normal, in air) has gone along the pad, at the lower side of layers of thicknesses t and
indices n,

    x(w) = h w + Σ t w / √(n² + (n² − 1) w²),

since n sin θ is the same in all layers (M. Born, E. Wolf, *Principles of Optics*, 7th ed., §1.5.1).
For w > 0 it rises and is concave, so Newton's method climbs from any lower bound of the root to the
root and never passes it, down to grazing incidence.

Rays beside this one, from the same place on the membrane, leave in the section as if they came from

    √(1 + w²) x′(w)

away: that is the radius of curvature of their wave at the source (ibid., §4.6.2, refraction of a
thin pencil), and along the normal the reduced length h + Σ t / n. Across the section the wave is
curved otherwise, its radius √(1 + w²) x(w) / w.
"""

from __future__ import annotations

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Shaped

from designopt.numerics import bisect, safe_divide
from designopt.vectors import Vector, vector
from optics.scene.layers import Layers, Profile
from optics.scene.scene import Scene

Points = Float[Array, " points"]

STEPS = 32
"""Newton steps at most. Of 600,000 random stacks, heights down to 1e-8 of the offset, none needed
more than 14, and none more than 20 where, besides, layers hardly bend, down to 1e-8."""


def row_of(
    of_layers: Shaped[Array, " layers"], points: Shaped[Array, "*points"]
) -> Shaped[Array, "..."]:
    """Numbers of the layers along a last axis, to stand beside any points."""
    return of_layers.reshape((1,) * points.ndim + of_layers.shape)


class Stack(eqx.Module):
    """A source over layers. The slope of a ray is the tangent of its angle from the normal in air.

    Attributes:
        height: of the source over the outermost surface.
        thickness: of the layers, the outermost first.
        index: of refraction.
    """

    height: Float[Array, "*stacks"]
    thickness: Float[Array, "*stacks layers"]
    index: Float[Array, "*stacks layers"]

    def _cosines(
        self, slope: Float[Array, "*points"]
    ) -> tuple[Float[Array, "*points layers"], Float[Array, "*points 1"]]:
        """√(n² + (n² − 1) w²), index times cosine in each layer over that in air; the slope."""
        w, squares = slope[..., None], self.index**2
        return jnp.sqrt(row_of(squares, slope) + row_of(squares - 1, slope) * w * w), w

    def along(self, slope: Float[Array, "*points"]) -> Float[Array, "*points"]:
        """How far along the pad rays of one stack go: x(w)."""
        cosine, w = self._cosines(slope)
        beyond = jnp.sum(row_of(self.thickness, slope) * w / cosine, axis=-1)
        return self.height * slope + beyond

    def rise(self, slope: Float[Array, "*points"]) -> Float[Array, "*points"]:
        """Derivative of `along` with respect to the slope."""
        cosine, _ = self._cosines(slope)
        scaled = row_of(self.thickness * self.index**2, slope)
        return self.height + jnp.sum(scaled / cosine**3, axis=-1)

    def way(self, slope: Float[Array, "*points"]) -> Float[Array, "*points"]:
        """Lengths of rays from the source to the last level."""
        cosine, _ = self._cosines(slope)
        beyond = jnp.sum(row_of(self.thickness * self.index, slope) / cosine, axis=-1)
        return jnp.sqrt(1 + slope**2) * (self.height + beyond)

    def slope_to(self, along: Float[Array, ""]) -> Float[Array, ""]:
        """The slope of the ray that goes a distance along the pad: the inverse of `along`."""
        still, x = jax.lax.stop_gradient((self, jnp.abs(along)))
        h, t, n = still.height, still.thickness, still.index
        # Two lower bounds of the root: no layer bends less than for rays along the normal, and none
        # shifts more than at grazing incidence.
        near, _ = safe_divide(x, h + jnp.sum(t / n))
        bends = n > 1
        shift = jnp.sum(jnp.where(bends, t / jnp.sqrt(jnp.where(bends, n**2 - 1, 1.0)), 0.0))
        unbent = jnp.any(~bends & (t > 0))
        far, _ = safe_divide(jnp.where(unbent, 0.0, x - shift), h)
        start = jnp.maximum(near, far)

        def rises(state: tuple[Array, Array, Array]) -> Bool[Array, ""]:
            number, w, step = state
            return (step > enough * w) & (number < STEPS)

        def climb(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            number, w, _ = state
            step = (x - still.along(w)) / still.rise(w)
            return number + 1, w + step, step

        # After a step of a share s of w, 3/2 s² of w is missing at most, for |w x″ / 2 x′| ≤ 3/2.
        enough = jnp.sqrt(jnp.finfo(x.dtype).eps)
        first = jnp.zeros((), int), start, jnp.full_like(start, jnp.inf)
        root = jnp.sign(along) * jax.lax.while_loop(rises, climb, first)[1]
        root = jax.lax.stop_gradient(root)
        # One more step with all derivatives: those of the root, by the theorem of implicit
        # functions.
        missed = along - self.along(root)
        return root + missed / jax.lax.stop_gradient(self.rise(root))


class Scale(NamedTuple):
    """How large and how far places appear.

    Attributes:
        per_length: angle at the source per length along the pad, dθ/ds.
        way: length of the ray.
        apparent: radius of curvature of the wave at the source, in the section; ``None`` if it is
            that length.
    """

    per_length: Points
    way: Points
    apparent: Points | None


class Cover(eqx.Module):
    """Layers behind a surface; lengths in units of the placed scene.

    In the methods a face is both ends of that surface, entries are coordinates on it, and a source
    is where rays come from, for one surface.

    Attributes:
        thickness: of all layers of the pad, the outermost first.
        index: of refraction.
        places: along the pad, both ends of what rays may pass at the lower side of each layer, in
            the order in which rays from the surface come to them; the last is the membrane.
    """

    thickness: Float[Array, "*faces layers"]
    index: Float[Array, "*faces layers"]
    places: Float[Array, "*faces layers 2"]

    @abc.abstractmethod
    def windows(self, face: Vector, source: Vector) -> Float[Array, "rows 2"]:
        """Entries of the lines of sight to both ends of what may be passed behind each layer."""

    def window(self, face: Vector, source: Vector, number: Int[Array, ""]) -> Float[Array, ""]:
        """One end of the `windows`, both ends of each in turn, for a source of its own."""
        return self.windows(face, source).reshape(-1)[number]

    @property
    def rows(self) -> int:
        """How many rows the `windows` have."""
        return self.thickness.shape[-1]

    @property
    def length(self) -> Float[Array, "*faces"]:
        """Of the membrane."""
        return jnp.abs(self.places[..., -1, 1] - self.places[..., -1, 0])

    @abc.abstractmethod
    def coordinate(self, face: Vector, source: Vector, entries: Points) -> Points:
        """Pad coordinates that rays reach, from their entries."""

    @abc.abstractmethod
    def entries(self, face: Vector, source: Vector, coordinates: Points) -> Points:
        """Entries of the rays that reach given pad coordinates."""

    @abc.abstractmethod
    def scale(self, face: Vector, source: Vector, entries: Points) -> Scale:
        """How large and how far places appear, from the entries of the rays to them."""


class FrontCover(Cover):
    """Layers behind an outermost surface; places are counted from where it is free of a bezel."""

    @classmethod
    def of(cls, scene: Scene, layers: Layers, size: Float[Array, ""]) -> FrontCover:
        """Those of all pads, from the layers that they have."""
        profile = profile_of(scene, layers)
        first = profile.face()[:, 0] + layers.lip[:, 0]
        places = (profile.windows() - first[:, None, None]) / size
        return cls(layers.thickness / size, layers.green, places)

    def windows(self, face: Vector, source: Vector) -> Float[Array, "layers 2"]:
        """As `Cover.windows`."""
        stack, foot, length = self._over(face, source)
        above = jnp.tril(jnp.broadcast_to(self.thickness, (self.thickness.size,) * 2))

        def to_level(thickness: Float[Array, " layers"], place: Float[Array, ""]) -> Array:
            return Stack(stack.height, thickness, self.index).slope_to(place - foot)

        slopes = jax.vmap(jax.vmap(to_level, (None, 0)))(above, self.places)
        return (foot + stack.height * slopes) / length

    def coordinate(self, face: Vector, source: Vector, entries: Points) -> Points:
        """Pad coordinates that rays reach, from their entries."""
        stack, foot, length = self._over(face, source)
        slope = (entries * length - foot) / stack.height
        met = foot + stack.along(slope)
        first, last = self.places[-1]
        return safe_divide(met - first, jnp.broadcast_to(last - first, met.shape))[0]

    def entries(self, face: Vector, source: Vector, coordinates: Points) -> Points:
        """Entries of the rays that reach given pad coordinates."""
        stack, foot, length = self._over(face, source)
        first, last = self.places[-1]
        along = first + coordinates * (last - first) - foot
        return (foot + stack.height * jax.vmap(stack.slope_to)(along)) / length

    def scale(self, face: Vector, source: Vector, entries: Points) -> Scale:
        """As `Cover.scale`."""
        stack, foot, length = self._over(face, source)
        slope = (entries * length - foot) / stack.height
        rise = stack.rise(slope)
        per_length, _ = safe_divide(1 / (1 + slope**2), rise)
        return Scale(per_length, stack.way(slope), jnp.sqrt(1 + slope**2) * rise)

    def _over(self, face: Vector, source: Vector) -> tuple[Stack, Array, Array]:
        """The layers below a source, the place along the surface below it, the surface's length.

        The source's height is positive also behind the surface.
        """
        step, toward = face[1] - face[0], source - face[0]
        length = step.length()
        length = jnp.where(length > 0, length, 1.0)
        height = jnp.abs(step.cross(toward)) / length
        height = jnp.where(height > 0, height, 1.0)
        return Stack(height, self.thickness, self.index), step.dot(toward) / length, length


def profile_of(scene: Scene, layers: Layers) -> Profile:
    """The profiles of all pads."""
    ends = vector(scene.pads)
    return Profile.of(layers, (ends[:, 1] - ends[:, 0]).length())


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
    ends = jnp.zeros_like(wanted), jnp.full_like(wanted, jnp.pi / 2)
    _, root = bisect(lambda angle: transmission(n, angle) < wanted, *ends)
    slope = jax.grad(transmission, 1)(n, root)
    step, _ = safe_divide(least - transmission(index, root), slope)
    inside = (wanted > 0) & (root < jnp.pi / 2)
    root = root + jnp.where(inside, step - jax.lax.stop_gradient(step), 0.0)
    return jnp.where(wanted > 0, root, 0.0)
