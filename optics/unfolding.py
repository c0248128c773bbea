"""Views unfolded: the camera mirrored along a path, and everything that may stand in its way.

A ray from the camera over mirrors to a pad is a straight line from the camera's image in these
mirrors, one after the other (the method of images; E. Hecht, *Optics*, 5th ed., §5.4.1). Whatever
stands between two mirrors is mirrored with them, so that all of a view happens on straight lines
from one point, the virtual camera. Leg 0 of a path runs from the camera to its first mirror, leg i
on from its i-th.
"""

from __future__ import annotations

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_divide
from designopt.vectors import Vector
from optics.scene import Layout, Placed

ROUNDING_UNITS = 8
"""What is nearer to a line than so many units of rounding of its distance lies on the line."""

FIRST_END, SECOND_END, CROSSING, CUT_BEFORE, CUT_AFTER, HORIZON = range(6)
"""What of a surface can bound a view: one of its ends, the place where it meets the pad, the place
where it meets the line of the mirror before or after it on the path, or that where a curved one
turns away from the ray."""

KINDS = 8
"""A label is KINDS · (leg · surfaces + surface) plus one of the above."""


class Fold(eqx.Module):
    """A motion of the plane, with or without mirroring: x → shift + turn · x or turn · x*.

    Vectors are complex numbers here, and x* is the conjugate.
    """

    shift: Vector
    turn: Vector
    flips: bool = eqx.field(static=True)

    def place(self, place: Vector) -> Vector:
        """Where a place goes."""
        return self.shift + self.arrow(place)

    def arrow(self, arrow: Vector) -> Vector:
        """Where an arrow points."""
        return (arrow.conjugate() if self.flips else arrow).turned(self.turn)

    def mirrored(self, start: Vector, along: Vector) -> Fold:
        """This motion, and then mirrored in the line through ``start`` along a unit vector."""
        double = along.turned(along)
        shift = start + (self.shift - start).conjugate().turned(double)
        return Fold(shift, self.turn.conjugate().turned(double), not self.flips)


class Edges(eqx.Module):
    """Segments, and what bounds them.

    Attributes:
        starts: first ends.
        ends: second ends.
        start_labels: what the first ends are.
        end_labels: what the second ends are.
        active: whether anything is left of them.
    """

    starts: Vector
    ends: Vector
    start_labels: Int[Array, "*batch"]
    end_labels: Int[Array, "*batch"]
    active: Bool[Array, "*batch"]

    def folded(self, fold: Fold) -> Edges:
        """The segments moved."""
        return eqx.tree_at(
            lambda edges: (edges.starts, edges.ends),
            self,
            (fold.place(self.starts), fold.place(self.ends)),
        )


class Unfolded(eqx.Module):
    """One path from the camera over mirrors, unfolded behind the last of them.

    Attributes:
        source: the virtual camera.
        axis: its optical axis, a unit vector.
        mirrors: what can be reached of each mirror, in the order of the path.
        turned_away: of each mirror, whether the camera or its image is not in front of it.
        blockers: what may stand in the way, shape (legs, surfaces).
        last: a place on the last mirror, and the unit vector along it; ``None`` without one.
    """

    source: Vector
    axis: Vector
    mirrors: Edges
    turned_away: Bool[Array, " reflections"]
    blockers: Edges
    last: tuple[Vector, Vector] | None

    def in_the_way(self, pad: Int[Array, ""]) -> Bool[Array, "legs surfaces"]:
        """Which blockers can hide a pad: not itself, at the end of the last leg."""
        legs, count = self.blockers.active.shape
        last = jnp.arange(legs) == legs - 1
        return ~(last[:, None] & (jnp.arange(count) == pad)[None]) & self.blockers.active


def paths_of(layout: Layout, bounces: int) -> list[np.ndarray]:
    """Mirrors along every path with 0, 1, … ``bounces`` reflections, shape (paths, reflections).

    A straight mirror never follows itself; a curved one may.
    """
    count = len(layout.mirrors)
    found = [np.zeros((1, 0), int)]
    for length in range(1, bounces + 1):
        words = [
            word
            for word in itertools.product(range(count), repeat=length)
            if all(a != b or a in layout.curved for a, b in itertools.pairwise(word))
        ]
        if words:
            found.append(np.array(words, int))
    return found


def unit(arrow: Vector) -> Vector:
    """The unit vector along a vector; 0 for one too short to be squared."""
    scale = jax.lax.stop_gradient(jnp.maximum(jnp.abs(arrow.x), jnp.abs(arrow.y)))
    factor, _ = safe_divide(jnp.ones_like(scale), scale)
    scaled = arrow.scaled(factor)
    inverse, _ = safe_divide(jnp.ones_like(scale), scaled.length())
    return scaled.scaled(inverse)


def height(place: Vector, start: Vector, along: Vector) -> Float[Array, "*batch"]:
    """Distance of a place left of the line through ``start`` along a unit vector.

    It is exactly 0 if it is no more than rounding.
    """
    arrow = place - start
    distance = along.cross(arrow)
    rounding = ROUNDING_UNITS * jnp.finfo(distance.dtype).eps
    on = jnp.abs(distance) <= rounding * (jnp.abs(arrow.x) + jnp.abs(arrow.y))
    return jnp.where(on, 0.0, distance)


def cut(
    edges: Edges,
    start: Vector,
    along: Vector,
    side: Float[Array, ""],
    labels: Int[Array, "*batch"],
) -> Edges:
    """The parts of segments on one side (+1 left, −1 right) of a line; ``labels`` name new ends."""
    first = side * height(edges.starts, start, along)
    last = side * height(edges.ends, start, along)
    where, _ = safe_divide(first, first - last)
    meeting = edges.starts + (edges.ends - edges.starts).scaled(where)
    before, after = first < 0, last < 0
    return Edges(
        _choose(before, meeting, edges.starts),
        _choose(after, meeting, edges.ends),
        jnp.where(before, labels, edges.start_labels),
        jnp.where(after, labels, edges.end_labels),
        edges.active & ((first > 0) | (last > 0)),
    )


def _choose(condition: Bool[Array, "*batch"], yes: Vector, no: Vector) -> Vector:
    return Vector(jnp.where(condition, yes.x, no.x), jnp.where(condition, yes.y, no.y))


def folds_of(placed: Placed, word: Int[Array, " reflections"]) -> list[Fold]:
    """Of every leg of a path, the motion that unfolds it; that of the last leg moves nothing."""
    zero, one = jnp.zeros_like(placed.size), jnp.ones_like(placed.size)
    folds = []
    for leg in range(len(word) + 1):
        fold = Fold(Vector(zero, zero), Vector(one, zero), False)
        for i in range(leg, len(word)):
            start, end = _item((placed.starts, placed.ends), word[i])
            fold = fold.mirrored(start, unit(end - start))
        folds.append(fold)
    return folds


def _item(tree: tuple[Vector, Vector], index: Int[Array, ""]) -> tuple[Vector, Vector]:
    return jax.tree.map(lambda leaf: leaf[index], tree)


def unfold(layout: Layout, placed: Placed, word: Int[Array, " reflections"]) -> Unfolded:
    """One path, unfolded.

    Args:
        layout: the scene's layout.
        placed: the scene in a pose.
        word: indices of the mirrors along the path; traced, so paths of one length can be batched.
    """
    starts, ends = placed.starts, placed.ends
    count, surfaces = len(word), starts.x.shape[0]
    sides = jnp.asarray(layout.sides, starts.x.dtype)
    mirrors = [_item((starts, ends), word[i]) for i in range(count)]
    along = [unit(end - start) for start, end in mirrors]
    folds = folds_of(placed, word)

    # The camera's image in front of each mirror, in the space of the leg that comes to it.
    source, sources, facing, turned_away = placed.camera, [], [], []
    for i in range(count):
        sources.append(source)
        above = height(source, mirrors[i][0], along[i])
        facing.append(jnp.where(above < 0, -1.0, 1.0).astype(above.dtype))
        turned_away.append((above == 0) | (sides[word[i]] * above < 0))
        source = source - along[i].perpendicular().scaled(
            2 * along[i].cross(source - mirrors[i][0])
        )
    sources.append(source)

    def named(leg: int, surface: Int[Array, "*n"], kind: int) -> Int[Array, "*n"]:
        return KINDS * (leg * surfaces + surface) + kind

    index = jnp.arange(surfaces)
    blockers = []
    for leg in range(count + 1):
        # One through the source hides nothing, one with one blocking side nothing from the other.
        above = height(sources[leg], starts, unit(ends - starts))
        blocks = (above != 0) & (~jnp.asarray(layout.one_way) | (sides * above > 0))
        edges = Edges(
            starts, ends, named(leg, index, FIRST_END), named(leg, index, SECOND_END), blocks
        )
        for i, kind in ((leg - 1, CUT_BEFORE), (leg, CUT_AFTER)):
            if 0 <= i < count:
                edges = cut(edges, mirrors[i][0], along[i], facing[i], named(leg, index, kind))
                edges = eqx.tree_at(lambda e: e.active, edges, edges.active & (index != word[i]))
        blockers.append(edges.folded(folds[leg]))
    apertures = []
    for i, (start, end) in enumerate(mirrors):
        first, second = named(i, word[i], FIRST_END), named(i, word[i], SECOND_END)
        edges = Edges(start, end, first, second, jnp.ones_like(start.x, bool))
        # The mirror before cuts it on the leg that comes to it, the next one on the leg after.
        for other, leg, kind in ((i - 1, i, CUT_BEFORE), (i + 1, i + 1, CUT_AFTER)):
            if 0 <= other < count:
                new = named(leg, word[i], kind)
                edges = cut(edges, mirrors[other][0], along[other], facing[other], new)
        apertures.append(edges.folded(folds[i + 1]))
    blocking = _stacked(blockers)
    return Unfolded(
        sources[-1],
        folds[0].arrow(placed.axis),
        _stacked(apertures) if apertures else jax.tree.map(lambda leaf: leaf[0, :0], blocking),
        jnp.asarray(turned_away, bool),
        blocking,
        (mirrors[-1][0], along[-1]) if count else None,
    )


def _stacked(parts: list[Edges]) -> Edges:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts)
