"""How points of a pad appear by a path: where they are imaged, how large, and by which mirrors."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from designopt.numerics import safe_arctan2, safe_divide
from designopt.vectors import Vector
from optics.scene.camera import Camera
from optics.visibility.boundaries import Pad
from optics.visibility.refraction import length_of, rise_of
from optics.visibility.unfolding import Unfolded, unit


def look(
    camera: Camera,
    size: Float[Array, ""],
    path: Unfolded,
    pad: Pad,
    entries: Float[Array, " points"],
) -> tuple[Float[Array, " points"], Float[Array, " points"], Float[Array, " points"]]:
    """How points of a pad appear by a path: pixel, pixels per mm along the pad, distance in mm.

    ``entries`` are coordinates on the surface that is seen, where there are layers the outermost
    (`entry`); ``size`` is the placed scene's unit of length, mm. The angle dθ under which a length
    ds appears is sin(grazing angle) ds / distance, that is the height of the source above the pad's
    line over the squared distance; behind layers the slope w = tan θ from the pad's normal gives
    dθ/ds = 1 / ((1 + w²) dx/dw), with x of `optics.visibility.refraction`.
    """
    source, axis = path.source, path.axis
    step, toward = pad.end - pad.start, pad.start - source
    arrow = Vector(toward.x + entries * step.x, toward.y + entries * step.y)
    across = axis.x * arrow.y - axis.y * arrow.x
    angle = safe_arctan2(across, axis.x * arrow.x + axis.y * arrow.y)
    # Beyond the seam of a camera that looks all around, pixels are counted on.
    middle = jax.lax.stop_gradient(toward + step.scaled((entries[0] + entries[-1]) / 2))
    center = safe_arctan2(axis.cross(middle), axis.dot(middle))
    turns = jax.lax.stop_gradient(jnp.round((angle - center) / (2 * jnp.pi)))
    angle = path.handedness() * (angle - 2 * jnp.pi * turns)
    if pad.cover is None:
        above = jnp.abs(unit(step).cross(toward))
        per_size, _ = safe_divide(jnp.full_like(across, above), arrow.squared())
        distance = arrow.length()
    else:
        slope, height, _ = _slope_at(source, pad, entries)
        layers = pad.cover.stack
        rise = rise_of(height, layers.thickness, layers.index, slope)
        per_size, _ = safe_divide(1 / (1 + slope**2), rise)
        distance = length_of(height, layers.thickness, layers.index, slope)
    per_mm = camera.pixels_per_radian(angle) * per_size / size
    return camera.pixel(angle), per_mm, distance * size


def _slope_at(
    source: Vector, pad: Pad, entries: Float[Array, " points"]
) -> tuple[Float[Array, " points"], Float[Array, ""], Float[Array, ""]]:
    """Slopes of the rays that enter the outermost layer, height and foot of their source."""
    height, foot = pad.seen_from(source)
    length = (pad.end - pad.start).length()
    slope, _ = safe_divide(entries * length - foot, jnp.broadcast_to(height, entries.shape))
    return slope, height, foot


def membrane(
    source: Vector, pad: Pad, entries: Float[Array, " points"]
) -> Float[Array, " points"]:
    """Pad coordinates that rays reach through the layers, from where they enter the outermost."""
    slope, height, foot = _slope_at(source, pad, entries)
    return pad.cover.stack.coordinate(height, foot, slope)


def entry(
    source: Vector, pad: Pad, coordinates: Float[Array, " points"]
) -> Float[Array, " points"]:
    """Where on the surface that is seen rays enter that reach a pad at given coordinates."""
    if pad.cover is None:
        return coordinates
    height, foot = pad.seen_from(source)
    place = foot + height * pad.cover.stack.slope(height, foot, coordinates)
    length = (pad.end - pad.start).length()
    return safe_divide(place, jnp.broadcast_to(length, place.shape))[0]


def reflections(
    path: Unfolded, pad: Pad, entries: Float[Array, " points"]
) -> Float[Array, "reflections points"]:
    """Where on each mirror of a path the rays to points of the surface seen are reflected."""
    arrow = (pad.end - pad.start).scaled(entries) + (pad.start - path.source)

    def on(mirror: Vector, reflects: Bool[Array, ""]) -> Float[Array, " points"]:
        first, along = mirror[0] - path.source, mirror[1] - mirror[0]
        at, _ = safe_divide(first.cross(arrow), arrow.cross(along))
        return jnp.where(reflects, at, 0.0)

    return jax.vmap(on)(path.whole, path.reflects)
