"""Lines of sight that end behind the layers of a pad, wherever each of them comes from.

Where rays slide (`optics.visibility.sliding`) the source of a ray that is sought by what it meets
behind layers is not known beforehand: both are found together. A face is both ends of the surface
that is seen, and entries are coordinates on it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_divide
from designopt.vectors import Vector, rotation
from optics.visibility.refraction import Cover, Scale
from optics.visibility.sliding import Slide, settle
from optics.visibility.unfolding import Unfolded


def windows(path: Unfolded, cover: Cover, face: Vector) -> Float[Array, "rows 2"]:
    """Entries of the rays to both ends of what may be passed behind the surface seen."""
    if path.slide is None:
        return cover.windows(face, path.source)
    given, count = (cover, face), 2 * cover.rows
    met = _settled(path.slide, lambda of, eye, row: of[0].window(of[1], eye, row), given, count)
    return met.reshape(-1, 2)


def entries_of(
    path: Unfolded, cover: Cover, face: Vector, coordinates: Float[Array, " points"]
) -> Float[Array, " points"]:
    """Entries of the rays that reach given pad coordinates."""
    if path.slide is None:
        return cover.entries(face, path.source, coordinates)

    def reach(given: Any, eye: Vector, index: Array) -> Array:
        cover, face, coordinates = given
        return cover.entries(face, eye, coordinates[index][None])[0]

    return _settled(path.slide, reach, (cover, face, coordinates), coordinates.size)


def coordinates(
    path: Unfolded, cover: Cover, face: Vector, entries: Float[Array, " points"]
) -> Float[Array, " points"]:
    """Pad coordinates that rays reach, from their entries."""
    if path.slide is None:
        return cover.coordinate(face, path.source, entries)
    return jax.vmap(lambda eye, entry: cover.coordinate(face, eye, entry[None])[0])(
        path.to(_places(face, entries)).start, entries
    )


def scales(
    path: Unfolded, cover: Cover | None, face: Vector, entries: Float[Array, " points"]
) -> Scale | None:
    """How large and how far places appear, from the entries of the rays to them.

    Layers on mirrors count for the radius of curvature by their image across the section. ``None``
    if neither layers nor where rays come from make any difference.
    """
    slide = path.slide
    if slide is None:
        return None if cover is None else cover.scale(face, path.source, entries)
    step, rays = face[1] - face[0], slide.rays_to(_places(face, entries))

    def met(angle: Float[Array, ""]) -> Float[Array, ""]:
        """Where along the pad the ray in a direction meets it."""
        ray = rotation(angle)
        eye = slide.source(ray)
        entry, _ = safe_divide((face[0] - eye).cross(ray), ray.cross(step))
        if cover is None:
            return entry * step.length()
        return cover.coordinate(face, eye, entry[None])[0] * cover.length

    def rise(angle: Float[Array, ""]) -> Float[Array, ""]:
        return jnp.abs(jax.jvp(met, (angle,), (jnp.ones_like(angle),))[1])

    slopes = jax.vmap(rise)(rays.arrow.angle())
    scale, _ = safe_divide(jnp.ones_like(slopes), slopes)
    longer = slide.longer(rays.arrow)
    if cover is None:
        way = rays.arrow.length()
        return Scale(scale, way + longer, None if slide.thickness is None else way)

    def behind(eye: Vector, entry: Float[Array, ""]) -> Any:
        return jax.tree.map(lambda number: number[0], cover.scale(face, eye, entry[None]))

    of_rays = jax.vmap(behind)(rays.start, entries)
    return Scale(scale, of_rays.way + longer, of_rays.apparent)


def _places(face: Vector, entries: Float[Array, "..."]) -> Vector:
    return face[0] + (face[1] - face[0]).scaled(entries)


def _settled(
    slide: Slide, reach: Callable[[Any, Vector, Array], Array], given: Any, count: int
) -> Float[Array, " entries"]:
    """Entries that ``reach(given, source, index)`` gives, each for the source of its own ray.

    The second of what is given is the face.
    """

    def each(given: Any, eyes: Vector) -> Float[Array, " entries"]:
        return jax.vmap(partial(reach, given))(eyes, jnp.arange(count))

    def move(both: tuple[Slide, Any], eyes: Vector) -> Vector:
        slide, given = both
        return slide.source(_places(given[1], each(given, eyes)) - eyes)

    nominal = jax.tree.map(lambda leaf: jnp.full(count, leaf), slide.start)
    return each(given, settle(move, (slide, given), nominal))
