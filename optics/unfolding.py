"""Views unfolded: the camera mirrored along a path, and everything that may stand in its way.

A ray from the camera over mirrors to a pad is a straight line from the camera's image in these
mirrors, one after the other (the method of images; E. Hecht, *Optics*, 5th ed., §5.4.1). Whatever
stands between two mirrors is mirrored with them, so that all of a view happens on straight lines
from one point, the virtual camera. Leg 0 of a path runs from the camera to its first mirror, leg i
on from its i-th.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_divide
from designopt.vectors import Vector, chosen
from optics.labels import (
    CUT_AFTER,
    CUT_BEFORE,
    FIRST_END,
    SECOND_END,
    label_of,
)
from optics.scene import Layout, Placed

ROUNDING_UNITS = 8
"""What is nearer to a line than so many units of rounding of its distance lies on the line."""


class Fold(eqx.Module):
    """A motion of the plane, with or without mirroring: x → shift + turn · x or turn · x*.

    Vectors are complex numbers here, and x* is the conjugate.

    Attributes:
        shift: where the origin goes.
        turn: a unit vector.
        sign: −1 if it mirrors, else 1; it has no derivative.
    """

    shift: Vector
    turn: Vector
    sign: Float[Array, "*batch"]

    def place(self, place: Vector) -> Vector:
        """Where a place goes."""
        return self.shift + self.arrow(place)

    def arrow(self, arrow: Vector) -> Vector:
        """Where an arrow points."""
        return Vector(arrow.x, self.sign * arrow.y).turned(self.turn)

    def mirrored(self, start: Vector, along: Vector) -> Fold:
        """This motion, and then mirrored in the line through ``start`` along a unit vector."""
        double = along.turned(along)
        shift = start + (self.shift - start).conjugate().turned(double)
        return Fold(shift, self.turn.conjugate().turned(double), -self.sign)


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
        reflects: which of them there are: the path may be shorter than others beside it.
        turned_away: of each mirror, whether the camera or its image is not in front of it.
        blockers: what may stand in the way, shape (legs, surfaces).
        last: a place on the last mirror, and the unit vector along it, if there is one.
    """

    source: Vector
    axis: Vector
    mirrors: Edges
    reflects: Bool[Array, " reflections"]
    turned_away: Bool[Array, " reflections"]
    blockers: Edges
    last: tuple[Vector, Vector]

    def in_the_way(self, pad: Int[Array, ""]) -> Bool[Array, "legs surfaces"]:
        """Which blockers can hide a pad: not itself, at the end of the last leg."""
        legs, count = self.blockers.active.shape
        last = jnp.arange(legs) == jnp.sum(self.reflects)
        return ~(last[:, None] & (jnp.arange(count) == pad)[None]) & self.blockers.active


def paths_of(layout: Layout, bounces: int) -> list[tuple[int, ...]]:
    """Mirrors along every path with 0, 1, … ``bounces`` reflections, the shorter paths first.

    A straight mirror never follows itself; a curved one may.
    """
    mirrors = range(len(layout.mirrors))
    return [
        word
        for length in range(bounces + 1)
        for word in itertools.product(mirrors, repeat=length)
        if all(a != b or a in layout.curved for a, b in itertools.pairwise(word))
    ]


def padded(words: Sequence[tuple[int, ...]]) -> Int[np.ndarray, "paths reflections"]:
    """Paths as rows of one table, filled up with −1."""
    longest = max(map(len, words))
    return np.array([[*word, *[-1] * (longest - len(word))] for word in words], int).reshape(
        len(words), longest
    )


def unit(arrow: Vector) -> Vector:
    """The unit vector along a vector; 0 for one too short or too long to be squared."""
    length = arrow.length()
    inverse, _ = safe_divide(jnp.ones_like(length), length)
    return arrow.scaled(inverse)


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
    there: Bool[Array, ""] | bool = True,
) -> Edges:
    """The parts of segments on one side (+1 left, −1 right) of a line; ``labels`` name new ends.

    All of them if the line is not ``there``.
    """
    first = jnp.where(there, side * height(edges.starts, start, along), 1.0)
    last = jnp.where(there, side * height(edges.ends, start, along), 1.0)
    where, _ = safe_divide(first, first - last)
    meeting = edges.starts + (edges.ends - edges.starts).scaled(where)
    before, after = first < 0, last < 0
    return Edges(
        chosen(before, meeting, edges.starts),
        chosen(after, meeting, edges.ends),
        jnp.where(before, labels, edges.start_labels),
        jnp.where(after, labels, edges.end_labels),
        edges.active & ((first > 0) | (last > 0)),
    )


def folds_of(placed: Placed, word: Int[Array, " reflections"]) -> list[Fold]:
    """Of every leg of a path, the motion that unfolds it; that of the last leg moves nothing.

    A path that is shorter than its word, filled up with −1, has more last legs than one.
    """
    mirrors = [placed.segment(index) for index in word]
    zero, one = jnp.zeros_like(placed.size), jnp.ones_like(placed.size)
    folds = []
    for leg in range(len(mirrors) + 1):
        fold = Fold(Vector(zero, zero), Vector(one, zero), one)
        for index, (start, end) in list(zip(word, mirrors, strict=True))[leg:]:
            mirrored = fold.mirrored(start, unit(end - start))
            fold = jax.tree.map(partial(jnp.where, index >= 0), mirrored, fold)
        folds.append(fold)
    return folds


def unfold(layout: Layout, placed: Placed, word: Int[Array, " reflections"]) -> Unfolded:
    """One path, unfolded.

    Args:
        layout: the scene's layout.
        placed: the scene in a pose.
        word: indices of the mirrors along the path, filled up with −1; traced, so paths can be
            batched.
    """
    starts, ends = placed.starts, placed.ends
    lines = unit(ends - starts)
    count, surfaces = len(word), starts.x.shape[0]
    sides = jnp.asarray(layout.sides, starts.x.dtype)
    mirrors = [jax.tree.map(lambda leaf, i=i: leaf[i], (starts, ends, lines, sides)) for i in word]
    reflects = [index >= 0 for index in word]
    folds = folds_of(placed, word)

    # The camera's image in front of each mirror, in the space of the leg that comes to it.
    source, sources, facing, turned_away = placed.camera, [], [], []
    for there, (start, _, along, side) in zip(reflects, mirrors, strict=True):
        sources.append(source)
        above = height(source, start, along)
        facing.append(jnp.where(above < 0, -1.0, 1.0).astype(above.dtype))
        turned_away.append(there & ((above == 0) | (side * above < 0)))
        image = source - along.perpendicular().scaled(2 * along.cross(source - start))
        source = chosen(there, image, source)
    sources.append(source)

    index = jnp.arange(surfaces)
    blockers = []
    for leg in range(count + 1):
        # One through the source hides nothing, one with one blocking side nothing from the other.
        above = height(sources[leg], starts, lines)
        blocks = (above != 0) & (~jnp.asarray(layout.one_way) | (sides * above > 0))
        if leg > 0:
            blocks &= reflects[leg - 1]
        edges = Edges(
            starts, ends, label_of(leg, index, FIRST_END), label_of(leg, index, SECOND_END), blocks
        )
        for i, kind in ((leg - 1, CUT_BEFORE), (leg, CUT_AFTER)):
            if 0 <= i < count:
                start, _, along, _ = mirrors[i]
                labels = label_of(leg, index, kind)
                edges = cut(edges, start, along, facing[i], labels, reflects[i])
                edges = eqx.tree_at(lambda e: e.active, edges, edges.active & (index != word[i]))
        blockers.append(edges.folded(folds[leg]))
    apertures = []
    for i, (start, end, _, _) in enumerate(mirrors):
        first, second = label_of(i, word[i], FIRST_END), label_of(i, word[i], SECOND_END)
        edges = Edges(start, end, first, second, reflects[i])
        # The mirror before cuts it on the leg that comes to it, the next one on the leg after.
        for other, leg, kind in ((i - 1, i, CUT_BEFORE), (i + 1, i + 1, CUT_AFTER)):
            if 0 <= other < count:
                line, _, along, _ = mirrors[other]
                new = label_of(leg, word[i], kind)
                edges = cut(edges, line, along, facing[other], new, reflects[other])
        apertures.append(edges.folded(folds[i + 1]))
    last = (placed.camera, placed.axis)
    for there, (start, _, along, _) in zip(reflects, mirrors, strict=True):
        last = chosen(there, start, last[0]), chosen(there, along, last[1])
    blocking = _stacked(blockers)
    none = jnp.zeros(0, bool)
    return Unfolded(
        sources[-1],
        folds[0].arrow(placed.axis),
        _stacked(apertures) if apertures else jax.tree.map(lambda leaf: leaf[0, :0], blocking),
        jnp.stack(reflects) if reflects else none,
        jnp.stack(turned_away) if turned_away else none,
        blocking,
        last,
    )


def _stacked(parts: list[Edges]) -> Edges:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts)
