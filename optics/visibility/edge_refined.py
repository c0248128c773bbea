"""Visibility by rays, for curved mirrors and any projection.

A coarse fan of rays from the camera shows by which path each of them reaches which pad. Where
that changes from one ray to the next, the edge is found to rounding (`optics.visibility.edges`),
with its derivative. Views narrower than the fan's spacing can be missed; on straight mirrors
`optics.visibility.coverage` is exact.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import as_float, safe_divide
from designopt.solution import Solution
from optics.scene.scene import Scene, place
from optics.visibility.edges import Edge, find_edge
from optics.visibility.fan import Fan
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces, ViewResult

RAYS = 1024
"""Rays of the coarse fan."""

ROOM = 64
"""Pieces that are looked for in all."""


@partial(jax.jit, static_argnames=("bounces", "rays", "max_pieces"))
def trace_views(
    scene: Scene,
    angles: Float[Array, "*batch joints"],
    *,
    bounces: int | None = None,
    rays: int = RAYS,
    max_pieces: int = ROOM,
) -> Solution[Pieces]:
    """What the camera sees of every pad, by rays; mirrors may be curved.

    Args:
        scene: the scene; ``jax.vmap`` over it for a batch of designs.
        angles: joint angles in the order of ``scene.angle_names``, rad.
        bounces: most reflections of a path; the scene's own number by default.
        rays: number of rays of the coarse fan.
        max_pieces: most pieces of all pads together.

    Returns:
        The pieces of each pad where the fan has found them, exact to rounding; only where a
        mirror bends away from the ray, to the square root of rounding. ``margin`` and
        ``result`` are of the shape (paths, pads), paths in the order of `name_paths`. ``margin``
        (rad) is the angle at the camera of the widest piece that is seen, and 0 where none
        is: rays give no distance by which they miss. ``residual`` is the largest Newton step (rad)
        that is left at an edge of that view.

    Raises:
        ValueError: there is no pad, or pads or mirrors have layers.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/half-height-mirror.toml")
        >>> bool(trace_views(scene, jnp.zeros(0), rays=64).value.present.any())
        True
    """
    if not scene.layout.pads:
        raise ValueError("trace_views: the scene has no pad; trace_rays follows rays without one")
    if scene.layers is not None:
        raise ValueError(
            "trace_views: pads have layers, which only find_views looks through; make the mirrors "
            "straight, or the pads bare"
        )
    if scene.mirror_layers is not None:
        raise ValueError(
            "trace_views: mirrors have layers, which only find_views follows; leave them out"
        )
    angles = as_float(angles)
    words = paths_of(scene.layout, scene.layout.bounces if bounces is None else bounces)

    def one(angles: Float[Array, " joints"]) -> Solution[Pieces]:
        fan = Fan.of(scene, place(scene, angles), words)
        return _views(fan, rays, max_pieces)

    for _ in angles.shape[:-1]:
        one = jax.vmap(one)
    return one(angles)


def _views(fan: Fan, rays: int, max_pieces: int) -> Solution[Pieces]:
    still = jax.lax.stop_gradient(fan)
    half = still.camera.field_of_view / 2
    # In the middles of equal parts: no ray runs along the limits themselves.
    steps = jnp.asarray((2 * np.arange(rays) + 1) / rays - 1, half.dtype)
    # Runs of equal labels, found by their neighbours: sizes are static, so as many slots as may be
    # needed are filled, and what does not fit is reported as too many.
    labels = jax.vmap(still.label)(half * steps)
    padded = jnp.pad(labels, 1)
    begins = (labels != 0) & (padded[:-2] != labels)
    stops = (labels != 0) & (padded[2:] != labels)
    first = jnp.nonzero(begins, size=max_pieces, fill_value=rays)[0]
    last = jnp.nonzero(stops, size=max_pieces, fill_value=rays)[0]
    present = first < rays

    # Of both ends of every run: its last ray, and the next one or the limit of the fan.
    angle_of = jnp.concatenate([-half[None], half * steps, half[None]])
    insides = angle_of[jnp.stack([first, last], axis=1) + 1]
    outsides = angle_of[jnp.stack([first, jnp.minimum(last + 2, rays + 1)], axis=1)]
    seen = jnp.append(labels, 0)[first]
    both = jax.vmap(find_edge, (None, None, None, 0, 0))
    edges = jax.vmap(both, (None, 0, 0, 0, 0))(fan, present, seen, insides, outsides)
    runs = jax.vmap(_run, (None, 0, 0, 0))(fan, present, seen, edges)
    return _collected(fan, runs, jnp.sum(begins) > max_pieces)


class _Run(eqx.Module):
    """Neighbouring rays that see one pad by one path, between refined edges."""

    piece: Pieces
    pad: Int[Array, "*runs"]
    width: Float[Array, "*runs"]
    residual: Float[Array, "*runs"]


def _run(fan: Fan, present: Bool[Array, ""], label: Int[Array, ""], edges: Edge) -> _Run:
    pad, path, _ = fan.meaning(label)
    # By pad coordinate, not by angle: after an odd number of reflections the image runs backwards.
    swap = edges.coordinate[0] > edges.coordinate[1]
    pair = jax.tree.map(lambda leaf: jnp.where(swap, leaf[::-1], leaf), edges)
    surface = len(fan.layout.mirrors) + pad
    start, end = fan.placed.segment(surface)
    length = (end - start).length() * fan.placed.size
    density = fan.camera.pixels_per_radian(pair.angle)
    per_mm, _ = safe_divide(density, jnp.abs(pair.slope) * length)
    first, last = jnp.clip(pair.coordinate, 0, 1)
    piece = Pieces(
        present=present,
        path=path,
        start=first,
        end=last,
        start_label=pair.label[0],
        end_label=pair.label[1],
        pixels=fan.camera.pixel(pair.angle),
        px_per_mm=per_mm,
        distance=pair.length * fan.placed.size,
        spans=pair.spans.T,
    )
    return _Run(piece, pad, jnp.abs(pair.angle[1] - pair.angle[0]), jnp.max(pair.step))


def _collected(fan: Fan, runs: _Run, crowded: Bool[Array, ""]) -> Solution[Pieces]:
    """All runs, by pad and in the order in which they begin on it."""

    def of_pad(pad: Int[Array, ""]) -> Pieces:
        present = runs.piece.present & (runs.pad == pad)
        order = jnp.argsort(jnp.where(present, runs.piece.start, 2.0))

        def kept(leaf: Array) -> Array:
            there = present[order].reshape(-1, *(1,) * (leaf.ndim - 1))
            return jnp.where(there, leaf[order], jnp.zeros_like(leaf))

        return jax.tree.map(kept, runs.piece)

    def judged(path: Int[Array, ""], pad: Int[Array, ""]) -> tuple[Array, Array, Any]:
        mine = runs.piece.present & (runs.pad == pad) & (runs.piece.path == path)
        result = ViewResult.where(jnp.any(mine), ViewResult.successful, ViewResult.unseen)
        result = ViewResult.where(crowded, ViewResult.too_many, result)
        margin = jnp.max(jnp.where(mine, runs.width, 0.0))
        return margin, jnp.max(jnp.where(mine, runs.residual, 0.0)), result

    pads, paths = jnp.arange(len(fan.layout.pads)), jnp.arange(len(fan.words))
    judge = jax.vmap(jax.vmap(judged, (None, 0)), (0, None))
    margin, residual, result = judge(paths, pads)
    return Solution(jax.vmap(of_pad)(pads), margin, residual, result)
