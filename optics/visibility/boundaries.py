"""What bounds a view: lines that a ray to the pad must not cross, each linear along the pad.

From a (virtual) camera S, the part of a pad that is hidden by a segment AB, or seen through it, is
one interval: that where

    (A − S) × (P − S),   (P − S) × (B − S)   and   −(B − A) × (P − A),

all taken with the sign of (A − S) × (B − S), are positive. Each is linear along the pad, so its
values at the pad's two ends give the place where it vanishes as a quotient: there the line of sight
along an end of the segment, or the segment itself, meets the pad. Limits of the field of view and
of the grazing angle are linear conditions too.
"""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from designopt.numerics import safe_divide
from designopt.vectors import Vector, rotation, where
from optics.scene.camera import Camera
from optics.visibility import boundary_codes as codes
from optics.visibility.boundary_codes import LIMITS, PAD_ENDS, parts_of, with_kind
from optics.visibility.pads import Pad, Windows
from optics.visibility.unfolding import Unfolded, unit

PER_SEGMENT = 3
"""How many of the `conditions` are those of one segment."""


def conditions(
    camera: Camera, path: Unfolded, pad: Pad, segments: Vector
) -> Float[Array, "2 bounds"]:
    """Values at the pad's two ends of all that may bound a view.

    First the three numbers of segments, given by their ends, but for their common sign: the first
    ones of all, the second ones, the third ones. Then `LIMITS`, which are positive within a field
    of view below 180°, and where a ray is no flatter than the least grazing angle.
    """
    half, dtype = camera.field_of_view / 2, camera.field_of_view.dtype
    limits = path.axis[None].turned(rotation(jnp.stack([half, -half])))
    inward, towards = jnp.array([-1.0, 1.0], dtype), jnp.array([1.0, -1.0], dtype)
    # notation: where a ray meets the pad at s from the foot of the height h, tan(grazing) = h/|s|;
    # h and s in units of the pad's length.
    step, least = pad.end - pad.start, rotation(pad.grazing)
    h = jnp.abs(step.cross(path.source - pad.start))

    @jax.vmap
    def values(place: Vector) -> Float[Array, " bounds"]:
        ends, ray = segments - path.source, place - path.source
        beside = ends.cross(ray)
        behind = (ends[..., 1] - ends[..., 0]).cross(place - segments[..., 0])
        of_segments = [beside[..., 0], -beside[..., 1], -behind]
        inside = inward * limits.cross(ray[None])
        steep = h * least.x + towards * (step.dot(ray) * least.y)
        return jnp.concatenate([*(part.reshape(-1) for part in of_segments), inside, steep])

    return values(pad.ends())


class Bound(eqx.Module):
    """What bounds a piece: one of the `conditions`, or an end of what is seen.

    Attributes:
        row: which of those of one segment and of all else.
        ends: both ends of the segment, if it is one.
        labels: what these are.
    """

    row: Int[Array, "*bounds"]
    ends: Vector
    labels: Int[Array, "*bounds 2"]

    @classmethod
    def of(cls, paths: Unfolded, path: Int[Array, ""], bound: Int[Array, "*bounds"]) -> Bound:
        """From its index: of all segments on all legs, and of what follows."""
        segments = math.prod(paths.through.shape[1:])
        kind, segment = jnp.divmod(bound, segments)
        row = jnp.where(kind < PER_SEGMENT, kind, bound - PER_SEGMENT * (segments - 1))
        # Straight from all paths, so that not all segments of one are copied.
        every = jax.tree.map(
            lambda leaf: leaf.reshape(-1, 2), (paths.blockers.ends, paths.blockers.labels)
        )
        return cls(row, *jax.tree.map(lambda leaf: leaf[path * segments + segment], every))


def meeting(
    camera: Camera, path: Unfolded, pad: Pad, inner: Windows, bound: Bound
) -> Float[Array, ""]:
    """Where a bound meets the pad, or the outermost surface of its layers, or a clear end face.

    That is the coordinate along the surface, 0 at its start and 1 at its end.
    """
    first, last = conditions(camera, path, pad, bound.ends[None])
    at, _ = safe_divide(first, first - last)
    ends = [at, jnp.array([0.0, 1.0], at.dtype), *([] if inner is None else [inner.reshape(-1)])]
    return jnp.concatenate(ends)[bound.row]


def label_of_bound(pad: Pad, bound: Bound) -> Int[Array, ""]:
    """The label of a bound."""
    first, last = bound.labels[0], bound.labels[1]
    own = jnp.array(LIMITS[2:]), jnp.array(PAD_ENDS)
    if pad.cover is not None:
        own = pad.cover.flattest, pad.cover.edges, pad.cover.labels.reshape(-1)
    segment = jnp.stack([first, last, with_kind(first, codes.CROSSING)])
    return jnp.concatenate([segment, jnp.array(LIMITS[:2]), *own])[bound.row]


def toward(
    camera: Camera, path: Unfolded, pad: Pad, inner: Windows, label: Int[Array, ""]
) -> Vector:
    """From the source along the line of sight that a label stands for, of any length."""
    source, axis, step = path.source, path.axis, pad.end - pad.start
    leg, surface, kind = parts_of(jnp.maximum(label, 0))
    edges = jax.tree.map(lambda leaf: leaf[leg, surface], path.blockers)
    first, last = edges.ends[0], edges.ends[1]
    along = last - first
    met, _ = safe_divide(along.cross(pad.start - first), -along.cross(step))
    edge = where(edges.labels[0] == label, first, last)
    edge = where(kind == codes.CROSSING, pad.start + step.scaled(met), edge)

    low, high = LIMITS[2:] if pad.cover is None else pad.cover.flattest
    # The labels below 0 come in pairs, of which one has the sign 1.
    second = (label == codes.SECOND_PAD_END) | (label == codes.LEFT_LIMIT) | (label == high)
    sign = jnp.where(second, 1.0, -1.0).astype(source.x.dtype)
    half = rotation(camera.field_of_view / 2)
    limit = axis.scaled(half.x) + axis.perpendicular().scaled(sign * half.y)
    along_pad = unit(step)
    above = along_pad.cross(source - pad.start)
    drop = along_pad.perpendicular().scaled(-above * jnp.sin(pad.grazing))
    flattest = drop + along_pad.scaled(sign * jnp.abs(above) * jnp.cos(pad.grazing))
    end = where(second, pad.end, pad.start)
    if pad.cover is not None and inner is not None:
        labels = jnp.concatenate([pad.cover.edges, pad.cover.labels.reshape(-1)])
        end = _own_end(pad, inner, labels, label)
    end = where(label >= 0, edge, end)
    is_limit = (label == codes.LEFT_LIMIT) | (label == codes.RIGHT_LIMIT)
    is_grazing = (label == low) | (label == high)
    return where(is_limit, limit, where(is_grazing, flattest, end - source))


def _own_end(
    pad: Pad, inner: Float[Array, "rows 2"], labels: Int[Array, " ends"], label: Int[Array, ""]
) -> Vector:
    """Where the line of sight to an end of a layered pad meets the surface seen, or its line."""
    entries = jnp.concatenate([jnp.array([0.0, 1.0], inner.dtype), inner.reshape(-1)])
    return pad.start + (pad.end - pad.start).scaled(entries[jnp.argmax(labels == label)])
