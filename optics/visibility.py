"""Exact visibility: which parts of each pad a camera sees, directly and in straight mirrors.

From a (virtual) camera S, the part of a pad that is hidden by a segment AB, or seen through it, is
one interval: that where

    (A − S) × (P − S),   (P − S) × (B − S)   and   −(B − A) × (P − A),

all taken with the sign of (A − S) × (B − S), are positive. Each is linear along the pad, so its
values at the pad's two ends give the ends of the interval as quotients. Mirrors are such windows
and everything else casts such shadows; field of view and grazing angle are linear conditions too.
So nothing is sampled and nothing iterated.

What bounds which piece is searched without derivatives. The ends are then computed once more, each
from the one line that bounds it (`optics.boundaries`), and these carry the derivatives.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import as_float, safe_arctan2, safe_divide
from designopt.solution import Solution
from designopt.vectors import Vector, rotation
from optics.boundaries import Pad, Routes, bounding_line, routes_of, where_met
from optics.camera import Camera
from optics.intervals import Interval, common_part, gaps
from optics.missing import angular_gap, elevation
from optics.scene import Layout, Placed, Scene, place
from optics.unfolding import (
    CROSSING,
    KINDS,
    ROUNDING_UNITS,
    Edges,
    Unfolded,
    height,
    paths_of,
    unfold,
    unit,
)
from optics.views import (
    FIRST_PAD_END,
    HIGH_GRAZING,
    LEFT_LIMIT,
    LOW_GRAZING,
    RIGHT_LIMIT,
    SECOND_PAD_END,
    Pieces,
    ViewResult,
)


SHORTEST_PIECE = 64
"""A piece no longer than so many units of rounding of the pad is rounding and not seen."""


def find_views(
    scene: Scene,
    angles: Float[Array, "*batch joints"],
    *,
    bounces: int | None = None,
    room: int | None = None,
) -> Solution[Pieces]:
    """What the camera sees of every pad, directly and by up to ``bounces`` reflections.

    Args:
        scene: the scene, its mirrors straight; ``jax.vmap`` over it for a batch of designs.
        angles: joint angles in the order of ``scene.angle_names``, rad.
        bounces: most reflections of a path; the scene's own number by default.
        room: most pieces in which a pad is seen; by default 8 and two for every path.

    Returns:
        The pieces of each pad. ``margin`` and ``result`` are of the shape (paths, pads), paths in
        the order of `path_names`. ``margin`` (rad) is half the angle at the (virtual) camera of
        the widest piece that is seen; of a pad that is not seen, minus the angle by which it is
        missed: the least over all lines of sight to it of how far that line lies inside the
        deepest shadow, or outside of the mirrors and of the field of view. Its derivative shows
        the way out. ``residual`` is 0: nothing is iterated.

    Raises:
        ValueError: a mirror is curved; `trace_views` sees in these.
    """
    layout = scene.layout
    if layout.curved:
        names = ", ".join(layout.mirrors[i].name for i in layout.curved)
        raise ValueError(f"find_views: mirrors {names} are curved; use trace_views")
    angles = as_float(angles)
    words = paths_of(layout, layout.bounces if bounces is None else bounces)

    def one(angles: Float[Array, " joints"]) -> Solution[Pieces]:
        return _views(scene, place(scene, angles), words, room)

    for _ in angles.shape[:-1]:
        one = jax.vmap(one)
    return one(angles)


class _Found(eqx.Module):
    """What one path shows of one pad: the gaps between shadows, not all of them present."""

    present: Bool[Array, "*batch gaps"] | None
    gaps: Interval | None
    widest: Interval
    margin: Float[Array, "*batch"]
    result: ViewResult


def _views(
    scene: Scene, placed: Placed, words: list[np.ndarray], room: int | None
) -> Solution[Pieces]:
    layout, camera = scene.layout, scene.camera
    index = len(layout.mirrors) + np.arange(len(layout.pads))
    starts, ends = jax.tree.map(lambda leaf: leaf[index], (placed.starts, placed.ends))
    sides = jnp.asarray(layout.sides[index], starts.x.dtype)
    pads = Pad(jnp.asarray(index), starts, ends, sides, scene.grazing)
    still = jax.lax.stop_gradient((camera, placed, pads))
    found = [_search(layout, *still, of_length) for of_length in words]

    # All that may be a piece of a pad in one row, with the path that shows it.
    rows = [jax.tree.map(_by_pad, (part.present, part.gaps)) for part in found]
    present, gaps = jax.tree.map(lambda *leaves: jnp.concatenate(leaves, axis=1), *rows)
    counts = [part.present.shape[-1] for part in found for _ in range(part.present.shape[0])]
    path_of = np.repeat(np.arange(len(counts)), counts)
    room = min(8 + 2 * len(counts) if room is None else room, len(path_of))
    slots = jnp.tile(jnp.arange(len(path_of)), (len(index), 1))
    _, slots = jax.lax.sort((jnp.where(present, gaps.start, 2.0), slots), num_keys=1)
    chosen = slots[:, :room]
    present_here, gaps = jax.tree.map(
        lambda leaf: jnp.take_along_axis(leaf, chosen, axis=1), (present, gaps)
    )
    paths = jnp.where(present_here, jnp.asarray(path_of)[chosen], 0)

    routes = routes_of(placed, words)
    pieces = jax.vmap(jax.vmap(_piece, (None,) * 3 + (None, 0, 0, 0)), (None,) * 3 + (0, 0, 0, 0))(
        camera, placed, routes, pads, present_here, paths, gaps
    )
    crowded = jnp.sum(present, axis=1) > room

    def judged(path: Int[Array, ""], pad: Pad, crowded: Bool[Array, ""], found: _Found) -> Any:
        margin = _moving_margin(camera, placed, routes, pad, path, found)
        return margin, ViewResult.where(crowded, ViewResult.too_many, found.result)

    of_views = jax.tree.map(
        lambda *leaves: jnp.concatenate(leaves),
        *(eqx.tree_at(lambda f: (f.present, f.gaps), part, (None, None)) for part in found),
    )
    of_pad = jax.vmap(judged, (None, 0, 0, 0))
    order = jnp.arange(len(counts))
    margin, result = jax.vmap(of_pad, (0, None, None, 0))(order, pads, crowded, of_views)
    return Solution(pieces, margin, jnp.zeros_like(margin), result)


def _by_pad(leaf: Array) -> Array:
    """From (paths, pads, gaps) to (pads, all gaps of all paths)."""
    return jnp.moveaxis(leaf, 0, 1).reshape(leaf.shape[1], -1)


def _search(
    layout: Layout, camera: Camera, placed: Placed, pads: Pad, words: np.ndarray
) -> _Found:
    """All pads by all paths of one length, without derivatives."""

    def along(word: Int[Array, " reflections"]) -> _Found:
        path = unfold(layout, placed, word)
        return jax.vmap(lambda pad: _search_one(camera, path, pad))(pads)

    return jax.vmap(along)(jnp.asarray(words))


def _search_one(camera: Camera, path: Unfolded, pad: Pad) -> _Found:
    above = height(path.source, pad.start, unit(pad.end - pad.start))
    front = (above != 0) & (pad.side * above >= 0)
    turned_away = jnp.any(path.turned_away)
    window = _window(camera, path, pad, above)
    shadows, active = _shadows(camera, path, pad)
    pieces = gaps(window, shadows, active)
    shortest = SHORTEST_PIECE * jnp.finfo(above.dtype).eps
    present = front & ~turned_away & (pieces.end - pieces.start > shortest)
    result = ViewResult.where(
        window.end > window.start, ViewResult.blocked, ViewResult.missed
    )
    result = ViewResult.where(front, result, ViewResult.behind_pad)
    result = ViewResult.where(turned_away, ViewResult.behind_mirror, result)
    result = ViewResult.where(jnp.any(present), ViewResult.successful, result)
    widest = angular_gap(camera, path, pad, above)
    return _Found(present, pieces, widest, (widest.end - widest.start) / 2, result)


def _piece(
    camera: Camera,
    placed: Placed,
    routes: Routes,
    pad: Pad,
    present: Bool[Array, ""],
    path: Int[Array, ""],
    found: Interval,
) -> Pieces:
    """One piece of a pad, with derivatives."""

    def end(label: Int[Array, ""]) -> Float[Array, ""]:
        line = bounding_line(camera, placed, routes, pad, path, label)
        at = jnp.where(label == SECOND_PAD_END, 1.0, where_met(line, pad))
        return jnp.where(present & (label != FIRST_PAD_END), at, 0.0)

    ends = jax.vmap(end)(jnp.stack([found.start_label, found.end_label]))
    looked = look(camera, placed, routes, pad, path, ends)
    spans = jax.vmap(lambda at: _reflections(placed, routes, pad, path, at), out_axes=1)(ends)
    zero = jnp.zeros_like(found.start_label)
    return Pieces(
        present,
        path,
        ends[0],
        ends[1],
        jnp.where(present, found.start_label, zero),
        jnp.where(present, found.end_label, zero),
        *(jnp.where(present, leaf, 0.0) for leaf in looked),
        jnp.where(present, spans, 0.0),
    )


def look(
    camera: Camera,
    placed: Placed,
    routes: Routes,
    pad: Pad,
    path: Int[Array, ""],
    coordinates: Float[Array, " points"],
) -> tuple[Float[Array, " points"], Float[Array, " points"], Float[Array, " points"]]:
    """How points of a pad appear by a path: pixel, pixels per mm along the pad, distance in mm.

    The angle dθ under which a length ds appears is sin(grazing angle) ds / distance, that is the
    height of the source above the pad's line over the squared distance.
    """
    source, axis = jax.tree.map(lambda leaf: leaf[path], (routes.sources, routes.axes))
    step, toward = pad.end - pad.start, pad.start - source
    arrow = Vector(toward.x + coordinates * step.x, toward.y + coordinates * step.y)
    across = axis.x * arrow.y - axis.y * arrow.x
    angle = routes.handedness[path] * safe_arctan2(across, axis.x * arrow.x + axis.y * arrow.y)
    above = jnp.abs(unit(step).cross(toward))
    per_size, _ = safe_divide(jnp.full_like(across, above), arrow.squared())
    per_mm = camera.pixels_per_radian(angle) * per_size / placed.size
    return camera.pixel(angle), per_mm, arrow.length() * placed.size


def _reflections(
    placed: Placed, routes: Routes, pad: Pad, path: Int[Array, ""], coordinate: Float[Array, ""]
) -> Float[Array, " reflections"]:
    """Where on each mirror of a path the ray to a point of a pad is reflected."""
    source = jax.tree.map(lambda leaf: leaf[path], routes.sources)
    arrow = pad.start + (pad.end - pad.start).scaled(coordinate) - source
    word = routes.words[path]
    count = word.shape[0]
    shift, turn = jax.tree.map(lambda leaf: leaf[path, :count], (routes.shifts, routes.turns))
    flips = routes.flips[path, :count]

    def folded(place: Vector) -> Vector:
        return shift + Vector(place.x, flips * place.y).turned(turn)

    start, end = jax.tree.map(lambda leaf: leaf[word], (placed.starts, placed.ends))
    first, step = folded(start) - source, folded(end) - folded(start)
    at = safe_divide(first.cross(arrow), arrow.cross(step))[0]
    return jnp.where(word >= 0, at, 0.0)


def _moving_margin(
    camera: Camera,
    placed: Placed,
    routes: Routes,
    pad: Pad,
    path: Int[Array, ""],
    found: _Found,
) -> Float[Array, ""]:
    """The margin that the search found, with the derivative of the lines that bound it."""

    source = jax.tree.map(lambda leaf: leaf[path], routes.sources)

    def angle(label: Int[Array, ""]) -> Float[Array, ""]:
        line = bounding_line(camera, placed, routes, pad, path, label)
        met = pad.start + (pad.end - pad.start).scaled(where_met(line, pad)) - source
        x = jnp.where(line.crosses, met.x, line.direction.x)
        return safe_arctan2(jnp.where(line.crosses, met.y, line.direction.y), x)

    above = (pad.end - pad.start).cross(source - pad.start)
    sense = jnp.where(pad.side == 0, jnp.where(above < 0, -1.0, 1.0), pad.side)
    moving = sense * (angle(found.widest.end_label) - angle(found.widest.start_label)) / 2
    gap = found.margin + (moving - jax.lax.stop_gradient(moving))
    rises = elevation(placed, routes, pad, path)
    return jnp.where(rises < 0, jnp.minimum(rises, gap), gap)


def _behind(
    edges: Edges, source: Vector, place: Vector
) -> tuple[Float[Array, "3 *n"], Bool[Array, "*n"]]:
    """Three numbers that are all positive if a place lies behind segments, seen from a source.

    And which of the segments are seen edge-on, so that nothing lies behind them.
    """
    a, b, p = edges.starts - source, edges.ends - source, place - source
    cross = a.cross(b)
    rounding = ROUNDING_UNITS * jnp.finfo(cross.dtype).eps
    extent = (jnp.abs(a.x) + jnp.abs(a.y)) * (jnp.abs(b.x) + jnp.abs(b.y))
    ahead = [a.cross(p), p.cross(b), -(b - a).cross(place - edges.starts)]
    sign = jnp.sign(cross)
    return jnp.stack([sign * number for number in ahead]), jnp.abs(cross) <= rounding * extent


def _edge_labels(edges: Edges) -> Int[Array, "3 *n"]:
    crossing = edges.start_labels // KINDS * KINDS + CROSSING
    return jnp.stack([edges.start_labels, edges.end_labels, crossing])


def _limits(camera: Camera, path: Unfolded, arrow: Vector) -> Float[Array, "2"]:
    """Two numbers that are both positive if an arrow lies within a field of view below 180°."""
    half = camera.field_of_view / 2
    right, left = path.axis.turned(rotation(-half)), path.axis.turned(rotation(half))
    return jnp.stack([right.cross(arrow), arrow.cross(left)])


_PAD_ENDS = (FIRST_PAD_END, SECOND_PAD_END)
_LIMITS = (RIGHT_LIMIT, LEFT_LIMIT)


def _window(camera: Camera, path: Unfolded, pad: Pad, above: Float[Array, ""]) -> Interval:
    """The part of a pad that field of view, grazing angle and mirrors let through."""
    along = unit(pad.end - pad.start)
    # notation: where a ray meets the pad at s from the foot of the height h, tan(grazing) = h/|s|.
    h, sine, cosine = jnp.abs(above), jnp.sin(pad.grazing), jnp.cos(pad.grazing)
    wide = camera.field_of_view > jnp.pi

    def conditions(place: Vector) -> Float[Array, " conditions"]:
        arrow = place - path.source
        s = along.dot(arrow)
        limits = jnp.where(wide, 1.0, _limits(camera, path, arrow))
        grazing = jnp.stack([h * cosine + s * sine, h * cosine - s * sine])
        through, edge_on = _behind(path.mirrors, path.source, place)
        through = jnp.where((edge_on | ~path.mirrors.active)[None], -1.0, through)
        return jnp.concatenate([limits, grazing, through.reshape(-1)])

    labels = jnp.concatenate(
        [jnp.array([*_LIMITS, LOW_GRAZING, HIGH_GRAZING]), _edge_labels(path.mirrors).reshape(-1)]
    )
    return common_part(conditions(pad.start), conditions(pad.end), labels, _PAD_ENDS)


def _shadows(
    camera: Camera, path: Unfolded, pad: Pad
) -> tuple[Interval, Bool[Array, " shadows"]]:
    """The parts of a pad that surfaces hide, and what a field of view beyond 180° leaves out."""
    blockers = path.blockers
    first, edge_on = _behind(blockers, path.source, pad.start)
    last, _ = _behind(blockers, path.source, pad.end)
    hidden = common_part(first, last, _edge_labels(blockers), _PAD_ENDS)
    active = path.in_the_way(pad.index) & ~edge_on & (hidden.start < hidden.end)
    outside = common_part(
        -_limits(camera, path, pad.start - path.source),
        -_limits(camera, path, pad.end - path.source),
        jnp.array(_LIMITS),
        _PAD_ENDS,
    )
    beyond = (camera.field_of_view > jnp.pi) & (outside.start < outside.end)
    shadows = jax.tree.map(lambda many, one: jnp.append(many, one), hidden, outside)
    return shadows, jnp.append(active, beyond)
