"""What is asked of views: how much of every pad is missing, and how sharp the rest is."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from designopt.numerics import safe_divide, safe_sqrt
from designopt.solution import Solution
from optics import Camera, Pieces, Scene

PLACES = 17
"""Places along a pad at which the search asks for resolution, besides the ends of pieces."""

NO_VIEW = 1e3
"""Resolution, px/mm, of what is not seen: that is coverage's concern."""


def together(angles: Float[Array, "*batch"]) -> Float[Array, "*batch 2"]:
    """Poses in which both joints have the same angle, rad.

    Often PIP changes only the view of the proximal pad and DIP only that of the distal one. But a
    mirror or a layer may stand in the other pad's view: a verdict is on all pairs of angles.
    """
    return jnp.stack([angles, angles], axis=-1)


def hidden_penalty(views: Solution[Pieces]) -> Float[Array, "*poses pads"]:
    """Part of each pad that is not seen, and more with a slope where nothing brings it into view.

    Coverage alone does not change while a view stays wholly hidden. So what is missing counts more
    by the angle (rad) by which the nearest hidden path misses the pad: the slope shows the way out.
    """
    hidden = 1 - views.value.coverage()
    by = jnp.min(jnp.where(views.margin < 0, -views.margin, jnp.inf), axis=-2)
    return hidden * (1 + jnp.where(jnp.isfinite(by), by, 0.0))


def best_resolution(
    views: Pieces, lengths: Float[Array, " pads"], places: Float[Array, " places"]
) -> Float[Array, "*poses pads places"]:
    """Resolution (px/mm) at places of each pad by the view that shows it best; 0 if none does.

    Args:
        views: pieces that are seen.
        lengths: of the pads, mm.
        places: pad coordinates, 0 to 1.
    """
    at = places.reshape((1,) * views.present.ndim + (-1,))
    return _best(views, lengths, at, (views.start[..., None] <= at) & (at <= views.end[..., None]))


def least_resolution(views: Pieces, lengths: Float[Array, " pads"]) -> Float[Array, "*poses pads"]:
    """Least of `best_resolution` (px/mm) over what is seen of each pad; `NO_VIEW` if nothing is.

    Along a piece it is least at an end; so it is asked for to either side of the ends of all
    pieces, where one view hands over to another, and, for crossings, at `PLACES` places.
    """

    def best(at: Array, inside: Array) -> Array:
        sharp = _best(views, lengths, at, inside)
        return jnp.where(sharp > 0, sharp, NO_VIEW)

    return _least(views, best)


def least_spare(
    views: Pieces, camera: Camera, lengths: Float[Array, " pads"]
) -> Float[Array, "sides *poses pads"]:
    """Angle between what is needed and either limit of the field of view, rad.

    By so much less field on that side nothing of a pad would be lost: at every place the view
    counts that is farthest from the limit, and of all places the one with least. First the side
    at which the image ends (clockwise from the axis), then the other. Places are those of
    `least_resolution`.

    A place divides the angle under which a piece is seen as in the triangle of the piece and the
    camera's image: exact for bare pads; behind layers at the ends of pieces alone.

    Args:
        views: pieces that are seen.
        camera: of the scene.
        lengths: of the pads, mm.
    """
    first, last = (camera.angle(views.pixels[..., i])[..., None] for i in (0, 1))
    near, far = (views.distance[..., i, None] ** 2 for i in (0, 1))
    there, start, end = (leaf[..., None] for leaf in (views.present, views.start, views.end))
    width = end - start
    square = (width * lengths.reshape((1,) * (views.start.ndim - 2) + (-1, 1, 1))) ** 2
    whole = (near + far - square) / 2
    height = safe_sqrt(near * far - whole * whole)
    field = camera.field_of_view

    def best(at: Array, inside: Array) -> Array:
        part = jnp.where(there, at - start, 0.0) / jnp.where(there, width, 1.0)
        dot = near + part * (whole - near)
        share, seen = safe_divide(jnp.arctan2(part * height, dot), jnp.arctan2(height, whole))
        angle = first + jnp.where(seen, share, part) * (last - first)
        spare = jnp.stack([field / 2 + angle, field / 2 - angle])
        return jnp.max(jnp.where(there & inside, spare, -jnp.inf), axis=-2)

    def bounded(at: Array, inside: Array) -> Array:
        found = best(at, inside)
        return jnp.where(jnp.isfinite(found), found, field)

    return _least(views, bounded)


def _least(views: Pieces, best: Callable[[Array, Array], Array]) -> Array:
    """Least over the places of pads of what the best view of each has.

    Args:
        views: pieces that are seen.
        best: of places, and of which pieces they are inside.
    """
    places = jnp.linspace(0.0, 1.0, PLACES, dtype=views.start.dtype)
    start, end = views.start[..., None], views.end[..., None]
    even = places.reshape((1,) * views.present.ndim + (-1,))
    found = [best(even, (start <= even) & (even <= end))]
    for ends in (views.start, views.end):
        at = ends[..., None, :]
        found.append(best(at, (start < at) & (at <= end)))
        found.append(best(at, (start <= at) & (at < end)))
    return jnp.min(jnp.stack([jnp.min(one, axis=-1) for one in found]), axis=0)


def _best(
    views: Pieces,
    lengths: Float[Array, " pads"],
    at: Float[Array, "*poses_pads_one places"],
    inside: Bool[Array, "*poses_pads_pieces places"],
) -> Float[Array, "*poses_pads places"]:
    """The best resolution at places of each pad, by the pieces that they are said to be inside of.

    For straight mirrors and an equidistant lens, resolution times squared distance is the same
    all along a piece of a bare pad, and the squared distance is a quadratic of the place (Stewart's
    theorem): both follow from a piece's ends. Of other lenses and behind layers the product is
    taken to change evenly from end to end, which is exact at the ends alone.
    """
    there, start, end = (leaf[..., None] for leaf in (views.present, views.start, views.end))
    inside = there & inside
    width = end - start
    part = jnp.where(inside, at - start, 0.0) / jnp.where(there, width, 1.0)
    first, last = (views.distance[..., i, None] ** 2 for i in (0, 1))
    along = width * lengths.reshape((1,) * (views.start.ndim - 2) + (-1, 1, 1))
    squared = first + part * (last - first) - part * (1 - part) * along * along
    near, far = (views.px_per_mm[..., i, None] * end for i, end in enumerate((first, last)))
    strength = near + part * (far - near)
    sharp = jnp.where(inside, strength / jnp.where(inside, squared, 1.0), 0.0)
    return jnp.max(sharp, axis=-2)


def pad_lengths(scene: Scene) -> Float[Array, " pads"]:
    """Lengths of the pads, mm."""
    along = scene.pads[:, 1] - scene.pads[:, 0]
    return jnp.sqrt(jnp.sum(along * along, axis=-1))
