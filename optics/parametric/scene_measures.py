"""What a scene is judged by: coverage that goes on below 0, resolution, blur, room for a module.

A search differentiates these; a page computes some of them fast enough to follow a slider.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.numerics import safe_divide, safe_sqrt
from designopt.programs import Program
from designopt.solution import Solution
from designopt.vectors import Vector, vector
from optics.scene.scene import Scene, place
from optics.visibility.coverage import find_pieces, find_views
from optics.visibility.edge_refined import trace_views
from optics.visibility.focus import find_blur
from optics.visibility.sharpness import ROUNDING, Sharpness, find_sharpness
from optics.visibility.views import Pieces

ROOMS = (4, 8)
"""Pieces of a pad of which resolution is asked: as few of these as are enough, if any is."""

PLACES = 9
"""Places along a pad at which resolution is asked for, its ends included."""

BEYOND = 100.0
"""How much less, in logarithms, a view is worth at a place one pad's length beyond its end, where
another view shows that place. What is seen best often ends at the pad's end, and slopes have to
lead away from where it would recede."""


class Sight(NamedTuple):
    """What is seen in poses.

    Attributes:
        found: the pieces.
        coverage: part of each pad that is seen.
        redundancy: by how many paths a point of it is seen on average.
        missed_by: see `missed_by`.
    """

    found: Solution[Pieces]
    coverage: Float[Array | np.ndarray, "*poses pads"]
    redundancy: Float[Array | np.ndarray, "*poses pads"]
    missed_by: Float[Array | np.ndarray, "*poses pads"]


@Program
def see(scene: Scene, angles: Float[Array, "*poses joints"]) -> Sight:
    """What is seen at joint angles in rad."""
    found = (trace_views if scene.layout.curved else find_views)(scene, angles)
    return _with_coverage(found, missed_by(found))


def see_pieces(scene: Scene, angles: Float[Array, " joints"]) -> Sight:
    """As `see` in one pose; unless mirrors curve, without ``missed_by``, by `find_pieces`."""
    if scene.layout.curved:
        return see(scene, angles)
    found = find_pieces(scene, angles)
    return _with_coverage(found, jnp.zeros_like(found.margin))


def _with_coverage(found: Solution[Pieces], missed: Float[Array, "*poses pads"]) -> Sight:
    coverage = found.value.coverage()
    covered = jnp.where(coverage > ROUNDING, coverage, 0.0)
    return Sight(found, covered, found.value.redundancy(), missed)


def sharpness_of(
    scene: Scene, angles: Float[np.ndarray, "poses joints"], pieces: Pieces
) -> Sharpness:
    """Resolution of what is seen in several poses, at joint angles in rad."""
    room = pieces.present.shape[-1]
    # All pieces that there are come first.
    most = int(np.max(np.sum(np.asarray(pieces.present), axis=-1), initial=0))
    room = min([room, *(some for some in ROOMS if some >= most)])
    pieces = jax.tree.map(lambda leaf: np.asarray(leaf)[:, :, :room], pieces)
    return find_sharpness(scene, angles, pieces, bounces=scene.layout.bounces)


def missed_by(found: Solution[Pieces]) -> Float[Array, "*poses pads"]:
    """The angle (rad) by which the path that comes nearest misses each pad; 0 where one sees it."""
    return jnp.maximum(-jnp.max(found.margin, axis=-2), 0.0)


def signed_coverage(found: Solution[Pieces]) -> Float[Array, "*poses pads"]:
    """Part of each pad that is seen; of one that is hidden minus the angle (rad) of `missed_by`."""
    coverage = found.value.coverage()
    return jnp.where(coverage > 0, coverage, -missed_by(found))


def find_resolution(
    scene: Scene, found: Solution[Pieces], typical: float
) -> Float[Array, "*poses pads places"]:
    """Resolution (px/mm) at places of each pad, by the best view of each; differentiable.

    Squared distance is a quadratic of the place (Stewart's theorem), and resolution times squared
    distance is taken as linear, which it is for an equidistant lens. A place that is not seen
    counts as the nearest one that is; see `BEYOND`. A hidden pad has minus the angle (rad) of
    `missed_by` times ``typical``.

    Args:
        scene: the scene, its mirrors straight.
        found: what is seen in poses.
        typical: a resolution, px/mm.
    """
    view = found.value
    part, inside, gap = _at_places(view)
    squared = _squared_distance(scene, view, part)
    first, last = (view.px_per_mm[..., i, None] * view.distance[..., i, None] ** 2 for i in (0, 1))
    there = view.present[..., None] & (view.end > view.start)[..., None]
    sharp = (first + part * (last - first)) / jnp.where(there, squared, 1.0)
    usable = there & (sharp > 0)
    worth = jnp.log(jnp.where(usable, sharp, 1.0))
    shown = jnp.any(usable & inside, axis=-2, keepdims=True)
    nearest = usable & (gap <= jnp.min(jnp.where(usable, gap, jnp.inf), axis=-2, keepdims=True))
    of_seen = jnp.where(usable, worth - BEYOND * gap, -jnp.inf)
    of_other = jnp.where(nearest, worth, -jnp.inf)
    best = jnp.max(jnp.where(shown, of_seen, of_other), axis=-2)
    hidden = ~jnp.any(usable, axis=-2)
    missed = jnp.broadcast_to(missed_by(found)[..., None], best.shape)
    return jnp.where(hidden, -typical * missed, jnp.exp(jnp.where(hidden, 0.0, best)))


def find_worst_blur(scene: Scene, view: Pieces) -> Float[Array, "*poses pads"]:
    """Diameter of the largest blur spot on what is seen of each pad, pixels; differentiable.

    Of a piece it is at one of its ends or where it is nearest; behind layers, at its ends.

    Args:
        scene: the scene; its camera has a lens.
        view: what is seen in poses.
    """
    distance = view.object_distance
    if view.apparent is None:
        first, last = view.distance[..., 0] ** 2, view.distance[..., 1] ** 2
        square = _length_on_pad(scene, view) ** 2
        foot, _ = safe_divide(first - last + square, 2 * square)
        nearest = _squared_distance(scene, view, jnp.clip(foot, 0.0, 1.0)[..., None])
        distance = jnp.concatenate([distance, safe_sqrt(nearest)], axis=-1)
    there = view.present[..., None]
    blur = find_blur(scene.camera, jnp.where(there, distance, 1.0))
    return jnp.max(jnp.where(there, blur, 0.0), axis=(-2, -1))


def find_module_room(
    scene: Scene, angles: Float[Array, "poses joints"]
) -> Float[Array, "poses parts boxes"]:
    """Room between the camera's module and every mirror, pad and blocker, mm; differentiable.

    It is the width of the widest strip between a surface and a box of the module, along a side of
    the box or along the surface; below 0 the depth to which they reach into each other.

    Args:
        scene: the scene; its camera has a module.
        angles: joint angles, rad.
    """
    assert scene.camera.module is not None
    layout, boxes = scene.layout, scene.camera.module.boxes()
    parts = len(layout.mirrors) + len(layout.pads) + len(layout.blockers)
    low, high = jnp.min(boxes, axis=-1), jnp.max(boxes, axis=-1)
    middle, half = (vector(ends / 2) for ends in (low + high, high - low))

    def room(start: Vector, end: Vector, middle: Vector, half: Vector) -> Float[Array, ""]:
        first, last = start - middle, end - middle
        ahead = jnp.maximum(jnp.minimum(first.x, last.x), -jnp.maximum(first.x, last.x)) - half.x
        aside = jnp.maximum(jnp.minimum(first.y, last.y), -jnp.maximum(first.y, last.y)) - half.y
        step = last - first
        reach = half.x * jnp.abs(step.y) + half.y * jnp.abs(step.x)
        across, _ = safe_divide(jnp.abs(first.cross(step)) - reach, step.length())
        return jnp.maximum(jnp.maximum(ahead, aside), across)

    def in_pose(angles: Float[Array, " joints"]) -> Float[Array, "parts boxes"]:
        placed = place(scene, angles)

        def local(corner: Vector) -> Vector:
            return (
                (corner[:parts] - placed.camera).turned(placed.axis.conjugate()).scaled(placed.size)
            )

        each = jax.vmap(jax.vmap(room, (None, None, 0, 0)), (0, 0, None, None))
        return each(local(placed.starts), local(placed.ends), middle, half)

    return jax.vmap(in_pose)(angles)


def _at_places(view: Pieces) -> tuple[Array, Array, Array]:
    """Where places of a pad are on each piece, as a part of it; whether inside; how far beyond."""
    at = jnp.linspace(0.0, 1.0, PLACES, dtype=view.start.dtype)
    at = at.reshape((1,) * view.start.ndim + (-1,))
    start, end = view.start[..., None], view.end[..., None]
    gap = jnp.maximum(jnp.maximum(start - at, at - end), 0.0)
    part, _ = safe_divide(at - start, jnp.broadcast_to(end - start, (at - start).shape))
    return jnp.clip(part, 0.0, 1.0), gap == 0, gap


def _length_on_pad(scene: Scene, view: Pieces) -> Float[Array, "*pieces"]:
    """Length of each piece, mm."""
    step = scene.pads[:, 1] - scene.pads[:, 0]
    lengths = jnp.sqrt(jnp.sum(step * step, axis=-1))
    lengths = lengths.reshape((1,) * (view.start.ndim - 2) + (-1, 1))
    return (view.end - view.start) * lengths


def _squared_distance(
    scene: Scene, view: Pieces, part: Float[Array, "*pieces places"]
) -> Float[Array, "*pieces places"]:
    """Squared distance of places on each piece from the (virtual) camera, mm²."""
    first, last = (view.distance[..., i, None] ** 2 for i in (0, 1))
    chord = _length_on_pad(scene, view)[..., None] ** 2
    return first + part * (last - first) - part * (1 - part) * chord
