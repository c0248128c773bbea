"""How sharply pads are imaged: pixels per mm along them, also between the ends of what is seen.

The ends of all pieces of a pad cut it into stretches, on each of which the same pieces show it. All
are compared at the same places of a stretch, its ends included, so the best view of each place is
known; a place counts with the length that it stands for. In straight mirrors the values are exact,
in curved ones they are interpolated between rays.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from designopt.numerics import safe_divide
from designopt.programs import Program
from designopt.vectors import Vector
from optics.scene.scene import Scene, place
from optics.visibility.fan import Fan
from optics.visibility.image_scale import look
from optics.visibility.lines_of_sight import entries_of, scales
from optics.visibility.pads import Faces, Pad, Windows
from optics.visibility.refraction import Cover
from optics.visibility.tracing import Leg
from optics.visibility.unfolding import Unfolded, paths_of, unfold_all
from optics.visibility.views import Pieces

PARTS = 64
"""Parts into which a stretch is cut and, by rays, a piece."""

ROUNDING = 1e-12
"""A smaller part of a pad is no more than a point: rays that meet there have no resolution."""


class Sharpness(eqx.Module):
    """Resolution along pads, and distances; 0 where nothing is seen.

    Attributes:
        px_per_mm: least, median (by length) and greatest resolution over all that is seen of each
            pad, at each place by the path that shows it best; shape (poses, pads, 3).
        by_path: the same of every piece, taken together with all others of its path; shape
            (poses, pads, pieces, 3).
        distance: least and greatest distance of every piece from the (virtual) camera, mm; shape
            (poses, pads, pieces, 2).
        apparent: the same of the distance from which light seems to come; ``None`` where no pad
            or mirror has layers.
    """

    px_per_mm: Float[np.ndarray, "poses pads 3"]
    by_path: Float[np.ndarray, "poses pads pieces 3"]
    distance: Float[np.ndarray, "poses pads pieces 2"]
    apparent: Float[np.ndarray, "poses pads pieces 2"] | None

    @property
    def object_distance(self) -> Float[np.ndarray, "poses pads pieces 2"]:
        """The least and greatest distance that counts for a lens, mm."""
        return self.distance if self.apparent is None else self.apparent


def find_sharpness(
    scene: Scene, angles: Float[np.ndarray, "poses joints"], pieces: Pieces, *, bounces: int
) -> Sharpness:
    """Resolution and distance of all that is seen.

    Args:
        scene: the scene.
        angles: joint angles in the order of ``scene.angle_names``, rad.
        pieces: what is seen: from `find_views`, or from `trace_views` if a mirror is curved.
        bounces: most reflections of a path, as they were given to these.
    """
    # Shapes are poses, pads, pieces, stretches, places on a stretch.
    view = jax.tree.map(np.asarray, pieces)
    ends = np.sort(np.concatenate([view.start, view.end], axis=-1), axis=-1)
    low, high = ends[..., :-1], ends[..., 1:]
    parts = np.linspace(0, 1, PARTS + 1)
    places = low[..., None] * (1 - parts) + high[..., None] * parts
    widths = np.where(high - low > ROUNDING, high - low, 0)
    weights = widths[..., None] * np.where((parts == 0) | (parts == 1), 0.5, 1) / PARTS
    shown = view.present[..., None] & (high > low)[..., None, :]
    shown &= (view.start[..., None] <= low[..., None, :]) & (
        high[..., None, :] <= view.end[..., None]
    )
    # Most stretches are empty, or nothing shows them: the others of every pad come first.
    of_any = np.any(shown, axis=2)
    order = np.argsort(~of_any, axis=-1, kind="stable")
    order = order[..., : max(int(np.max(np.sum(of_any, axis=-1), initial=0)), 1)]
    places, weights = (np.take_along_axis(one, order[..., None], -2) for one in (places, weights))
    shown = np.take_along_axis(shown, order[..., None, :], -1)
    shown = np.repeat(shown, PARTS + 1, axis=-1)
    per_mm, *distances = _looked_up(scene, angles, pieces, places, bounces)
    weights = weights.reshape(*weights.shape[:2], -1)
    # There is room for many more pieces than most scenes ever have.
    there, used = view.present[..., None], np.flatnonzero(view.present.any(axis=(0, 1)))
    by_paths = [shown & (view.path == view.path[..., piece, None])[..., None] for piece in used]
    masks = [shown, *by_paths]
    best = np.stack([np.max(per_mm, axis=2, where=one, initial=0) for one in masks], axis=2)
    lengths = np.stack([np.where(np.any(one, axis=2), weights, 0) for one in masks], axis=2)
    spread = _spread(best, lengths)
    by_path = np.zeros((*view.path.shape, 3))
    by_path[..., used, :] = spread[..., 1:, :]

    def extremes(distance: Float[np.ndarray, "poses pads pieces places"]) -> np.ndarray:
        nearest = np.min(distance, axis=-1, where=shown, initial=np.inf)
        farthest = np.max(distance, axis=-1, where=shown, initial=0)
        return np.where(there, np.stack([nearest, farthest], axis=-1), 0)

    found = jax.tree.map(extremes, distances)
    return Sharpness(spread[..., 0, :], np.where(there, by_path, 0), *found)


def _looked_up(
    scene: Scene,
    angles: Float[np.ndarray, "poses joints"],
    pieces: Pieces,
    places: Float[np.ndarray, "poses pads stretches places"],
    bounces: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Pixels per mm by all pieces, at all places of each pad; distance, apparent one (mm)."""
    if scene.layout.curved:
        every = places.reshape(*places.shape[:2], -1)
        return _by_ray(scene, angles, pieces, every, bounces=bounces)
    # One after the other, so that one program serves for any number of them.
    parts = [
        _unfolded(scene, angles, pieces.path, pieces.face, stretch, bounces=bounces)
        for stretch in np.moveaxis(places, 2, 0)
    ]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves, axis=-1), *parts)


def _spread(
    values: Float[np.ndarray, "*batch places"], weights: Float[np.ndarray, "*batch places"]
) -> Float[np.ndarray, "*batch 3"]:
    """Least, weighted median and greatest of the values that have a weight; 0 if none has."""
    seen = weights > 0
    least = np.min(values, axis=-1, where=seen, initial=np.inf)
    greatest = np.max(values, axis=-1, where=seen, initial=0)
    values = np.where(seen, values, np.inf)
    order = np.argsort(values, axis=-1)
    values, weights = (np.take_along_axis(part, order, axis=-1) for part in (values, weights))
    # The place in the middle of the length lies between the middles of what two samples stand for.
    reached = np.cumsum(weights, axis=-1)
    half = reached[..., -1:] / 2
    reached = reached - weights / 2
    after = np.maximum(np.argmax(reached >= half, axis=-1), 1)[..., None]
    first, last = (np.take_along_axis(values, after - back, axis=-1) for back in (1, 0))
    low, high = (np.take_along_axis(reached, after - back, axis=-1) for back in (1, 0))
    with np.errstate(invalid="ignore", divide="ignore"):
        median = (first + (half - low) / (high - low) * (last - first))[..., 0]
    spread = np.stack([least, median, greatest], axis=-1)
    return np.where(np.any(seen, axis=-1)[..., None], spread, 0)


@partial(Program, static_argnames=["bounces"])
def _unfolded(
    scene: Scene,
    angles: Float[Array, "poses joints"],
    path: Int[Array, "poses pads pieces"],
    face: Int[Array, "poses pads pieces"] | None,
    places: Float[Array, "poses pads places"],
    *,
    bounces: int,
) -> tuple[Array, Array, Array | None]:
    """Pixels per mm at places on pads by the paths of all pieces; distance, apparent one (mm)."""
    words, room = paths_of(scene.layout, bounces), path.shape[-1]

    def in_pose(
        angles: Float[Array, " joints"],
        path: Int[Array, "pads pieces"],
        face: Int[Array, "pads pieces"] | None,
        places: Float[Array, "pads places"],
    ) -> tuple[Array, Array, Array | None]:
        placed = place(scene, angles)
        paths = unfold_all(scene.layout, placed, words)
        faces = Faces.all_of(scene, placed, paths)

        def rays(cover: Cover | None, ends: Vector, places: Array, by: Unfolded) -> Any:
            entries = places if cover is None else entries_of(by, cover, ends, places)
            return entries, scales(by, cover, ends, entries)

        def seen(pad: Pad, _: Windows, path: Int[Array, ""], by: Unfolded, *of_rays: Any) -> Any:
            return look(scene.camera, placed.size, by, pad, *of_rays)[1:]

        own, every = paths.at(path), jnp.repeat(places[:, None], room, axis=1)
        return faces.of_pieces(seen, face, path, own, *faces.through(rays, face, every, own))

    given = angles, path, face, places
    if len(angles) > 1:
        return jax.vmap(in_pose)(*given)
    # A batch, even of one, takes half as long again to trace.
    one = in_pose(*jax.tree.map(lambda leaf: leaf[0], given))
    return jax.tree.map(lambda leaf: leaf[None], one)


@partial(Program, static_argnames=["bounces"])
def _by_ray(
    scene: Scene,
    angles: Float[Array, "poses joints"],
    pieces: Pieces,
    places: Float[Array, "poses pads places"],
    *,
    bounces: int,
) -> tuple[Array, Array, None]:
    """The same as `_unfolded`, between rays to all pieces."""
    layout, camera, words = scene.layout, scene.camera, paths_of(scene.layout, bounces)
    lengths = jnp.asarray([len(word) for word in words])
    parts = jnp.linspace(0, 1, PARTS + 1, dtype=places.dtype)

    def in_pose(angles: Float[Array, " joints"], *on_pads: Any) -> Any:
        placed = place(scene, angles)
        fan = Fan.of(scene, placed, words)

        def of_piece(surface: Array, places: Array, piece: Pieces) -> tuple[Array, Array, None]:
            start, end = placed.segment(surface)
            length, leg = (end - start).length() * placed.size, lengths[piece.path]

            def meets(angle: Float[Array, ""]) -> tuple[Float[Array, ""], Leg]:
                legs = fan.follow(angle)
                return legs.coordinate[leg], legs

            def of_ray(angle: Float[Array, ""]) -> tuple[Array, ...]:
                at, slope, legs = jax.jvp(meets, (angle,), (jnp.ones_like(angle),), has_aux=True)
                density = camera.pixels_per_radian(angle)
                per_mm, _ = safe_divide(density, jnp.abs(slope) * length)
                met = legs.surface[leg] == surface
                return met, at, per_mm, legs.length[leg] * placed.size

            first, last = camera.angle(piece.pixels)
            met, *curves = jax.vmap(of_ray)(first + parts * (last - first))
            # Density over the slope of where rays land: their spacing on the pad, read backwards.
            # The piece has exact ends, and a ray along them may miss the pad by rounding.
            inner = met & (parts > 0) & (parts < 1)
            ends = (jnp.stack([piece.start, piece.end]), piece.px_per_mm, piece.distance)
            at, per_mm, distance = (
                jnp.where(inner, curve, end[0] + parts * (end[1] - end[0]))
                for curve, end in zip(curves, ends, strict=True)
            )
            return jnp.interp(places, at, per_mm), jnp.interp(places, at, distance), None

        of_pad = jax.vmap(of_piece, (None, None, 0))
        surfaces = len(layout.mirrors) + jnp.arange(len(layout.pads))
        return jax.vmap(of_pad)(surfaces, *on_pads)

    return jax.vmap(in_pose)(angles, places, pieces)
