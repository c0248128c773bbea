"""Every end of a view is the place where a line meets the pad; here are these lines.

Which line bounds what is found without derivatives (`optics.visibility`). Computed anew from its
label, as here, the end carries its derivative and nothing else does: the end of a piece moves as
its line does, and it jumps from one line to another only where the view changes its topology.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_divide
from designopt.vectors import Vector, chosen, rotation, together
from optics.camera import Camera
from optics.labels import (
    CROSSING,
    CUT_AFTER,
    CUT_BEFORE,
    HIGH_GRAZING,
    LEFT_LIMIT,
    LOW_GRAZING,
    RIGHT_LIMIT,
    SECOND_END,
    SECOND_PAD_END,
    parts_of,
)
from optics.scene import Placed, Scene
from optics.unfolding import Fold, folds_of, padded, unit


class Pad(eqx.Module):
    """A pad in a pose.

    Attributes:
        index: its index among all surfaces.
        start: its first end.
        end: its second end.
        side: +1 if its left side senses, −1 if its right does, 0 if both do.
        grazing: least angle between it and a ray, rad.
    """

    index: Int[Array, "*pads"]
    start: Vector
    end: Vector
    side: Float[Array, "*pads"]
    grazing: Float[Array, "*pads"]

    @classmethod
    def all_of(cls, scene: Scene, placed: Placed) -> Pad:
        """All pads of a placed scene, along one axis."""
        index = len(scene.layout.mirrors) + np.arange(len(scene.layout.pads))
        start, end = placed.segment(index)
        sides = jnp.asarray(scene.layout.sides[index], start.x.dtype)
        return cls(jnp.asarray(index), start, end, sides, scene.grazing)

    def ends(self) -> Vector:
        """Both ends of one pad, along one axis."""
        return together(self.start, self.end)


class Route(eqx.Module):
    """A path over mirrors, unfolded behind the last of them; or several, along a first axis.

    Attributes:
        word: mirrors along the path, −1 after its end.
        source: the virtual camera.
        axis: its optical axis.
        folds: the motions that unfold its legs, but the last, which stays.
    """

    word: Int[Array, "*paths reflections"]
    source: Vector
    axis: Vector
    folds: list[Fold]

    def at(self, path: Int[Array, ""]) -> Route:
        """One of several paths."""
        return jax.tree.map(lambda leaf: leaf[path], self)

    def handedness(self) -> Float[Array, "*paths"]:
        """−1 after an odd number of reflections, else 1."""
        return self.folds[0].sign if self.folds else jnp.ones_like(self.source.x)

    def folded(self, leg: Int[Array, "*legs"] | int, place: Vector) -> Vector:
        """A place of a leg of this one path, unfolded behind the last mirror."""
        found = place
        for number, fold in enumerate(self.folds):
            found = chosen(jnp.asarray(leg == number), fold.place(place), found)
        return found


def routes_of(placed: Placed, words: list[tuple[int, ...]]) -> Route:
    """The paths over given mirrors, along one axis."""

    def route(word: Int[Array, " reflections"]) -> Route:
        folds = folds_of(placed, word)
        source, axis = folds[0].place(placed.camera), folds[0].arrow(placed.axis)
        return Route(word, source, axis, folds[:-1])

    return jax.vmap(route)(jnp.asarray(padded(words)))


class Line(eqx.Module):
    """A line or several, by a point and a direction of any length.

    Attributes:
        point: the virtual camera, or a place on a surface that meets the pad.
        direction: along the line.
        crosses: whether it lies along such a surface.
    """

    point: Vector
    direction: Vector
    crosses: Bool[Array, "*lines"]


def bounding_line(
    camera: Camera, placed: Placed, route: Route, pad: Pad, label: Int[Array, "*labels"]
) -> Line:
    """The lines that labels stand for: of sight along an edge, or along a surface.

    All of it unfolded behind the last mirror of the path.
    """
    source, axis = route.source, route.axis
    leg, surface, kind = parts_of(jnp.maximum(label, 0))
    start, end = placed.segment(surface)
    edge = chosen(kind == SECOND_END, end, start)
    longest = route.word.shape[0]
    if longest:
        # Where a surface meets the line of the mirror before or after the leg.
        neighbour = jnp.clip(jnp.where(kind == CUT_BEFORE, leg - 1, leg), 0, longest - 1)
        cut = _meeting(start, end, *placed.segment(route.word[neighbour]))
        edge = chosen((kind == CUT_BEFORE) | (kind == CUT_AFTER), cut, edge)
    seen = route.folded(leg, edge)
    along = route.folded(leg, end) - route.folded(leg, start)

    # The labels below 0 come in pairs, of which one has the sign 1.
    second = (label == SECOND_PAD_END) | (label == LEFT_LIMIT) | (label == HIGH_GRAZING)
    sign = jnp.where(second, 1.0, -1.0).astype(source.x.dtype)
    half = rotation(camera.field_of_view / 2)
    limit = axis.scaled(half.x) + axis.perpendicular().scaled(sign * half.y)
    along_pad = unit(pad.end - pad.start)
    above = along_pad.cross(source - pad.start)
    drop = along_pad.perpendicular().scaled(-above * jnp.sin(pad.grazing))
    flattest = drop + along_pad.scaled(sign * jnp.abs(above) * jnp.cos(pad.grazing))
    direction = chosen(second, pad.end, pad.start)

    crossing = kind == CROSSING
    is_limit = (label == LEFT_LIMIT) | (label == RIGHT_LIMIT)
    is_grazing = (label == LOW_GRAZING) | (label == HIGH_GRAZING)
    direction = chosen(label >= 0, seen, direction) - source
    direction = chosen(is_limit, limit, chosen(is_grazing, flattest, direction))
    direction = chosen(crossing, along, direction)
    return Line(chosen(crossing, seen, source), direction, crossing)


def where_met(line: Line, pad: Pad) -> Float[Array, "*lines"]:
    """Pad coordinates at which lines meet a pad; 0 where they do not."""
    first = line.direction.cross(pad.start - line.point)
    last = line.direction.cross(pad.end - line.point)
    return safe_divide(first, first - last)[0]


def _meeting(start: Vector, end: Vector, first: Vector, last: Vector) -> Vector:
    """Where the line through ``start`` and ``end`` meets that through two other places."""
    along, step = last - first, end - start
    part, _ = safe_divide(along.cross(first - start), along.cross(step))
    return start + step.scaled(part)
