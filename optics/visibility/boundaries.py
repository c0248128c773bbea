"""What bounds a view: lines that a ray to the pad must not cross, each linear along the pad.

From a (virtual) camera S, the part of a pad that is hidden by a segment AB, or seen through it, is
one interval: that where

    (A − S) × (P − S),   (P − S) × (B − S)   and   −(B − A) × (P − A),

all taken with the sign of (A − S) × (B − S), are positive. Each is linear along the pad, so its
values at the pad's two ends give the place where it vanishes as a quotient: there the line of sight
along an end of the segment, or the segment itself, meets the pad. Limits of the field of view and
of the grazing angle are linear conditions too. Where rays slide (`optics.visibility.sliding`) the
ray past A comes from a place S(A) of its own, which takes the place of S.
"""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_divide
from designopt.vectors import Vector, rotation, stack, where
from optics.scene.camera import Camera
from optics.visibility import boundary_codes as codes
from optics.visibility.boundary_codes import LIMITS, parts_of, with_kind
from optics.visibility.pads import Pad, Windows
from optics.visibility.sliding import LAST, Rays
from optics.visibility.unfolding import Unfolded, left_of, unit

PER_SEGMENT = 3
"""How many of the `conditions` are those of one segment."""


class Segments(eqx.Module):
    """Segments that may bound a view of a pad by a path.

    Attributes:
        ends: both ends.
        past: the rays past them.
        before: whether they lie on a leg before the last one; ``None`` where rays come from one
            place on all legs.
    """

    ends: Vector
    past: Rays
    before: Bool[Array, "..."] | None

    @classmethod
    def all_of(cls, path: Unfolded) -> Segments:
        """All surfaces on all legs."""
        before = None
        if path.sheets:
            before = jnp.arange(len(path.blockers.active))[:, None] < jnp.sum(path.reflects)
        return cls(path.blockers.ends, path.past(), before)


def conditions(
    camera: Camera, path: Unfolded, pad: Pad, segments: Segments
) -> Float[Array, "2 bounds"]:
    """Values at the pad's two ends of all that may bound a view.

    First the three numbers of segments, but for their common sign: the first ones of all, the
    second ones, the third ones. Then `LIMITS`, which are positive within a field of view below
    180°, and where a ray is no flatter than the least grazing angle.
    """
    half, dtype = camera.field_of_view / 2, camera.field_of_view.dtype
    limits = path.axis[None].turned(rotation(jnp.stack([half, -half])))
    inward, towards = jnp.array([-1.0, 1.0], dtype), jnp.array([1.0, -1.0], dtype)
    # notation: where a ray meets the pad at s from the foot of the height h, tan(grazing) = h/|s|;
    # h and s in units of the pad's length.
    step, least = pad.end - pad.start, rotation(pad.grazing)
    slide, past = path.slide, segments.past
    if slide is not None:
        eyes, rays, sense = slide.source(limits), flattest_rays(path, pad), sense_of(path, pad)
        # What bounds nothing of the pad need not come from anywhere near the rays to it: flatter
        # rays, and a limit of the field of view with both ends on one side.
        ends = path.to(pad.ends())
        steeper = sense * towards * rays.cross(ends.arrow) > 0
        flat = where(steeper, ends.start, slide.source(rays))
        h, arrows = sense * step.cross(flat - pad.start), ends.arrow
        bounds = limits.cross(arrows[0][None]) * limits.cross(arrows[1][None]) < 0
    else:
        eyes = flat = arrows = bounds = None
        h = jnp.abs(step.cross(path.source - pad.start))

    @jax.vmap
    def values(place: Vector, arrow: Vector | None) -> Float[Array, " bounds"]:
        ray, (first, last) = place - path.source, (past.arrow[..., 0], past.arrow[..., 1])
        beside = past.arrow.cross(ray if slide is None else place - past.start)
        along = last - first if slide is None else segments.ends[..., 1] - segments.ends[..., 0]
        behind = along.cross(place - segments.ends[..., 0])
        if segments.before is not None:
            # What a ray passes before its last mirror lies before the pad.
            behind = jnp.where(segments.before, last.cross(first), behind)
        of_segments = [beside[..., 0], -beside[..., 1], -behind]
        if arrow is None or eyes is None or bounds is None:
            inside = inward * limits.cross(ray[None])
        else:
            inside = inward * limits.cross(where(bounds, place - eyes, arrow[None]))
        along_pad = step.dot(ray if flat is None else place - flat)
        steep = h * least.x + towards * (along_pad * least.y)
        return jnp.concatenate([*(part.reshape(-1) for part in of_segments), inside, steep])

    return values(pad.ends(), arrows)


def sense_of(path: Unfolded, pad: Pad) -> Float[Array, ""]:
    """1 if rays to a pad come from its left, −1 if they come from its right."""
    step = pad.end - pad.start
    above = left_of(path.eye(pad.start, pad.end), pad.start, step)
    return jnp.where(above < 0, -1.0, 1.0).astype(step.x.dtype)


def flattest_rays(path: Unfolded, pad: Pad) -> Vector:
    """Unit vectors of the flattest rays towards both ends of a pad."""
    along = unit(pad.end - pad.start)
    drop = along.perpendicular().scaled(-sense_of(path, pad) * jnp.sin(pad.grazing))
    forth = along.scaled(jnp.cos(pad.grazing))
    return stack(drop - forth, drop + forth)


class Bound(eqx.Module):
    """What bounds a piece: one of the `conditions`, or an end of what is seen.

    Attributes:
        row: which of those of one segment and of all else.
        segment: the segment, if it is one.
        labels: what its ends are.
    """

    row: Int[Array, "*bounds"]
    segment: Segments
    labels: Int[Array, "*bounds 2"]

    @classmethod
    def of(
        cls,
        paths: Unfolded,
        path: Int[Array, ""],
        by: Unfolded,
        bound: Int[Array, "*bounds"],
    ) -> Bound:
        """From its index, by one of all paths: of all segments on all legs, and of what follows."""
        segments = math.prod(paths.through.shape[1:])
        kind, segment = jnp.divmod(bound, segments)
        row = jnp.where(kind < PER_SEGMENT, kind, bound - PER_SEGMENT * (segments - 1))
        # Straight from all paths, so that not all segments of one are copied.
        of_all = paths.blockers.ends, paths.blockers.labels, paths.sliding
        ends, labels, past = jax.tree.map(
            lambda leaf: leaf.reshape(-1, 2)[path * segments + segment], of_all
        )
        before = None
        if paths.sheets:
            before = segment // paths.through.shape[2] < jnp.sum(by.reflects)
        past = past or Rays(ends - by.source, by.source)
        return cls(row, Segments(ends, past, before), labels)


def meeting(
    camera: Camera, path: Unfolded, pad: Pad, inner: Windows, bound: Bound
) -> Float[Array, ""]:
    """Where a bound meets the pad, or the outermost surface of its layers, or a clear end face.

    That is the coordinate along the surface, 0 at its start and 1 at its end.
    """
    first, last = conditions(camera, path, pad, bound.segment)
    at, _ = safe_divide(first, first - last)
    ends = [at, jnp.array([0.0, 1.0], at.dtype), inner.reshape(-1)]
    return jnp.concatenate(ends)[bound.row]


def label_of_bound(pad: Pad, bound: Bound) -> Int[Array, ""]:
    """The label of a bound."""
    first, last = bound.labels[0], bound.labels[1]
    own = pad.flattest, pad.edges, pad.labels.reshape(-1)
    segment = jnp.stack([first, last, with_kind(first, codes.CROSSING)])
    return jnp.concatenate([segment, jnp.array(LIMITS[:2]), *own])[bound.row]


def toward(
    camera: Camera, path: Unfolded, pad: Pad, inner: Windows, label: Int[Array, ""]
) -> Vector:
    """Along the line of sight of a label, of any length."""
    axis, step = path.axis, pad.end - pad.start
    leg, surface, kind = parts_of(jnp.maximum(label, 0))
    edges = jax.tree.map(lambda leaf: leaf[leg, path.solids.place(surface)], path.blockers)
    first, last = edges.ends[0], edges.ends[1]
    along = last - first
    met, _ = safe_divide(along.cross(pad.start - first), -along.cross(step))
    edge = where(edges.labels[0] == label, first, last)
    edge = where(kind == codes.CROSSING, pad.start + step.scaled(met), edge)

    low, high = pad.flattest
    # The labels below 0 come in pairs, of which one has the sign 1.
    second = (label == pad.edges[1]) | (label == codes.LEFT_LIMIT) | (label == high)
    sign = jnp.where(second, 1.0, -1.0).astype(step.x.dtype)
    half = rotation(camera.field_of_view / 2)
    limit = axis.scaled(half.x) + axis.perpendicular().scaled(sign * half.y)
    along_pad = unit(step)
    above = along_pad.cross(path.eye(pad.start, pad.end) - pad.start)
    drop = along_pad.perpendicular().scaled(-above * jnp.sin(pad.grazing))
    flattest = drop + along_pad.scaled(sign * jnp.abs(above) * jnp.cos(pad.grazing))
    end = where(second, pad.end, pad.start)
    if pad.labels.size:
        # Where the line of sight to what is behind layers meets the surface seen, or its line.
        row = codes.WINDOWS - label
        entry = inner.reshape(-1)[jnp.maximum(row, 0)]
        end = where(row >= 0, pad.start + step.scaled(entry), end)
    end = where(label >= 0, edge, end)
    is_limit = (label == codes.LEFT_LIMIT) | (label == codes.RIGHT_LIMIT)
    is_grazing = (label == low) | (label == high)
    sought = path.to(end, jnp.where(label >= 0, leg, LAST) if path.sheets else LAST).arrow
    return where(is_limit, limit, where(is_grazing, flattest, sought))
