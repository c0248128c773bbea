"""Light through a clear end face of a layer, and down through the layers below to the membrane.

The end face leans against the layers, so the ray to a place on the membrane has no closed form. But
a pencil of rays from a point stays divergent through any flat surfaces: what lies farther along is
reached by rays that enter higher up. So every end of a view is one monotone equation for the place
of entry, bisected and then polished by one Newton step, which also carries its derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_divide, safe_sqrt
from designopt.vectors import Vector
from optics.visibility.refraction import fresnel, row_of

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


SMALL = 1e-12
"""Of the square of a cosine: a flatter ray goes on along its layer, as one that is reflected."""


class Sought(eqx.Module):
    """A ray that is sought by what it meets.

    Attributes:
        level: the layer whose lower side it passes.
        place: where, along the pad.
        brightness: 1 or −1 for the ray that brings just the least transmission instead, beyond
            which rays bring less, or before which.
    """

    level: Int[Array, "*rays"]
    place: Float[Array, "*rays"]
    brightness: Float[Array, "*rays"]


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

    @property
    def length(self) -> Float[Array, "*ends"]:
        """Of the membrane."""
        return self.membrane[..., 1] - self.membrane[..., 0]

    def windows(self, face: Vector, source: Vector) -> Float[Array, "windows 2"]:
        """Entries of the rays to both ends of what may be passed behind each layer below.

        And, in a last row, of those that bring just the least transmission.
        """
        best = self._brightest(source)
        levels, dtype = jnp.arange(self.thickness.size), best.dtype
        sought = Sought(
            jnp.append(jnp.repeat(levels, 2), jnp.zeros(2, int)),
            jnp.concatenate([self.places.reshape(-1), jnp.zeros(2, dtype)]),
            jnp.concatenate([jnp.zeros(2 * levels.size, dtype), jnp.array([-1.0, 1.0], dtype)]),
        )
        zero = jnp.zeros_like(sought.place)
        low, high = zero.at[-1].set(best), (zero + 1).at[-2].set(best)
        met = jax.vmap(self._crossing, (0, 0, 0, None))(sought, low, high, source).reshape(-1, 2)
        free = jnp.array([BELOW, BEYOND], dtype)
        below = jnp.append(levels >= self.layer, True)[:, None]
        dark = jax.lax.stop_gradient(self._excess(best, source)) < 0
        return jnp.where(below, met, free).at[-1].set(jnp.where(dark, free[::-1], met[-1]))

    def window(self, face: Vector, source: Vector, number: Int[Array, ""]) -> Float[Array, ""]:
        """One of the `windows`, for a source of its own."""
        level, second = number // 2, number % 2
        by_light, best = level == self.thickness.size, self._brightest(source)
        sign = jnp.where(second > 0, 1.0, -1.0).astype(best.dtype)
        place = self.places.reshape(-1)[jnp.minimum(number, self.places.size - 1)]
        brightness, zero = jnp.where(by_light, sign, 0.0), jnp.zeros_like(best)
        low = jnp.where(brightness > 0, best, zero)
        high = jnp.where(brightness < 0, best, zero + 1)
        met = self._crossing(Sought(level, place, brightness), low, high, source)
        dark = by_light & (jax.lax.stop_gradient(self._excess(best, source)) < 0)
        free = jnp.where((second > 0) != dark, BEYOND, BELOW)
        return jnp.where((level < self.layer) | dark, free, met)

    def coordinate(
        self, face: Vector, source: Vector, entries: Float[Array, " points"]
    ) -> Float[Array, " points"]:
        """Pad coordinates that rays reach, from their entries."""
        ray = self._inside(source, entries)
        cosines = _root(self._below(ray))
        steps = self._depths(ray) * ray.along[..., None] / cosines
        met = ray.entry.x - self.outward * jnp.sum(steps, axis=-1)
        first, last = self.membrane[0], self.membrane[1]
        return safe_divide(met - first, jnp.broadcast_to(last - first, met.shape))[0]

    def entries(
        self, face: Vector, source: Vector, coordinates: Float[Array, " points"]
    ) -> Float[Array, " points"]:
        """Entries of the rays that reach given pad coordinates."""
        places = self.membrane[0] + coordinates * (self.membrane[1] - self.membrane[0])
        zero = jnp.zeros_like(places)
        last = jnp.full(places.shape, self.thickness.size - 1)
        sought = Sought(last, places, zero)
        return jax.vmap(self._crossing, (0, 0, 0, None))(sought, zero, zero + 1, source)

    def scale(
        self, face: Vector, source: Vector, entries: Float[Array, " points"]
    ) -> tuple[Float[Array, " points"], Float[Array, " points"]]:
        """Angle at the source per length along the pad; length of the way to the membrane."""
        step, toward = face[1] - face[0], face[0] - source

        def met(entry: Float[Array, ""]) -> Float[Array, ""]:
            return self.coordinate(face, source, entry[None])[0]

        rise = jax.vmap(partial(_slope, met))(entries) * (self.membrane[1] - self.membrane[0])
        arrow = Vector(toward.x + entries * step.x, toward.y + entries * step.y)
        turn, _ = safe_divide(jnp.abs(step.cross(toward)) / arrow.squared(), jnp.abs(rise))
        ray = self._inside(source, entries)
        ways = self._depths(ray) * row_of(self.index, ray.down) / _root(self._below(ray))
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

    def _below(self, ray: Inside) -> Float[Array, "*points layers"]:
        """Square of index times cosine to the pad's normal in every layer.

        It is negative where no ray goes on down, the more so the higher it enters.
        """
        down = ray.down * jnp.abs(ray.down)
        return down[..., None] + row_of(self.index**2 - self.index[self.layer] ** 2, down)

    def _depths(self, ray: Inside) -> Float[Array, "*points layers"]:
        """How thick a ray finds each layer: less of its own, nothing of those before it."""
        layers = jnp.arange(self.thickness.size)
        own = ray.entry.y[..., None] - self.lower.y
        below = row_of(jnp.where(layers > self.layer, self.thickness, 0.0), ray.down)
        return jnp.where(row_of(layers == self.layer, ray.down), own, below)

    def _short(self, entry: Float[Array, ""], sought: Sought, source: Vector) -> Float[Array, ""]:
        """By how much a ray falls short of what is sought; it falls with the entry."""
        ray = self._inside(source, entry)
        depths, layers = self._depths(ray), jnp.arange(self.thickness.size)
        # Times how steeply it goes down, so that it is finite for rays that go up or along.
        ratio = jnp.maximum(ray.down, 0.0) / _root(self._below(ray))
        ratio = jnp.where(layers == self.layer, 1.0, ratio)
        passed = jnp.sum(jnp.where(layers <= sought.level, depths * ratio, 0.0))
        ahead = -self.outward * (sought.place - ray.entry.x)
        of_place = ahead * ray.down - ray.along * passed
        bright = sought.brightness * self._excess(entry, source)
        return jnp.where(sought.brightness == 0, of_place, bright)

    def _crossing(
        self, sought: Sought, low: Float[Array, ""], high: Float[Array, ""], source: Vector
    ) -> Float[Array, ""]:
        """The entry between two at which nothing is short; `BELOW` or `BEYOND` if there is none."""
        still, wanted, eye = jax.lax.stop_gradient((self, sought, source))
        first, last = jax.lax.stop_gradient((low, high))

        def short(entry: Float[Array, ""]) -> Float[Array, ""]:
            return still._short(entry, wanted, eye)

        def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            middle = (ends[0] + ends[1]) / 2
            ahead = short(middle) > 0
            return jnp.where(ahead, middle, ends[0]), jnp.where(ahead, ends[1], middle)

        below, above = jax.lax.fori_loop(0, HALVINGS, halve, (first, last))
        root = (below + above) / 2
        step, _ = safe_divide(self._short(root, sought, source), _slope(short, root))
        # Where a single layer lets no ray down any more, the light ends in a jump and no root.
        step = jnp.where(jnp.abs(step) <= 4 * (last - first) * 2.0**-HALVINGS, step, 0.0)
        return jnp.where(short(first) <= 0, BELOW, jnp.where(short(last) > 0, BEYOND, root - step))

    def _brightest(self, source: Vector) -> Float[Array, ""]:
        """Entry of the ray that brings the most light; without derivatives."""
        still, eye = jax.lax.stop_gradient((self, source))

        def narrow(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = ends
            inner = low + (high - low) / 3, high - (high - low) / 3
            bright = still._excess(jnp.stack(inner), eye)
            rises = bright[0] < bright[1]
            return jnp.where(rises, inner[0], low), jnp.where(rises, high, inner[1])

        zero = jnp.zeros_like(self.transmission)
        low, high = jax.lax.fori_loop(0, HALVINGS, narrow, (zero, zero + 1))
        return (low + high) / 2

    def _excess(self, entry: Float[Array, "*points"], source: Vector) -> Float[Array, "*points"]:
        """Part of unpolarised light that comes to the membrane, above the least."""
        ray, own = self._inside(source, entry), self.index[self.layer]
        below, squares = jnp.arange(self.thickness.size) >= self.layer, self._below(ray)
        behind = row_of(below, entry)
        # Of a ray that goes up or is totally reflected, how far it is from passing.
        lacking = jnp.sum(jnp.where(behind, jnp.maximum(SMALL - squares, 0.0), 0.0), axis=-1)
        cosines = _root(jnp.where(behind, squares, squares[..., self.layer, None]))
        index = jnp.where(below, self.index, own)
        face = fresnel(jnp.stack(ray.normal, axis=-1), jnp.stack([jnp.ones_like(own), own]))
        inner = fresnel(cosines, index)
        part = (face[0] * inner[0] + face[1] * inner[1]) / 2
        return jnp.where(lacking > 0, -lacking, part) - self.transmission


def _root(square: Float[Array, "..."]) -> Float[Array, "..."]:
    return jnp.sqrt(jnp.where(square > SMALL, square, SMALL))


def _slope(function: Callable[[Array], Array], at: Float[Array, ""]) -> Float[Array, ""]:
    return jax.jvp(function, (at,), (jnp.ones_like(at),))[1]
