"""How far apart two outlines of a linkage are: convex polygons and what is rounded around them.

An outline is the convex hull of a few points with a rounding: a pin is a point, a bar a segment, a
ternary plate a triangle, each with the radius of its rounding. What lies between two outlines is
the distance of their hulls less both radii.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_divide, safe_sqrt
from designopt.vectors import Vector


def find_separation(
    first: Float[Array, "*one first 2"], second: Float[Array, "*other second 2"]
) -> Float[Array, "..."]:
    """Signed distance of two convex hulls, in the unit of their corners.

    Positive it is their distance; where they overlap it is negative: the shortest way that takes
    them apart, which is along a normal of an edge (separating axis theorem). It is exact, without
    iteration, and its slope is that of the corner and the edge that decide.

    Args:
        first: corners of one hull, one after the other if these are more than three.
        second: of the other; the batches broadcast.

    Source: C. Ericson, *Real-Time Collision Detection* (2005), chapters 5.1.2 and 5.2.1.

    Example:
        >>> bar, pin = jnp.array([[0.0, 0.0], [4.0, 0.0]]), jnp.array([[7.0, 4.0]])
        >>> float(find_separation(bar, pin))
        5.0
    """
    batch = jnp.broadcast_shapes(first.shape[:-2], second.shape[:-2])
    first, second = (jnp.broadcast_to(part, (*batch, *part.shape[-2:])) for part in (first, second))
    found = [_at_edges(first, second), _at_edges(second, first)]
    square = _least(jnp.stack([one for one, _ in found], axis=-1))
    gap = -_least(-jnp.stack([one for _, one in found], axis=-1))
    overlaps = jnp.isfinite(gap) & (gap < 0)
    return jnp.where(overlaps, gap, safe_sqrt(jnp.where(overlaps, 0.0, square)))


def _at_edges(
    hull: Float[Array, "... hull 2"], corners: Float[Array, "... corners 2"]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Least squared distance of corners from edges, and largest gap along an edge's normal.

    A point counts as an edge without a normal, whose gap is −∞.
    """
    count = hull.shape[-2]
    edges = 1 if count == 2 else count
    x, y = hull[..., 0], hull[..., 1]
    start = Vector(x[..., :edges, None], y[..., :edges, None])
    ends = Vector(*(jnp.roll(part, -1, axis=-1)[..., :edges, None] for part in (x, y)))
    step, own = ends - start, Vector(x[..., None, :], y[..., None, :]) - start
    other = Vector(corners[..., None, :, 0], corners[..., None, :, 1]) - start
    along, _ = safe_divide(other.dot(step), step.squared())
    away = other - step.scaled(jnp.clip(along, 0.0, 1.0))
    square = _least(away.squared().reshape(*away.x.shape[:-2], -1))

    length = step.length()[..., 0]
    across, inside = step.cross(other), step.cross(own)
    left, right = _least(across) + _least(-inside), _least(inside) + _least(-across)
    gap, has_normal = safe_divide(jnp.maximum(left, right), length)
    return square, -_least(jnp.where(has_normal, -gap, jnp.inf))


def _least(values: Float[Array, "*batch many"]) -> Float[Array, "*batch"]:
    """The least of several values, with the slope of one of them.

    Two corners that are nearest are found from both hulls, and from either edge of each: values
    that are the same but for rounding. `jnp.min` gives their slope up to twice, or NaN if its
    program rounds them otherwise where it compares them with the least, so that none is.
    """
    first = jax.nn.one_hot(jnp.argmin(values, axis=-1), values.shape[-1], dtype=bool)
    return jnp.sum(jnp.where(first, values, 0.0), axis=-1)
