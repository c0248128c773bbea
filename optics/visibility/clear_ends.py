"""Light through a clear end face of a layer, and down through the layers below to the membrane.

The end face leans against the layers, so the ray to a place on the membrane has no closed form. But
a pencil of rays from a point stays divergent through any flat surfaces: what lies farther along is
reached by rays that enter higher up. So every end of a view is one monotone equation for the place
of entry, bisected and then polished by one Newton step, which also carries its derivatives.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

from designopt.numerics import TO_ROUNDING, bisect, refine_root, safe_divide, safe_sqrt
from designopt.vectors import Vector
from optics.scene.layers import BodyFace, along_and_normal
from optics.scene.scene import Placed, Scene
from optics.visibility.refraction import Cover, Points, Scale, fresnel, profile_of, row_of
from optics.visibility.unfolding import unit

HALVINGS = 32
"""Bisections before the Newton step, which squares what they leave."""

ROOTED = 1e-9
"""Transmission so near to the least is a root of the difference."""

SMALL = 1e-12
"""Of the square of a cosine: a flatter ray goes on along its layer, as one that is reflected."""

BELOW, BEYOND = FREE = -1.0, 2.0
"""Entries of what no ray through the face meets: all pass beyond it, or none.

Together they are a window that limits nothing.
"""


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


class FaceAxes(NamedTuple):
    """Axes of a face in those of its pad.

    Attributes:
        up: unit vector along the face, away from the membrane.
        inward: its normal into the layer.
    """

    up: Vector
    inward: Vector

    @classmethod
    def of(cls, step: Vector, outward: Float[Array, "*ends"]) -> FaceAxes:
        """Those of a face along a vector, at the end of the pad that is −1 or 1."""
        up = unit(step)
        return cls(up, up.perpendicular().scaled(outward))

    def refracted(
        self,
        index: Float[Array, ""],
        cosine: Float[Array, "*points"],
        sine: Float[Array, "*points"],
    ) -> tuple[Float[Array, "*points"], Vector]:
        """Index times cosine behind the face, and index times direction there.

        Args:
            index: of refraction of the layer.
            cosine: of the angle in air from the inner normal.
            sine: of the same, positive upwards.
        """
        # Snell: n sin θ, the part along the face, stays (Born and Wolf, §1.5.1).
        through = safe_sqrt(index**2 - 1 + cosine**2)
        return through, self.up.scaled(sine) + self.inward.scaled(through)


class Sought(eqx.Module):
    """A ray that is sought by the place that it meets.

    Attributes:
        level: the layer whose lower side it passes.
        place: where, along the pad.
    """

    level: Int[Array, "*rays"]
    place: Float[Array, "*rays"]


class EndCover(Cover):
    """Layers behind a clear end face, whose ends are counted from the membrane's side on.

    Places are counted from the membrane's first end.

    Attributes:
        origin: the membrane's first end.
        along: unit vector along the pad.
        normal: unit vector towards the sensing side.
        lower: the face's end at the membrane's side, along the pad and above it.
        upper: its end at the camera's side.
        outward: −1 at the pad's first end, 1 at its second.
        layer: index of its layer.
        membrane: along the pad, both ends of the membrane.
        bright: the `bright_angles` of the face.
    """

    origin: Vector
    along: Vector
    normal: Vector
    lower: Vector
    upper: Vector
    outward: Float[Array, "*faces"]
    layer: Int[Array, "*faces"]
    membrane: Float[Array, "*faces 2"]
    bright: Float[Array, "*faces 2"]

    @classmethod
    def of(cls, scene: Scene, placed: Placed, faces: list[BodyFace]) -> EndCover:
        """Those of clear end faces."""
        layout, size, layers = scene.layout, placed.size, scene.own_layers
        assert layers is not None
        pad, layer, end = np.array([(face.pad, face.layer, face.end) for face in faces]).T
        profile = profile_of(scene, layers)
        # The membranes' ends follow from the outermost surfaces.
        outermost = len(layout.mirrors) + pad
        ends, side = placed.corners[outermost], jnp.asarray(layout.sides[outermost], size.dtype)
        along, normal, _ = along_and_normal(ends, side)
        origin = ends[..., 0] - along.scaled(profile.upper[pad, 0, 0] / size)
        origin = origin - normal.scaled(profile.levels[pad, 0] / size)
        places = backwards(end, profile.windows()[pad] / size)
        lower, upper = profile.lower[pad, layer, end], profile.upper[pad, layer, end]
        lower = Vector(lower / size, profile.levels[pad, layer + 1] / size)
        upper = Vector(upper / size, profile.levels[pad, layer] / size)
        outward, of_layer = jnp.asarray(2.0 * end - 1, along.x.dtype), jnp.asarray(layer)
        index, least = layers.green[pad], layers.transmission[pad]
        return cls(
            thickness=layers.thickness[pad] / size,
            index=index,
            places=places,
            origin=origin,
            along=along,
            normal=normal,
            lower=lower,
            upper=upper,
            outward=outward,
            layer=of_layer,
            membrane=jnp.stack([jnp.zeros_like(origin.x), profile.membrane[pad, 1] / size], -1),
            bright=jax.vmap(bright_angles)(upper - lower, outward, of_layer, index, least),
        )

    @property
    def rows(self) -> int:
        """As `Cover.rows`: the last one is that of the least transmission."""
        return super().rows + 1

    def windows(self, face: Vector, source: Vector) -> Float[Array, "windows 2"]:
        """As `Cover.windows`, of the layers below.

        And, in a last row, of the rays that bring just the least transmission.
        """
        levels = jnp.arange(self.thickness.size)
        sought = Sought(jnp.repeat(levels, 2), self.places.reshape(-1))
        met = jax.vmap(self._crossing, (0, None))(sought, source).reshape(-1, 2)
        free = jnp.array(FREE, met.dtype)
        met = jnp.where((levels >= self.layer)[:, None], met, free)
        # Rays of one direction meet the line of the face, unless they run along it.
        step = self.upper - self.lower
        axes = FaceAxes.of(step, self.outward)
        ray = axes.inward.scaled(jnp.cos(self.bright)) + axes.up.scaled(jnp.sin(self.bright))
        bright, _ = safe_divide((self._own(source) - self.lower).cross(ray), step.cross(ray))
        along = jnp.cos(self.bright) ** 2 < SMALL
        return jnp.concatenate([met, jnp.where(along, free, bright)[None]])

    def coordinate(self, face: Vector, source: Vector, entries: Points) -> Points:
        """Pad coordinates that rays reach, from their entries."""
        ray = self._inside(source, entries)
        cosines = _root(self._below(ray))
        steps = self._depths(ray) * ray.along[..., None] / cosines
        met = ray.entry.x - self.outward * jnp.sum(steps, axis=-1)
        first, last = self.membrane[0], self.membrane[1]
        return safe_divide(met - first, jnp.broadcast_to(last - first, met.shape))[0]

    def entries(self, face: Vector, source: Vector, coordinates: Points) -> Points:
        """Entries of the rays that reach given pad coordinates."""
        places = self.membrane[0] + coordinates * (self.membrane[1] - self.membrane[0])
        sought = Sought(jnp.full(places.shape, self.thickness.size - 1), places)
        return jax.vmap(self._crossing, (0, None))(sought, source)

    def scale(self, face: Vector, source: Vector, entries: Points) -> Scale:
        """As `Cover.scale`."""
        ray = self._inside(source, entries)
        depths, cosines = self._depths(ray), _root(self._below(ray))
        index = row_of(self.index, ray.down)
        # Of rays from one place n cos θ dθ stays at every surface, θ counted from its normal: at
        # the face, and at the levels. So in a layer the ray turns by leaning / (n cos θ) of what it
        # turns at the source, and what it goes along the levels is its length over leaning.
        leaning, _ = safe_divide(ray.normal[0] * ray.down, ray.normal[1])
        apparent = ray.length + leaning**2 * jnp.sum(depths * index**2 / cosines**3, axis=-1)
        turn, _ = safe_divide(jnp.abs(leaning), apparent)
        return Scale(turn, ray.length + jnp.sum(depths * index / cosines, axis=-1), apparent)

    def _own(self, place: Vector) -> Vector:
        """A place in the pad's own axes."""
        toward = place - self.origin
        return Vector(self.along.dot(toward), self.normal.dot(toward))

    def _inside(self, source: Vector, entry: Float[Array, "*points"]) -> Inside:
        """The ray that enters at a place of the face."""
        step = self.upper - self.lower
        axes = FaceAxes.of(step, self.outward)
        at = Vector(self.lower.x + entry * step.x, self.lower.y + entry * step.y)
        arrow = at - self._own(source)
        way = arrow.length()
        cosine, _ = safe_divide(arrow.dot(axes.inward), way)
        sine, _ = safe_divide(arrow.dot(axes.up), way)
        through, ray = axes.refracted(self.index[self.layer], cosine, sine)
        return Inside(at, -self.outward * ray.x, -ray.y, (cosine, through), way)

    def _below(self, ray: Inside) -> Float[Array, "*points layers"]:
        """Square of index times cosine to the pad's normal in every layer."""
        return _squares(self.index, self.layer, ray.down)

    def _depths(self, ray: Inside) -> Float[Array, "*points layers"]:
        """How thick a ray finds each layer: less of its own, nothing of those before it."""
        layers = jnp.arange(self.thickness.size)
        own = ray.entry.y[..., None] - self.lower.y
        below = row_of(jnp.where(layers > self.layer, self.thickness, 0.0), ray.down)
        return jnp.where(row_of(layers == self.layer, ray.down), own, below)

    def _short(self, entry: Float[Array, ""], sought: Sought, source: Vector) -> Float[Array, ""]:
        """By how much a ray falls short of a place, times how steeply it goes down.

        So it is finite for rays that go up or along. It falls with the entry.
        """
        ray = self._inside(source, entry)
        depths, layers = self._depths(ray), jnp.arange(self.thickness.size)
        ratio = jnp.maximum(ray.down, 0.0) / _root(self._below(ray))
        ratio = jnp.where(layers == self.layer, 1.0, ratio)
        passed = jnp.sum(jnp.where(layers <= sought.level, depths * ratio, 0.0))
        ahead = -self.outward * (sought.place - ray.entry.x)
        return ahead * ray.down - ray.along * passed

    def _crossing(self, sought: Sought, source: Vector) -> Float[Array, ""]:
        """The entry at which nothing is short; `BELOW` or `BEYOND` if there is none."""
        given = self, sought, source
        still, zero = jax.lax.stop_gradient(given), jnp.zeros_like(sought.place)
        one = zero + 1

        def short(given: tuple[EndCover, Sought, Vector], entry: Array) -> Float[Array, ""]:
            return given[0]._short(entry, *given[1:])

        low, high = bisect(lambda entry: short(still, entry) > 0, zero, one, HALVINGS)
        middle = (low + high) / 2
        root = refine_root(short, given, middle)
        # Where a single layer lets no ray down any more, the light ends in a jump and no root.
        root = jnp.where(jnp.abs(root - middle) <= 4 * 2.0**-HALVINGS, root, middle)
        at_ends = jax.vmap(partial(short, still))(jnp.stack([zero, one]))
        before, after = at_ends[0] <= 0, at_ends[1] > 0
        return jnp.where(before, BELOW, jnp.where(after, BEYOND, root))


def backwards(
    end: np.ndarray, pairs: Shaped[Array | np.ndarray, "faces rows 2"]
) -> Shaped[Array, "faces rows 2"]:
    """Pairs of both ends of pads in the order in which rays through end faces come to them.

    Through the second end face rays go backwards.
    """
    return jnp.where((end == 1)[:, None, None], pairs[..., ::-1], pairs)


def bright_angles(
    step: Vector,
    outward: Float[Array, ""],
    layer: Int[Array, ""],
    index: Float[Array, " layers"],
    least: Float[Array, ""],
) -> Float[Array, "2"]:
    """Directions of rays in air that bring just a given part of the light to the membrane.

    Args:
        step: along the end face, away from the membrane, in the pad's own axes.
        outward: −1 at the pad's first end, 1 at its second.
        layer: index of its layer.
        index: of refraction of all layers.
        least: part of unpolarised light.

    Returns:
        Angles (rad) from the normal into the layer, positive away from the membrane: rays between
        them bring more. Both are one if none does.
    """
    given = FaceAxes.of(step, outward), layer, index, least
    still, right = jax.lax.stop_gradient(given), jnp.full_like(least, jnp.pi / 2)

    def excess(given: tuple[FaceAxes, Array, Array, Array], angle: Array) -> Float[Array, ""]:
        return _transmission(*given[:3], angle) - given[3]

    excesses = jax.vmap(partial(excess, still))
    darkest = jnp.stack([-right, right])

    def narrow(_: Any, ends: Float[Array, "2"]) -> Float[Array, "2"]:
        third = (ends[1] - ends[0]) / 3
        inner = ends + jnp.stack([third, -third])
        first, second = excesses(inner)
        nearer = jnp.stack([inner[0], ends[1]]), jnp.stack([ends[0], inner[1]])
        return jnp.where(first < second, *nearer)

    # The light may end in a jump at the brightest ray: beyond it there is none.
    ends = jax.lax.fori_loop(0, TO_ROUNDING, narrow, darkest)
    best = ends[jnp.argmax(excesses(ends))]

    @jax.vmap
    def limit(dark: Float[Array, ""]) -> Float[Array, ""]:
        low, high = bisect(lambda angle: excess(still, angle) > 0, best, dark)
        middle = (low + high) / 2
        root = refine_root(excess, given, middle)
        # Total reflection ends the light in a jump, whose place moves otherwise.
        rooted = jnp.abs(excess(still, middle)) < ROOTED
        return middle + jnp.where(rooted, root - jax.lax.stop_gradient(root), 0.0)

    return jnp.where(excess(still, best) > 0, limit(darkest), best)


def _transmission(
    axes: FaceAxes, layer: Int[Array, ""], index: Float[Array, " layers"], angle: Float[Array, ""]
) -> Float[Array, ""]:
    """Part of unpolarised light that comes to the membrane, from the angle in air at the face."""
    own, cosine = index[layer], jnp.cos(angle)
    through, ray = axes.refracted(own, cosine, jnp.sin(angle))
    behind, squares = jnp.arange(index.size) >= layer, _squares(index, layer, -ray.y)
    # Of a ray that goes up or is totally reflected, how far it is from passing.
    lacking = jnp.sum(jnp.where(behind, jnp.maximum(SMALL - squares, 0.0), 0.0))
    cosines = _root(jnp.where(behind, squares, squares[layer]))
    face = fresnel(jnp.stack([cosine, through]), jnp.stack([jnp.ones_like(own), own]))
    inner = fresnel(cosines, jnp.where(behind, index, own))
    part = (face[0] * inner[0] + face[1] * inner[1]) / 2
    return jnp.where(lacking > 0, -lacking, part)


def _squares(
    index: Float[Array, " layers"], layer: Int[Array, ""], down: Float[Array, "*points"]
) -> Float[Array, "*points layers"]:
    """Square of index times cosine to the pad's normal in every layer, from that in one.

    It is negative where no ray goes on down, the more so the more it goes up.
    """
    signed = down * jnp.abs(down)
    return signed[..., None] + row_of(index**2 - index[layer] ** 2, down)


def _root(square: Float[Array, "..."]) -> Float[Array, "..."]:
    return jnp.sqrt(jnp.where(square > SMALL, square, SMALL))
