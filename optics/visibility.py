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
from designopt.vectors import Vector, chosen
from optics.boundaries import Pad, Route, bounding_line, routes_of, where_met
from optics.camera import Camera
from optics.intervals import Interval
from optics.labels import (
    FIRST_PAD_END,
    SECOND_PAD_END,
)
from optics.missing import elevation
from optics.scene import Layout, Placed, Scene, place
from optics.searching import Verdict, search
from optics.unfolding import padded, paths_of, unfold, unit
from optics.views import (
    Pieces,
    ViewResult,
)


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
    scene: Scene, placed: Placed, words: list[tuple[int, ...]], room: int | None
) -> Solution[Pieces]:
    layout, camera = scene.layout, scene.camera
    pads = Pad.all_of(scene, placed)
    still = jax.lax.stop_gradient((camera, placed, pads))
    candidates, present, verdicts = _search(layout, *still, words)

    # All that may be a piece of a pad in one row, in the order in which it begins on the pad.
    path_of = np.repeat(np.arange(len(words)), present.shape[-1])
    rows = jax.tree.map(lambda leaf: leaf.reshape(leaf.shape[0], -1), (candidates, present))
    candidates, present = rows
    room = min(8 + 2 * len(words) if room is None else room, len(path_of))
    keys = jnp.where(present, candidates.start, 2.0)
    paths = jnp.tile(jnp.asarray(path_of), (len(layout.pads), 1))
    labels = candidates.start_label, candidates.end_label
    first = jax.lax.sort((keys, paths, *labels), num_keys=1)
    keys, paths, *labels = (leaf[:, :room] for leaf in first)
    crowded = jnp.sum(present, axis=1) > room

    routes = routes_of(placed, words)

    def piece(
        pad: Pad, key: Float[Array, ""], path: Int[Array, ""], labels: list[Int[Array, ""]]
    ) -> Pieces:
        there = key < 2
        path, start, end = (jnp.where(there, part, 0) for part in (path, *labels))
        return _piece(camera, placed, routes, pad, there, path, jnp.stack([start, end]))

    def judged(
        route: Route, pad: Pad, crowded: Bool[Array, ""], verdict: Verdict
    ) -> tuple[Float[Array, ""], Any]:
        margin = _moving_margin(camera, placed, route, pad, verdict)
        return margin, ViewResult.where(crowded, ViewResult.too_many, verdict.result)

    of_pad = jax.vmap(piece, (None, 0, 0, 0))
    pieces = jax.vmap(of_pad)(pads, keys, paths, labels)
    of_path = jax.vmap(judged, (None, 0, 0, 0))
    margin, result = jax.vmap(of_path, (0, None, None, 1))(routes, pads, crowded, verdicts)
    return Solution(pieces, margin, jnp.zeros_like(margin), result)


def _search(
    layout: Layout, camera: Camera, placed: Placed, pads: Pad, words: list[tuple[int, ...]]
) -> tuple[Interval, Bool[Array, "pads paths gaps"], Verdict]:
    """All pads by all paths, without derivatives."""
    table = jnp.asarray(padded(words))
    paths = jax.vmap(lambda word: unfold(layout, placed, word))(table)
    by_all = jax.vmap(lambda path, pad: search(camera, path, pad), (0, None))
    return jax.vmap(by_all, (None, 0))(paths, pads)


def _piece(
    camera: Camera,
    placed: Placed,
    routes: Route,
    pad: Pad,
    present: Bool[Array, ""],
    path: Int[Array, ""],
    labels: Int[Array, "2"],
) -> Pieces:
    """One piece of a pad, with derivatives; all of it is 0 where there is none."""
    route = routes.at(path)

    ends = where_met(bounding_line(camera, placed, route, pad, labels), pad)
    ends = jnp.where(labels == SECOND_PAD_END, 1.0, ends)
    ends = jnp.where(present & (labels != FIRST_PAD_END), ends, 0.0)
    seen = *look(camera, placed, route, pad, ends), _reflections(placed, route, pad, ends)
    seen = [jnp.where(present, number, 0.0) for number in seen]
    return Pieces(present, path, ends[0], ends[1], labels[0], labels[1], *seen)


def look(
    camera: Camera, placed: Placed, route: Route, pad: Pad, coordinates: Float[Array, " points"]
) -> tuple[Float[Array, " points"], Float[Array, " points"], Float[Array, " points"]]:
    """How points of a pad appear by a path: pixel, pixels per mm along the pad, distance in mm.

    The angle dθ under which a length ds appears is sin(grazing angle) ds / distance, that is the
    height of the source above the pad's line over the squared distance.
    """
    source, axis = route.source, route.axis
    step, toward = pad.end - pad.start, pad.start - source
    arrow = Vector(toward.x + coordinates * step.x, toward.y + coordinates * step.y)
    across = axis.x * arrow.y - axis.y * arrow.x
    angle = safe_arctan2(across, axis.x * arrow.x + axis.y * arrow.y)
    # Beyond the seam of a camera that looks all around, pixels are counted on.
    middle = jax.lax.stop_gradient(toward + step.scaled((coordinates[0] + coordinates[-1]) / 2))
    centre = safe_arctan2(axis.cross(middle), axis.dot(middle))
    turns = jax.lax.stop_gradient(jnp.round((angle - centre) / (2 * jnp.pi)))
    angle = route.handedness() * (angle - 2 * jnp.pi * turns)
    above = jnp.abs(unit(step).cross(toward))
    per_size, _ = safe_divide(jnp.full_like(across, above), arrow.squared())
    per_mm = camera.pixels_per_radian(angle) * per_size / placed.size
    return camera.pixel(angle), per_mm, arrow.length() * placed.size


def _reflections(
    placed: Placed, route: Route, pad: Pad, coordinates: Float[Array, " points"]
) -> Float[Array, "reflections points"]:
    """Where on each mirror of a path the rays to points of a pad are reflected."""
    arrow = (pad.end - pad.start).scaled(coordinates) + (pad.start - route.source)
    found = []
    for mirror, fold in zip(route.word, route.folds, strict=True):
        start, end = placed.segment(mirror)
        first, step = fold.place(start) - route.source, fold.arrow(end - start)
        at, _ = safe_divide(first.cross(arrow), arrow.cross(step))
        found.append(jnp.where(mirror >= 0, at, 0.0))
    return jnp.stack(found) if found else jnp.zeros_like(coordinates[None][:0])


def _moving_margin(
    camera: Camera, placed: Placed, route: Route, pad: Pad, verdict: Verdict
) -> Float[Array, ""]:
    """The margin that the search found, with the derivative of the lines that bound it."""
    source = route.source

    ends = jnp.stack([verdict.widest.start_label, verdict.widest.end_label])
    line = bounding_line(camera, placed, route, pad, ends)
    met = (pad.end - pad.start).scaled(where_met(line, pad)) + (pad.start - source)
    first, last = chosen(line.crosses, met, line.direction).angle()
    above = (pad.end - pad.start).cross(source - pad.start)
    sense = jnp.where(pad.side == 0, jnp.where(above < 0, -1.0, 1.0), pad.side)
    moving = sense * (last - first)
    gap = verdict.margin + (moving - jax.lax.stop_gradient(moving))
    rises = elevation(placed, route, pad)
    return jnp.where(rises < 0, jnp.minimum(rises, gap), gap)
