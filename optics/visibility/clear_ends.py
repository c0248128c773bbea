"""Light through a clear end face of a layer, and down through the layers below to the membrane.

The end face leans against the layers, so the ray to a place on the membrane has no closed form. But a
pencil of rays from a point stays divergent through any flat surfaces: what lies farther along is
reached by rays that enter higher up. So every end of a view is one monotone equation for the place
of entry, bisected and then polished by one Newton step, which also carries its derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_divide, safe_sqrt
from designopt.vectors import Vector
from optics.visibility.refraction import fresnel

HALVINGS = 32
"""Bisections before the Newton step, which squares what they leave."""

BELOW, BEYOND = -1.0, 2.0
"""Entries of what no ray through the face meets: all pass beyond it, or none."""


class Inside(NamedTuple):
    """A ray behind a clear end face, in the pad's own axes.

    Attributes:
        entry: where it enters: along the pad and above its membrane.
        along: index of refraction times its direction's part along the pad, away from the face;
            the same in all layers.
        down: the same towards the membrane, in the layer that it enters.
        normal: index times cosine at the face, in air and in the layer.
        length: from the source to the face.
    """

    entry: Vector
    along: Float[Array, "*points"]
    down: Float[Array, "*points"]
    normal: tuple[Float[Array, "*points"], Float[Array, "*points"]]
    length: Float[Array, "*points"]


class EndCover(eqx.Module):
    """Layers behind a clear end face; lengths in units of the placed scene.

    In the methods a face is both ends of the end face, from the membrane's side on, and a source is
    where rays come from, for one face.

    Attributes:
        own: which surfaces hide nothing of it: the face itself.
        edges: labels of both ends of the face.
        flattest: labels of the flattest rays towards both.
        labels: labels of the ends of `windows`.
        origin: the membrane's first end.
        along: unit vector along the pad.
        normal: unit vector towards the sensing side.
        lower: the face's end at the membrane's side, along the pad and above it.
        upper: its end at the camera's side.
        outward: −1 at the pad's first end, 1 at its second.
        layer: index of its layer.
        thickness: of all layers of the pad, the outermost first.
        index: of refraction.
        places: along the pad, both ends of what rays may pass at the lower side of each layer, in
            the order in which rays from the face come to them.
        membrane: along the pad, both ends of the membrane.
        transmission: least part of the light that must come through.
    """

    own: Bool[Array, "*ends surfaces"]
    edges: Int[Array, "*ends 2"]
    flattest: Int[Array, "*ends 2"]
    labels: Int[Array, "*ends windows 2"]
    origin: Vector
    along: Vector
    normal: Vector
    lower: Vector
    upper: Vector
    outward: Float[Array, "*ends"]
    layer: Int[Array, "*ends"]
    thickness: Float[Array, "*ends layers"]
    index: Float[Array, "*ends layers"]
    places: Float[Array, "*ends layers 2"]
    membrane: Float[Array, "*ends 2"]
    transmission: Float[Array, "*ends"]

    def windows(self, face: Vector, source: Vector) -> Float[Array, "windows 2"]:
        """Entries of the rays to both ends of what may be passed behind each layer below.

        And, in a last row, of those that bring just the least transmission.
        """
        at_level = jax.vmap(jax.vmap(self._entry_of, (None, 0, None)), (0, 0, None))
        levels = jnp.arange(self.thickness.size)
        met = at_level(levels, self.places, source)
        met = jnp.where((levels >= self.layer)[:, None], met, jnp.array([BELOW, BEYOND]))
        return jnp.concatenate([met, self._bright(source)[None]])

    def coordinate(
        self, face: Vector, source: Vector, entries: Float[Array, " points"]
    ) -> Float[Array, " points"]:
        """Pad coordinates that rays reach, from their entries."""
        ray = self._inside(source, entries)
        cosines = self._below(ray)[1]
        steps = self._depths(ray) * ray.along[..., None] / cosines
        met = ray.entry.x - self.outward * jnp.sum(steps, axis=-1)
        first, last = self.membrane[0], self.membrane[1]
        return safe_divide(met - first, jnp.broadcast_to(last - first, met.shape))[0]

    def entries(
        self, face: Vector, source: Vector, coordinates: Float[Array, " points"]
    ) -> Float[Array, " points"]:
        """Entries of the rays that reach given pad coordinates."""
        last = jnp.asarray(self.thickness.size - 1)
        places = self.membrane[0] + coordinates * (self.membrane[1] - self.membrane[0])
        return jax.vmap(self._entry_of, (None, 0, None))(last, places, source)

    def scale(
        self, face: Vector, source: Vector, entries: Float[Array, " points"]
    ) -> tuple[Float[Array, " points"], Float[Array, " points"]]:
        """Angle at the source per length along the pad; length of the way to the membrane."""
        step, toward = face[1] - face[0], face[0] - source

        def met(entry: Float[Array, ""]) -> Float[Array, ""]:
            return self.coordinate(face, source, entry[None])[0]

        rise = jax.vmap(jax.grad(met))(entries) * (self.membrane[1] - self.membrane[0])
        arrow = Vector(toward.x + entries * step.x, toward.y + entries * step.y)
        turn, _ = safe_divide(jnp.abs(step.cross(toward)) / arrow.squared(), jnp.abs(rise))
        ray = self._inside(source, entries)
        ways = self._depths(ray) * self.index / self._below(ray)[1]
        return turn, ray.length + jnp.sum(ways, axis=-1)

    def _inside(self, source: Vector, entry: Float[Array, "*points"]) -> Inside:
        """The ray that enters at a place of the face."""
        toward = source - self.origin
        eye = Vector(self.along.dot(toward), self.normal.dot(toward))
        step = self.upper - self.lower
        length = step.length()
        up = step.scaled(safe_divide(jnp.ones_like(length), length)[0])
        # The normal into the layer.
        inward = up.perpendicular().scaled(self.outward)
        at = Vector(self.lower.x + entry * step.x, self.lower.y + entry * step.y)
        arrow = at - eye
        way = arrow.length()
        onto, _ = safe_divide(arrow.dot(inward), way)
        beside, _ = safe_divide(arrow.dot(up), way)
        index = self.index[self.layer]
        # Snell: n sin θ, the part along the face, stays (Born and Wolf, §1.5.1).
        through = safe_sqrt(index**2 - 1 + onto**2)
        along = beside * up.x + through * inward.x
        down = -(beside * up.y + through * inward.y)
        return Inside(at, -self.outward * along, down, (onto, through), way)

    def _below(
        self, ray: Inside
    ) -> tuple[Bool[Array, "*points layers"], Float[Array, "*points layers"]]:
        """In which layers the ray goes on, and index times cosine to the normal there."""
        own = self.index[self.layer]
        square = ray.down[..., None] ** 2 + (self.index**2 - own**2)
        # A ray that is totally reflected goes on along its layer.
        real = (square > SMALL) & (ray.down[..., None] > 0)
        return real, jnp.sqrt(jnp.where(real, square, SMALL))

    def _depths(self, ray: Inside) -> Float[Array, "*points layers"]:
        """How thick a ray finds each layer: less of its own, nothing of those before it."""
        layers = jnp.arange(self.thickness.size)
        own = ray.entry.y[..., None] - self.lower.y
        below = jnp.where(layers > self.layer, self.thickness, 0.0)
        return jnp.where(layers == self.layer, own, below)

    def _entry_of(
        self, level: Int[Array, ""], place: Float[Array, ""], source: Vector
    ) -> Float[Array, ""]:
        """Entry of the ray to a place at the lower side of a layer."""

        def short(cover: EndCover, entry: Array, place: Array, source: Vector) -> Array:
            # By how much a ray falls short of the place, times how steeply it goes down, so that it
            # is finite for rays that go up or along.
            ray = cover._inside(source, entry)
            depths, layers = cover._depths(ray), jnp.arange(cover.thickness.size)
            ratio = jnp.maximum(ray.down, 0.0) / cover._below(ray)[1]
            ratio = jnp.where(layers == cover.layer, 1.0, ratio)
            passed = jnp.where(layers <= level, depths * ratio, 0.0)
            ahead = -cover.outward * (place - ray.entry.x)
            return ahead * ray.down - ray.along * jnp.sum(passed)

        return _crossing(short, self, place, source)

    def _bright(self, source: Vector) -> Float[Array, "2"]:
        """Entries between which rays bring at least the least transmission."""

        def excess(cover: EndCover, entry: Array, least: Array, source: Vector) -> Array:
            return cover._transmission(source, entry) - least

        still, least, eye = jax.lax.stop_gradient((self, self.transmission, source))

        def narrow(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = ends
            first, second = low + (high - low) / 3, high - (high - low) / 3
            rises = still._transmission(eye, first) < still._transmission(eye, second)
            return jnp.where(rises, first, low), jnp.where(rises, high, second)

        zero = jnp.zeros_like(least)
        low, high = jax.lax.fori_loop(0, HALVINGS, narrow, (zero, zero + 1))
        best = (low + high) / 2

        def up_to(cover: EndCover, part: Array, least: Array, source: Vector) -> Array:
            return -excess(cover, part * best, least, source)

        def down_from(cover: EndCover, part: Array, least: Array, source: Vector) -> Array:
            return excess(cover, best + part * (1 - best), least, source)

        first = best * _crossing(up_to, self, self.transmission, source)
        last = best + (1 - best) * _crossing(down_from, self, self.transmission, source)
        enough = still._transmission(eye, best) >= least
        bright = jnp.stack([first, last])
        return jnp.where(enough, bright, jnp.array([BEYOND, BELOW]))

    def _transmission(self, source: Vector, entry: Float[Array, ""]) -> Float[Array, ""]:
        """Part of unpolarised light that comes to the membrane; negative where none does."""
        ray = self._inside(source, entry)
        real, cosines = self._below(ray)
        own, layers = self.index[self.layer], jnp.arange(self.thickness.size)
        below = layers >= self.layer
        cosines = jnp.where(below, cosines, cosines[self.layer])
        index = jnp.where(below, self.index, own)
        onto, through = ray.normal
        face = fresnel(jnp.stack([onto, through]), jnp.stack([jnp.ones_like(own), own]))
        inner = fresnel(cosines, index)
        part = (face[0] * inner[0] + face[1] * inner[1]) / 2
        dark = jnp.any(below & ~real) | (onto <= 0)
        return jnp.where(dark, jnp.minimum(ray.down, 0.0) - 1, part)


SMALL = 1e-12
"""Of the square of a cosine: a flatter ray goes on along its layer."""


def _crossing(
    function: Callable[..., Array], cover: EndCover, number: Float[Array, ""], source: Vector
) -> Float[Array, ""]:
    """Where from 0 to 1 a falling function of the entry vanishes; `BELOW` or `BEYOND` if nowhere.

    Args:
        function: of cover, entry, a number and the source.
        cover: the layers.
        number: what else it depends on.
        source: where rays come from.
    """
    still, frozen, eye = jax.lax.stop_gradient((cover, number, source))

    def halve(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) / 2
        ahead = function(still, middle, frozen, eye) > 0
        return jnp.where(ahead, middle, low), jnp.where(ahead, high, middle)

    zero = jnp.zeros_like(frozen)
    low, high = jax.lax.fori_loop(0, HALVINGS, halve, (zero, zero + 1))
    root = (low + high) / 2
    slope = jax.grad(function, 1)(still, root, frozen, eye)
    step, _ = safe_divide(function(cover, root, number, source), slope)
    polished = root - step
    below = function(still, zero, frozen, eye) <= 0
    beyond = function(still, zero + 1, frozen, eye) > 0
    return jnp.where(below, BELOW, jnp.where(beyond, BEYOND, polished))
