"""How points of a pad appear by a path: where they are imaged, how large, and by which mirrors."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from designopt.numerics import safe_arctan2, safe_divide
from designopt.vectors import Vector
from optics.scene.camera import Camera
from optics.visibility.pads import Pad
from optics.visibility.refraction import Scale
from optics.visibility.unfolding import Unfolded, unit


class Appearance(NamedTuple):
    """How points of a pad appear.

    Attributes:
        pixel: where they are imaged.
        px_per_mm: along the pad.
        distance: length of the ray, mm.
        apparent: distance from which rays seem to come, mm; ``None`` where no pad
            or mirror has layers.
    """

    pixel: Float[Array, " points"]
    px_per_mm: Float[Array, " points"]
    distance: Float[Array, " points"]
    apparent: Float[Array, " points"] | None


def look(
    camera: Camera,
    size: Float[Array, ""],
    path: Unfolded,
    pad: Pad,
    entries: Float[Array, " points"],
    scale: Scale | None,
) -> Appearance:
    """How points of a pad appear by a path.

    ``entries`` are coordinates on the surface that is seen, where there are layers the outermost
    one or a clear end face, and ``scale`` are the `lines_of_sight.scales` at these; ``size`` is the
    placed scene's unit of length, mm. The angle dθ under which a length ds appears is
    sin(grazing angle) ds / distance, that is the height of the source above the pad's line over the
    squared distance; for layers see `optics.visibility.refraction`.
    """
    axis, step, toward = path.axis, pad.end - pad.start, pad.start - path.source
    arrow = Vector(toward.x + entries * step.x, toward.y + entries * step.y)
    if path.slide is not None:
        arrow = path.to(pad.start + step.scaled(entries)).arrow
    across = axis.x * arrow.y - axis.y * arrow.x
    angle = safe_arctan2(across, axis.x * arrow.x + axis.y * arrow.y)
    # Beyond the seam of a camera that looks all around, pixels are counted on.
    middle = jax.lax.stop_gradient(toward + step.scaled((entries[0] + entries[-1]) / 2))
    center = safe_arctan2(axis.cross(middle), axis.dot(middle))
    turns = jax.lax.stop_gradient(jnp.round((angle - center) / (2 * jnp.pi)))
    angle = path.handedness() * (angle - 2 * jnp.pi * turns)
    if scale is None:
        above = jnp.abs(unit(step).cross(toward))
        per_size, _ = safe_divide(jnp.full_like(across, above), arrow.squared())
        distance, near = arrow.length(), None
    else:
        per_size, distance, near = scale
    apparent = None if near is None else near * size
    per_mm = camera.pixels_per_radian(angle) * per_size / size
    return Appearance(camera.pixel(angle), per_mm, distance * size, apparent)


def reflections(
    path: Unfolded, pad: Pad, entries: Float[Array, " points"]
) -> Float[Array, "reflections points"]:
    """Where on each mirror of a path the rays to points of the surface seen are reflected."""
    step, source = (pad.end - pad.start).scaled(entries), path.source
    if path.slide is None:
        arrow = step + (pad.start - source)
    else:
        arrow, source = path.slide.rays_to(pad.start + step)

    def on(mirror: Vector, reflects: Bool[Array, ""], source: Vector) -> Float[Array, " points"]:
        first, along = mirror[0] - source, mirror[1] - mirror[0]
        at, _ = safe_divide(first.cross(arrow), arrow.cross(along))
        return jnp.where(reflects, at, 0.0)

    if path.slide is None or not path.sheets:
        return jax.vmap(on, (0, 0, None))(path.whole, path.reflects, source)
    # At the coat: in the middle between where the ray enters and leaves.
    found = []
    for i in range(len(path.reflects)):
        ways = [path.slide.source(arrow, leg=leg) for leg in (i, i + 1)]
        found.append(sum(on(path.whole[i], path.reflects[i], way) for way in ways) / 2)
    return jnp.stack(found)
