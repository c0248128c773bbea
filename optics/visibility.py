"""Exact visibility: which parts of each pad a camera sees, directly and in straight mirrors.

What bounds which piece is searched without derivatives (`optics.searching`). The ends are then
computed once more, each from the one line that bounds it (`optics.boundaries`), and these carry
the derivatives.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import as_float, safe_arctan2, safe_divide
from designopt.solution import Solution
from designopt.vectors import Vector
from optics.boundaries import Pad, Routes, bounding_line, routes_of, where_met
from optics.camera import Camera
from optics.intervals import Interval
from optics.missing import elevation
from optics.scene import Layout, Placed, Scene, place
from optics.searching import Verdict, search
from optics.unfolding import paths_of, unfold, unit
from optics.views import FIRST_PAD_END, SECOND_PAD_END, Pieces, ViewResult


@partial(jax.jit, static_argnames=("bounces", "room"))
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
        the order of `path_names`. ``margin`` (rad) is the angle at the (virtual) camera of the
        widest piece that is seen; of a pad that is not seen, minus the angle by which it is
        missed: by which the shadows, mirrors and limits that hide it must give way at least until
        a line of sight is free. Its derivative shows the way out. ``residual`` is 0: nothing is
        iterated. A surface through the camera hides nothing, and where surfaces lie on one
        another what is seen there means nothing.

    Raises:
        ValueError: a mirror is curved (`trace_views` sees in these), or there is no pad.
    """
    layout = scene.layout
    if not layout.pads:
        raise ValueError("find_views: the scene has no pad; trace_rays follows rays without one")
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
    verdicts = jax.tree.map(lambda *parts: jnp.concatenate(parts), *(part[2] for part in found))

    # All that may be a piece of a pad in one row, in the order in which it begins on the pad.
    counts = [len(of_length) for of_length in words]
    lengths = [part[1].shape[-1] for part in found]
    path_of = np.repeat(np.arange(sum(counts)), np.repeat(lengths, counts))
    rows = [jax.tree.map(_by_pad, part[:2]) for part in found]
    candidates, present = jax.tree.map(lambda *parts: jnp.concatenate(parts, axis=1), *rows)
    room = min(8 + 2 * sum(counts) if room is None else room, len(path_of))
    slots = jnp.tile(jnp.arange(len(path_of)), (len(index), 1))
    keys = jnp.where(present, candidates.start, 2.0)
    first = jax.lax.sort((keys, slots), num_keys=1)[1][:, :room]
    kept, there = jax.tree.map(
        lambda leaf: jnp.take_along_axis(leaf, first, axis=1), (candidates, present)
    )
    crowded = jnp.sum(present, axis=1) > room

    routes = routes_of(placed, words)

    def piece(pad: Pad, there: Bool[Array, ""], path: Int[Array, ""], found: Interval) -> Pieces:
        return _piece(camera, placed, routes, pad, there, jnp.where(there, path, 0), found)

    def judged(
        path: Int[Array, ""], pad: Pad, crowded: Bool[Array, ""], verdict: Verdict
    ) -> tuple[Float[Array, ""], Any]:
        margin = _moving_margin(camera, placed, routes, pad, path, verdict)
        return margin, ViewResult.where(crowded, ViewResult.too_many, verdict.result)

    of_pad = jax.vmap(piece, (None, 0, 0, 0))
    pieces = jax.vmap(of_pad)(pads, there, jnp.asarray(path_of)[first], kept)
    of_path = jax.vmap(judged, (None, 0, 0, 0))
    order = jnp.arange(sum(counts))
    margin, result = jax.vmap(of_path, (0, None, None, 0))(order, pads, crowded, verdicts)
    return Solution(pieces, margin, jnp.zeros_like(margin), result)


def _search(
    layout: Layout, camera: Camera, placed: Placed, pads: Pad, words: np.ndarray
) -> tuple[Interval, Bool[Array, "paths pads gaps"], Verdict]:
    """All pads by all paths of one length, without derivatives."""

    def along(word: Int[Array, " reflections"]) -> Any:
        path = unfold(layout, placed, word)
        return jax.vmap(lambda pad: search(camera, path, pad))(pads)

    return jax.vmap(along)(jnp.asarray(words))


def _by_pad(leaf: Array) -> Array:
    """From (paths, pads, gaps) to (pads, all gaps of all paths)."""
    return jnp.moveaxis(leaf, 0, 1).reshape(leaf.shape[1], -1)


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
    pixels, px_per_mm, distance = look(camera, placed, routes, pad, path, ends)
    spans = jax.vmap(lambda at: _reflections(placed, routes, pad, path, at), out_axes=1)(ends)
    zero = jnp.zeros_like(found.start_label)
    return Pieces(
        present,
        path,
        ends[0],
        ends[1],
        jnp.where(present, found.start_label, zero),
        jnp.where(present, found.end_label, zero),
        jnp.where(present, pixels, 0.0),
        jnp.where(present, px_per_mm, 0.0),
        jnp.where(present, distance, 0.0),
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
    angle = safe_arctan2(across, axis.x * arrow.x + axis.y * arrow.y)
    # Beyond the seam of a camera that looks all around, pixels are counted on.
    middle = jax.lax.stop_gradient(toward + step.scaled((coordinates[0] + coordinates[-1]) / 2))
    centre = safe_arctan2(axis.cross(middle), axis.dot(middle))
    turns = jax.lax.stop_gradient(jnp.round((angle - centre) / (2 * jnp.pi)))
    angle = routes.handedness[path] * (angle - 2 * jnp.pi * turns)
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
    verdict: Verdict,
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
    moving = sense * (angle(verdict.widest.end_label) - angle(verdict.widest.start_label))
    gap = verdict.margin + (moving - jax.lax.stop_gradient(moving))
    rises = elevation(placed, routes, pad, path)
    return jnp.where(rises < 0, jnp.minimum(rises, gap), gap)
