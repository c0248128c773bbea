"""Which parts of a pad each path shows, and what bounds them: found without derivatives.

Whatever lies between the virtual camera and the pad takes one interval of it
(`optics.visibility.boundaries`): mirrors are windows that a ray must pass through, as are field of
view and grazing angle, and everything else casts shadows. So nothing is sampled and nothing
iterated.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from designopt.vectors import Vector
from optics.scene.camera import Camera
from optics.visibility.boundaries import PER_SEGMENT, Segments, conditions
from optics.visibility.boundary_codes import LIMITS
from optics.visibility.intervals import (
    Interval,
    bounds_of_gap,
    common_part,
    gaps,
    hull,
    where_positive,
)
from optics.visibility.lines_of_sight import coordinates
from optics.visibility.pads import Faces, Pad, Windows
from optics.visibility.refraction import Cover
from optics.visibility.unfolding import ROUNDING_UNITS, Unfolded, left_of
from optics.visibility.views import ViewResult

SHORTEST_PIECE = 64
"""A piece no longer than so many units of rounding of the pad is rounding and not seen."""


class Found(eqx.Module):
    """Which pieces of a pad are seen in a pose, and what bounds them.

    The pieces are in the order in which they begin; there is room for more than there are.

    Attributes:
        present: whether there is such a piece; elsewhere all else is 0.
        path: index of the path that shows it.
        face: 0 for the pad or its outermost surface, else 1 and which of its clear end faces.
        bounds: what bounds it where it begins on the pad and where it ends, by index: of all
            segments on all legs, once for each of their conditions, then of `LIMITS`, the
            surface's own ends, and those of its windows.
        free: room, and one, minus the pieces; not positive if some were left out.
        result: why a path does not show the pad.
    """

    present: Bool[Array, "*pads pieces"]
    path: Int[Array, "*pads pieces"]
    face: Int[Array, "*pads pieces"] | None
    bounds: Int[Array, "*pads pieces 2"]
    free: Float[Array, "*pads"]
    result: ViewResult


class Candidates(eqx.Module):
    """What one path may show of one surface, and what bounds it.

    Attributes:
        window: what all that must be passed leaves.
        shadows: what hides some of it.
        active: which of these count.
        start: where candidates for pieces begin.
        end: where they end.
        present: which of them are pieces.
        result: why none of them is.
    """

    window: Interval
    shadows: Interval
    active: Bool[Array, "*views shadows"]
    start: Float[Array, "*views gaps"]
    end: Float[Array, "*views gaps"]
    present: Bool[Array, "*views gaps"]
    result: ViewResult


class Chosen(eqx.Module):
    """The candidates of a pad that are pieces, side by side; there is room for more.

    Attributes:
        present: whether there is such a piece.
        view: by which path and surface.
        start: where it begins on that surface.
        end: where it ends.
        free: room, and one, minus the pieces; not positive if some were left out.
    """

    present: Bool[Array, "*pads pieces"]
    view: Int[Array, "*pads pieces"]
    start: Float[Array, "*pads pieces"]
    end: Float[Array, "*pads pieces"]
    free: Float[Array, "*pads"]


def find(camera: Camera, paths: Unfolded, faces: Faces, max_pieces: int | None) -> Found:
    """The pieces of all pads by all paths, both along a first axis.

    Candidates are many and pieces few: what is not needed to choose these is computed afterwards.
    """
    of_path = jax.vmap(partial(search, camera), (0, None, 0))
    every = jax.vmap(of_path, (None, 0, 1))(paths, faces.seen, faces.windows)
    candidates, result = (every.start, every.end, every.present), every.result
    if faces.ends is not None:
        candidates, result = _with_ends(faces, candidates, result)
    room = 8 + 2 * len(paths.reflects) if max_pieces is None else max_pieces
    chosen = jax.vmap(partial(_choose, room))(*candidates)
    face, path = None, chosen.view
    if faces.ends is not None:
        face, path = jnp.divmod(chosen.view, len(paths.reflects))
    pieces = _pieces(paths, faces, every, chosen, face, path)
    order = jnp.argsort(jnp.where(chosen.present, pieces.start, 2.0))

    def arranged(numbers: Shaped[Array, "pads pieces"]) -> Shaped[Array, "pads pieces"]:
        there = jnp.where(chosen.present, numbers, jnp.zeros_like(numbers))
        return jnp.take_along_axis(there, order, axis=1)

    bounds = jnp.stack([arranged(pieces.start_label), arranged(pieces.end_label)], axis=-1)

    def outcome(free: Float[Array, ""], result: ViewResult) -> ViewResult:
        return ViewResult.where(free > 0, result, ViewResult.too_many)

    return Found(
        arranged(chosen.present),
        arranged(path),
        None if face is None else arranged(face),
        bounds,
        chosen.free,
        jax.vmap(jax.vmap(outcome, (None, 0)))(chosen.free, result),
    )


def _with_ends(faces: Faces, candidates: Any, results: ViewResult) -> tuple[Any, ViewResult]:
    """Of every pad its views by its outermost surface and then by its clear end faces."""
    ends_of = np.array(faces.ends_of)
    there = jnp.asarray(ends_of >= 0)[..., None, None]
    (*fronts, shown), by_front = jax.tree.map(
        lambda leaf: leaf[: len(ends_of)], (candidates, results)
    )
    (*of_ends, others), by_ends = jax.tree.map(
        lambda leaf: leaf[len(ends_of) + ends_of], (candidates, results)
    )
    others &= there

    def joined(front: Shaped[Array, "..."], of_ends: Shaped[Array, "..."]) -> Shaped[Array, "..."]:
        every = jnp.concatenate([front[:, None], of_ends], axis=1)
        return every.reshape(len(front), -1, front.shape[-1])

    seen = jnp.any(others, axis=(1, 3))

    def outcome(
        seen: Bool[Array, ""], by_front: ViewResult, own: Bool[Array, " ends"], by_end: ViewResult
    ) -> ViewResult:
        # A camera behind the outermost surface may be in front of an end face, which counts then.
        result = by_front
        for end in range(len(own)):
            of_end = jax.tree.map(lambda leaf, end=end: leaf[end], by_end)
            beside = own[end] & (result == ViewResult.behind_pad)
            result = ViewResult.where(beside, of_end, result)
        return ViewResult.where(seen, ViewResult.successful, result)

    of_paths = jax.vmap(outcome, (0, 0, None, 1))
    both = map(joined, (*fronts, shown), (*of_ends, others))
    return tuple(both), jax.vmap(of_paths)(seen, by_front, jnp.asarray(ends_of >= 0), by_ends)


def _choose(
    room: int,
    start: Float[Array, "views gaps"],
    end: Float[Array, "views gaps"],
    present: Bool[Array, "views gaps"],
) -> Chosen:
    """The pieces of a pad, as far as there is room."""
    every, max_pieces = present.reshape(-1), min(room, present.size)
    counts, numbers = jnp.cumsum(every), jnp.arange(max_pieces)
    few = jnp.searchsorted(counts, numbers + 1, method="scan_unrolled").astype(int)
    few, count = jnp.minimum(few, every.size - 1), counts[-1]
    return Chosen(
        numbers < count,
        few // present.shape[1],
        start.reshape(-1)[few],
        end.reshape(-1)[few],
        (max_pieces + 1 - count).astype(start.dtype),
    )


def _pieces(
    paths: Unfolded,
    faces: Faces,
    every: Candidates,
    chosen: Chosen,
    face: Int[Array, "pads pieces"] | None,
    path: Int[Array, "pads pieces"],
) -> Interval:
    """Those that were chosen on the pads behind the surfaces, and what bounds them."""
    seen_by = jnp.arange(len(path))[:, None]
    if face is not None:
        seen_by = jnp.where(face > 0, len(path) + faces.end_of(face), seen_by)
    window, shadows, active = jax.tree.map(
        lambda leaf: leaf.at[seen_by, path].get(mode="promise_in_bounds"),
        (every.window, every.shadows, every.active),
    )
    by, entries = paths.at(path), (chosen.start, chosen.end)
    bounds = jax.vmap(jax.vmap(bounds_of_gap))
    labels = bounds(window, shadows, active, chosen.start, chosen.end)

    def met(pad: Pad, _: Windows, __: Array, by: Unfolded, piece: Interval) -> Interval:
        return _limit_met(by, pad, piece)

    pieces = faces.of_pieces(met, face, path, by, Interval(*entries, *labels))
    if faces.fronts is None:
        return pieces

    def behind(cover: Cover, ends: Vector, entries: Array, by: Unfolded) -> Array:
        return coordinates(by, cover, ends, entries)

    places = faces.through(behind, face, jnp.stack(entries, axis=-1), by)
    start, end = places[..., 0], places[..., 1]
    # Through an end face what enters higher may lie nearer to the pad's first end.
    turned = start > end
    labels = pieces.start_label, pieces.end_label
    first, last = jnp.where(turned, labels[1], labels[0]), jnp.where(turned, labels[0], labels[1])
    return Interval(jnp.minimum(start, end), jnp.maximum(start, end), first, last)


def search(camera: Camera, path: Unfolded, pad: Pad, inner: Windows) -> Candidates:
    """One pad by one path.

    Args:
        camera: the camera.
        path: the path.
        pad: the pad.
        inner: what its layers let through.
    """
    segments, others, edge_on = _parts(camera, path, pad)
    window = _window(camera, path, inner, segments, others, edge_on)
    shadows, active = _shadows(camera, path, pad, segments, others, edge_on)
    start, end = gaps(window, shadows, active)

    above = left_of(path.eye(pad.start, pad.end), pad.start, pad.end - pad.start)
    front = (above != 0) & (pad.side * above >= 0)
    turned_away = jnp.any(path.turned_away)
    # Nothing is left of a mirror that lies in the line of the mirror beside it.
    open_ = jnp.all(path.mirrors.active | ~path.per_window(path.reflects))
    shortest = SHORTEST_PIECE * jnp.finfo(above.dtype).eps
    present = front & ~turned_away & open_ & (end - start > shortest)
    # The last shadow is what a field of view beyond 180° leaves out.
    outside = active[-1] & (shadows.start[-1] <= window.start) & (shadows.end[-1] >= window.end)
    looks = open_ & (window.end > window.start) & ~outside
    result = ViewResult.where(looks, ViewResult.blocked, ViewResult.missed)
    result = ViewResult.where(front, result, ViewResult.behind_pad)
    result = ViewResult.where(turned_away, ViewResult.behind_mirror, result)
    result = ViewResult.where(jnp.any(present), ViewResult.successful, result)
    return Candidates(window, shadows, active, start, end, present, result)


def _parts(
    camera: Camera, path: Unfolded, pad: Pad
) -> tuple[Interval, Interval, Bool[Array, " segments"]]:
    """The parts of a pad behind each segment, and those within each of the other limits.

    And which segments are seen edge-on, so that nothing lies behind them.
    """
    arrows = path.past().arrow
    cross = arrows[..., 0].cross(arrows[..., 1]).reshape(-1)
    rounding = ROUNDING_UNITS * jnp.finfo(cross.dtype).eps
    extent = jnp.prod(jnp.abs(arrows.x) + jnp.abs(arrows.y), axis=-1).reshape(-1)
    sign, count = jnp.sign(cross), PER_SEGMENT * cross.size
    signs = jnp.concatenate([*[sign] * PER_SEGMENT, jnp.ones(len(LIMITS), sign.dtype)])
    start, end = where_positive(
        *(signs[None] * conditions(camera, path, pad, Segments.all_of(path)))
    )
    bounds = jnp.arange(start.size)
    parts = Interval(start, end, bounds, bounds)
    segments = jax.tree.map(lambda leaf: leaf[:count].reshape(PER_SEGMENT, -1), parts)
    others = jax.tree.map(lambda leaf: leaf[count:], parts)
    return common_part(segments), others, jnp.abs(cross) <= rounding * extent


def _window(
    camera: Camera,
    path: Unfolded,
    inner: Windows,
    segments: Interval,
    others: Interval,
    edge_on: Bool[Array, " segments"],
) -> Interval:
    """The part of a pad that field of view, grazing angle, mirrors and layers let through."""
    last = PER_SEGMENT * segments.start.size + len(LIMITS)
    # Segments, left and right limit, both grazing limits, the pad itself, windows of its layers.
    own = jnp.concatenate([jnp.array([[0.0, 1.0]], inner.dtype), inner])
    first, second = own[:, 0], own[:, 1]
    bounds = last + np.arange(2 * len(first)).reshape(-1, 2)
    own = Interval(first, second, jnp.asarray(bounds[:, 0]), jnp.asarray(bounds[:, 1]))
    all_of = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), segments, others, own)
    through, wide = path.through.reshape(-1), camera.field_of_view > jnp.pi
    always = jnp.zeros(2 + len(first), bool)
    ignored = jnp.concatenate([~through, jnp.stack([wide, wide]), always])
    shut = jnp.concatenate([through & edge_on, jnp.zeros(4 + len(first), bool)])
    start = jnp.where(ignored, 0.0, jnp.where(shut, 1.0, all_of.start))
    end = jnp.where(ignored, 1.0, all_of.end)
    return common_part(Interval(start, end, all_of.start_label, all_of.end_label))


def _shadows(
    camera: Camera,
    path: Unfolded,
    pad: Pad,
    segments: Interval,
    others: Interval,
    edge_on: Bool[Array, " segments"],
) -> tuple[Interval, Bool[Array, " shadows"]]:
    """The parts of a pad that surfaces hide, and what a field of view beyond 180° leaves out."""
    hiding = path.in_the_way(pad.own)
    active = hiding.reshape(-1) & ~edge_on & (segments.start < segments.end)
    of_legs = jax.tree.map(lambda leaf: leaf.reshape(hiding.shape), (segments, active))
    # The shadow of a convex solid is one interval, and the faces where rays enter cast it.
    segments, active = path.merged(of_legs, lambda faces: hull(*faces))
    start, end, label = others.start[:2], others.end[:2], others.start_label[:2]
    # What is left out by each limit is the rest of the pad.
    rest = Interval(jnp.where(start > 0, 0.0, end), jnp.where(start > 0, start, 1.0), label, label)
    outside = common_part(rest)
    beyond = (camera.field_of_view > jnp.pi) & (outside.start < outside.end)
    shadows = jax.tree.map(lambda many, one: jnp.append(many, one), segments, outside)
    return shadows, jnp.append(active, beyond)


def _limit_met(path: Unfolded, pad: Pad, piece: Interval) -> Interval:
    """A piece that ends, of the field of view's two limits, at that on whose side the place lies.

    At half a turn both are one line, and which condition ends first is rounding.
    """
    limits = PER_SEGMENT * path.blockers.active.size
    step, toward = pad.end - pad.start, pad.start - path.source
    places = jnp.stack([piece.start, piece.end])
    labels = jnp.stack([piece.start_label, piece.end_label])
    if path.slide is None:
        right = path.axis.cross(toward) + places * path.axis.cross(step) <= 0
    else:
        right = path.axis.cross(path.to(pad.start + step.scaled(places)).arrow) <= 0
    is_limit = (labels == limits) | (labels == limits + 1)
    met = jnp.where(is_limit, limits + right.astype(labels.dtype), labels)
    return Interval(piece.start, piece.end, met[0], met[1])
