"""Views unfolded: the camera mirrored along a path, and everything that may stand in its way.

A ray from the camera over mirrors to a pad is a straight line from the camera's image in these
mirrors, one after the other (the method of images; E. Hecht, *Optics*, 5th ed., §5.4.1). Whatever
stands between two mirrors is mirrored with them, so that all of a view happens on straight lines
from one point, the virtual camera. Leg 0 of a path runs from the camera to its first mirror, leg i
on from its i-th.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from designopt.numerics import safe_divide
from designopt.vectors import Vector, stack, where
from optics.scene.scene import Layout, Placed, Solids
from optics.visibility.boundary_codes import CUT_AFTER, CUT_BEFORE, FIRST_END, SECOND_END, label_of
from optics.visibility.sliding import LAST, Rays, Slide

ROUNDING_UNITS = 8
"""What is nearer to a line than so many units of rounding of its distance lies on the line."""


ROOM = 1e-3
"""rad: the entrance pupil moves on so far beyond the field of view, for the slopes at its limit."""


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
        """This motion, and then mirrored in the line through ``start`` along a vector."""
        twice = _twice(along)
        shift = start + (self.shift - start).conjugate().turned(twice)
        return Fold(shift, self.turn.conjugate().turned(twice), -self.sign)


class Edges(eqx.Module):
    """Segments, and what bounds them.

    Attributes:
        ends: first and second ends, shape (..., 2).
        labels: what these are, shape (..., 2).
        active: whether they count, as something is left of them, shape (...).
    """

    ends: Vector
    labels: Int[Array, "*batch 2"]
    active: Bool[Array, "*batch"]

    def folded(self, fold: Fold) -> Edges:
        """The segments moved."""
        return Edges(fold.place(self.ends), self.labels, self.active)


class Unfolded(eqx.Module):
    """One path from the camera over mirrors, unfolded behind the last of them; or several.

    Several are along a first axis.

    Attributes:
        source: the virtual camera.
        axis: its optical axis, a unit vector.
        whole: first and second ends of its mirrors, in the order of the path.
        mirrors: what can be reached of each mirror; if any mirror has layers, of each on the way
            in, and then of each on the way out.
        reflects: which of them there are: the path may be shorter than others beside it.
        turned_away: of each mirror, whether the camera or its image is not in front of it.
        through: of each leg, at which mirrors it begins and ends; shape (legs, surfaces).
        blockers: all surfaces on every leg, shape (legs, surfaces); active is what can hide a pad,
            so those that a leg goes ``through`` are not. In both, as in ``sliding``, surfaces are
            in the order of the solids, some more than once.
        last: both ends of the last mirror, not folded, if there is one.
        slide: from where rays come; ``None`` if all come from the source.
        sliding: the rays past both ends of all blockers, likewise.
        solids: as `Layout.solids` has it.
    """

    source: Vector
    axis: Vector
    whole: Vector
    mirrors: Edges
    reflects: Bool[Array, "*paths reflections"]
    turned_away: Bool[Array, "*paths reflections"]
    through: Bool[Array, "*paths legs surfaces"]
    blockers: Edges
    last: Vector
    slide: Slide | None
    sliding: Rays | None
    solids: Solids = eqx.field(static=True)

    def at(self, path: Int[Array, "*batch"]) -> Unfolded:
        """Some of several paths, by indices from 0 on."""

        def some(leaf: Shaped[Array, "paths ..."]) -> Shaped[Array, "..."]:
            return leaf.at[path].get(mode="promise_in_bounds", wrap_negative_indices=False)

        return jax.tree.map(some, self)

    def past(self) -> Rays:
        """The rays past both ends of all blockers."""
        return self.sliding or Rays(self.blockers.ends - self.source, self.source)

    def to(self, places: Vector, leg: Int[Array, "..."] | int = LAST) -> Rays:
        """The rays to places on a leg, the last one by default."""
        if self.slide is None:
            return Rays(places - self.source, self.source)
        return self.slide.rays_to(places, leg=leg)

    def per_window(self, of_mirrors: Bool[Array, " reflections"]) -> Bool[Array, " windows"]:
        """Something of the path's mirrors beside ``mirrors``, of which layers make two of each."""
        return jnp.tile(of_mirrors, 2) if self.sheets else of_mirrors

    @property
    def sheets(self) -> bool:
        """Whether mirrors have layers, so that rays come from another place on every leg."""
        return self.slide is not None and self.slide.thickness is not None

    def eye(self, start: Vector, end: Vector) -> Vector:
        """Where the ray to the middle of a segment on the last leg comes from."""
        if self.slide is None:
            return self.source
        return self.slide.rays_to(start + (end - start).scaled(jnp.full_like(start.x, 0.5))).start

    def handedness(self) -> Float[Array, "*paths"]:
        """−1 after an odd number of reflections, else 1."""
        odd = jnp.sum(self.reflects, axis=-1) % 2 == 1
        return jnp.where(odd, -1.0, 1.0).astype(self.source.x.dtype)

    def in_the_way(self, own: Bool[Array, " surfaces"]) -> Bool[Array, "legs surfaces"]:
        """Which blockers can hide a pad: not its own surfaces, at the end of the last leg."""
        last = jnp.arange(len(self.blockers.active)) == jnp.sum(self.reflects)
        return ~(last[:, None] & own[None]) & self.blockers.active

    def merged(self, of_blockers: Any, merge: Callable[[Any], Any]) -> Any:
        """What belongs to all blockers, in a row, of those that bound one solid made one.

        Args:
            of_blockers: a tree of arrays of shape (legs, surfaces).
            merge: of rows of what belongs to those that bound one solid.
        """
        alone, together = len(self.solids.alone), self.solids.together
        single = jax.tree.map(lambda leaf: leaf[:, :alone].reshape(-1), of_blockers)
        if not together:
            return single
        shape = -1, len(together[0])
        rows = jax.tree.map(lambda leaf: leaf[:, alone:].reshape(shape), of_blockers)
        return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), single, merge(rows))


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


def _twice(along: Vector) -> Vector:
    """The unit vector at twice the angle of a vector."""
    inverse, _ = safe_divide(jnp.ones_like(along.x), along.squared())
    return along.turned(along).scaled(inverse)


def left_of(place: Vector, start: Vector, along: Vector) -> Float[Array, "*batch"]:
    """Distance of a place left of the line through ``start``, times the length of ``along``.

    It is exactly 0 if it is no more than rounding.
    """
    # Snapped to 0 within rounding: a mirror's own end, or a pad on a mirror's line, must lie on it,
    # or a sliver as wide as rounding would be seen and named.
    arrow = place - start
    product = along.cross(arrow)
    rounding = ROUNDING_UNITS * jnp.finfo(product.dtype).eps
    extent = (jnp.abs(along.x) + jnp.abs(along.y)) * (jnp.abs(arrow.x) + jnp.abs(arrow.y))
    return jnp.where(jnp.abs(product) <= rounding * extent, 0.0, product)


def cut(
    edges: Edges, line: Vector, side: Float[Array, "..."], labels: Int[Array, "*batch"]
) -> Edges:
    """The parts of segments on one side of the line through two places; ``labels`` name new ends.

    ``side`` is +1 for what is left of the line, −1 for what is right of it, 0 for both.
    """
    along = line[1] - line[0]
    left = left_of(edges.ends, line[0], along)
    # Where both ends lie on one side the quotient means nothing and is not used; it must be finite
    # all the same, for a NaN that is not chosen still reaches the gradient.
    inward = jnp.broadcast_to(side, edges.active.shape)[..., None] * left
    part, _ = safe_divide(left[..., 0], left[..., 0] - left[..., 1])
    first, last = edges.ends[..., 0], edges.ends[..., 1]
    meeting = first + (last - first).scaled(part)
    return Edges(
        where(inward < 0, meeting[..., None], edges.ends),
        jnp.where(inward < 0, labels[..., None], edges.labels),
        edges.active & (jnp.any(inward > 0, axis=-1) | (side == 0)),
    )


def folds_of(mirrors: Sequence[Vector], reflects: Sequence[Bool[Array, ""]]) -> list[Fold]:
    """Of every leg of a path but the last, the motion that unfolds it.

    Args:
        mirrors: both ends of each mirror.
        reflects: which of them there are; the first ones of those that are given.
    """
    folds = []
    for leg in range(len(mirrors)):
        zero, one = jnp.zeros_like(mirrors[leg].x[0]), jnp.ones_like(mirrors[leg].x[0])
        fold = Fold(Vector(zero, zero), Vector(one, zero), one)
        # A shorter path has no mirror here; the fold is then that of before, so that all paths are
        # one batch of one shape.
        for mirror, there in list(zip(mirrors, reflects, strict=True))[leg:]:
            mirrored = fold.mirrored(mirror[0], mirror[1] - mirror[0])
            fold = jax.tree.map(partial(jnp.where, there), mirrored, fold)
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
    count = len(word)
    sides = jnp.asarray(layout.sides, placed.size.dtype)
    mirrors = [placed.corners[index] for index in word]
    reflects = [index >= 0 for index in word]
    folds = folds_of(mirrors, reflects)

    source = folds[0].place(placed.camera) if count else placed.camera
    axis = folds[0].arrow(placed.axis) if count else placed.axis
    slide = _slide(placed, folds, word, source, axis, sides)
    sheets = placed.sheets is not None
    lefts = None if slide is None else _sliding_lefts(placed, folds, slide)
    lefts, facing, turned_away = _sides(placed, sides, word, lefts)

    solids, blockers, through = layout.solids, [], []
    index = jnp.asarray(solids.order)
    every = placed.corners, sides, jnp.asarray(layout.one_way)
    corners, side_of, one_way = solids.arranged(every)
    for leg in range(count + 1):
        # One through the source hides nothing, one with one blocking side nothing from the other.
        left = solids.arranged(lefts[leg])
        blocks = (left != 0) & (~one_way | (side_of * left > 0))
        if leg > 0:
            blocks &= reflects[leg - 1]
        # The ends of a mirror are named by the leg that comes to it.
        before = jnp.where(index == word[leg - 1], leg - 1, leg) if leg > 0 and not sheets else leg
        labels = [label_of(before, index, kind) for kind in (FIRST_END, SECOND_END)]
        edges = Edges(corners, jnp.stack(labels, axis=-1), blocks)
        beside = jnp.zeros(index.size, bool)
        for i, kind in ((leg - 1, CUT_BEFORE), (leg, CUT_AFTER)):
            if 0 <= i < count:
                mirror = reflects[i] & (index == word[i])
                side = jnp.where(mirror, 0.0, facing[i])
                edges = cut(edges, mirrors[i], side, label_of(leg, index, kind))
                beside |= mirror
        edges = eqx.tree_at(lambda e: e.active, edges, edges.active & ~beside)
        blockers.append(edges.folded(folds[leg]) if leg < count else edges)
        through.append(beside)
    ways = (0, 1) if sheets else (None,)
    apertures = [
        _aperture(mirrors, facing, word, i, way).folded(fold)
        for way in ways
        for i, fold in enumerate(folds)
    ]
    whole = [fold.place(mirror) for fold, mirror in zip(folds, mirrors, strict=True)]
    last = placed.corners[0]
    for there, mirror in zip(reflects, mirrors, strict=True):
        last = where(there, mirror, last)
    blocking = _stacked(blockers)
    past = None if slide is None else slide.rays_to(blocking.ends, leg=legs_of(blocking))
    nothing, none = jax.tree.map(lambda leaf: leaf[0, :0], blocking), jnp.zeros(0, bool)
    return Unfolded(
        source,
        axis,
        _stacked(whole) if count else nothing.ends,
        _stacked(apertures) if count else nothing,
        jnp.stack(reflects) if count else none,
        jnp.stack(turned_away) if count else none,
        jnp.stack(through),
        blocking,
        last,
        slide,
        past,
        solids,
    )


def _sides(
    placed: Placed,
    sides: Float[Array, " surfaces"],
    word: Int[Array, " reflections"],
    sliding: list[Array] | None,
) -> tuple[list[Array], list[Array], list[Array]]:
    """On which side of all surfaces the camera is, or its images; without derivatives.

    Args:
        placed: the scene in a pose.
        sides: of the surfaces, the ones that reflect, sense or block.
        word: mirrors along a path.
        sliding: `left_of` of every leg, if rays do not all come from the camera.

    Returns:
        For each leg, of all surfaces, `left_of` of where its rays come from; and for
        each mirror on which side of it that is (0 if there is no mirror), and whether it is not
        the side that reflects.
    """
    # On which side something lies is a choice: constant almost everywhere, of slope 0.
    still = jax.lax.stop_gradient(placed)
    starts, lines = still.starts, still.ends - still.starts
    source, lefts, facing, turned_away = still.camera, [], [], []
    for leg, index in enumerate(word):
        there = index >= 0
        lefts.append(left_of(source, starts, lines) if sliding is None else sliding[leg])
        above = lefts[-1][index]
        facing.append(jnp.where(there, jnp.where(above < 0, -1.0, 1.0), 0.0).astype(above.dtype))
        turned_away.append(there & ((above == 0) | (sides[index] * above < 0)))
        arrow = (source - starts[index]).conjugate().turned(_twice(lines[index]))
        source = where(there, starts[index] + arrow, source)
    last = left_of(source, starts, lines) if sliding is None else sliding[-1]
    return [*lefts, last], facing, turned_away


def _sliding_lefts(placed: Placed, folds: Sequence[Fold], slide: Slide) -> list[Array]:
    """For each leg, of all surfaces, `left_of` of where the ray to its middle comes from."""
    placed, folds, slide = jax.lax.stop_gradient((placed, list(folds), slide))
    lefts = []
    for leg, fold in enumerate([*folds, None]):
        ends = placed.corners if fold is None else fold.place(placed.corners)
        first, along = ends[..., 0], ends[..., 1] - ends[..., 0]
        middle = first + along.scaled(jnp.full_like(first.x, 0.5))
        left = left_of(middle - slide.rays_to(middle, leg=leg).arrow, first, along)
        lefts.append(left if fold is None else fold.sign * left)
    return lefts


def _aperture(
    mirrors: Sequence[Vector],
    facing: Sequence[Float[Array, ""]],
    word: Int[Array, " reflections"],
    i: int,
    way: int | None,
) -> Edges:
    """What the mirrors beside it leave of the i-th mirror of a path.

    Or, of a mirror with layers, of its outermost surface on the way in (0) and on the way out (1).
    """
    labels = [label_of(i + (way or 0), word[i], kind) for kind in (FIRST_END, SECOND_END)]
    labels = jnp.stack(labels)
    edges = Edges(mirrors[i], labels, word[i] >= 0)
    # The mirror before cuts it on the leg that comes to it, the next one on the leg after.
    cuts = (i - 1, i, CUT_BEFORE), (i + 1, i + 1, CUT_AFTER)
    for other, leg, kind in cuts if way is None else cuts[way : way + 1]:
        if 0 <= other < len(mirrors):
            # Of what the one has hidden, the other cuts nothing.
            side = jnp.where(edges.active, facing[other], 0.0)
            edges = cut(edges, mirrors[other], side, label_of(leg, word[i], kind))
    return edges


class VirtualCamera(eqx.Module):
    """The camera as it appears behind the last mirror of a path; several along a first axis.

    Attributes:
        source: where it is.
        axis: its optical axis, a unit vector.
        handedness: −1 after an odd number of reflections, else 1.
        slide: from where rays come; ``None`` if all come from the source.
    """

    source: Vector
    axis: Vector
    handedness: Float[Array, "*paths"]
    slide: Slide | None = None


def virtual_cameras(
    layout: Layout, placed: Placed, words: Sequence[tuple[int, ...]]
) -> VirtualCamera:
    """The camera's images by paths over given mirrors, without what may stand in their way."""

    def image(word: Int[Array, " reflections"]) -> VirtualCamera:
        reflects = [index >= 0 for index in word]
        folds = folds_of([placed.corners[index] for index in word], reflects)
        source, axis, sign = placed.camera, placed.axis, jnp.ones_like(placed.size)
        if folds:
            source, axis, sign = folds[0].place(source), folds[0].arrow(axis), folds[0].sign
        sides = jnp.asarray(layout.sides, source.x.dtype)
        slide = _slide(placed, folds, word, source, axis, sides)
        return VirtualCamera(source, axis, sign, slide)

    return jax.vmap(image)(jnp.asarray(padded(words)))


def legs_of(blockers: Edges) -> Int[Array, "legs 1 1"]:
    """The legs of blockers, to stand beside their ends."""
    return jnp.arange(len(blockers.active)).reshape(-1, 1, 1)


def _slide(
    placed: Placed,
    folds: Sequence[Fold],
    word: Int[Array, " reflections"],
    source: Vector,
    axis: Vector,
    sides: Float[Array, " surfaces"],
) -> Slide | None:
    """From where the rays of a path come; ``None`` if all come from its source."""
    if placed.pupil is None and placed.sheets is None:
        return None
    pupil = None if placed.pupil is None else (placed.pupil[0], placed.pupil[1] + ROOM)
    if placed.sheets is None or not len(word):
        return Slide(source, axis, pupil)
    start, end = placed.segment(word)
    normals = unit(end - start).perpendicular().scaled(sides[word])
    after = [fold.arrow(normals[leg]) for leg, fold in enumerate(folds[1:])]
    thickness = jnp.where((word >= 0)[:, None], placed.sheets.thickness[word], 0.0)
    index = placed.sheets.index[word]
    return Slide(source, axis, pupil, stack(*after, normals[len(word) - 1]), thickness, index)


def unfold_all(layout: Layout, placed: Placed, words: Sequence[tuple[int, ...]]) -> Unfolded:
    """All paths over given mirrors, along a first axis."""
    return jax.vmap(partial(unfold, layout, placed))(jnp.asarray(padded(words)))


def _stacked(parts: list[Any]) -> Any:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts)
