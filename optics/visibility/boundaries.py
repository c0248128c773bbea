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

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from designopt.numerics import safe_divide
from designopt.vectors import Vector, rotation, stack, where
from optics.scene.camera import Camera
from optics.visibility import boundary_codes as codes
from optics.visibility.boundary_codes import parts_of, with_kind
from optics.visibility.pads import LIMITS, PAD_ENDS, Pad, Windows
from optics.visibility.sliding import LAST
from optics.visibility.unfolding import Unfolded, left_of, legs_of, unit

PER_SEGMENT = 3
"""How many of the `conditions` are those of one segment."""


def conditions(camera: Camera, path: Unfolded, pad: Pad) -> Float[Array, "2 bounds"]:
    """Values at the pad's two ends of all that may bound a view.

    First the three numbers of the segments, but for their common sign: the first ones of all
    segments on all legs, the second ones, the third ones. Then `LIMITS`, which are positive within
    a field of view below 180°, and where a ray is no flatter than the least grazing angle.
    """
    half, dtype = camera.field_of_view / 2, camera.field_of_view.dtype
    limits = path.axis[None].turned(rotation(jnp.stack([half, -half])))
    inward, towards = jnp.array([-1.0, 1.0], dtype), jnp.array([1.0, -1.0], dtype)
    # notation: where a ray meets the pad at s from the foot of the height h, tan(grazing) = h/|s|;
    # h and s in units of the pad's length.
    step, least = pad.end - pad.start, rotation(pad.grazing)
    slide = path.slide
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
        past, ray = path.past(), place - path.source
        beside = past.arrow.cross(ray if slide is None else place - past.start)
        segment = path.blockers.ends if slide is not None else past.arrow
        behind = (segment[..., 1] - segment[..., 0]).cross(place - path.blockers.ends[..., 0])
        if path.sheets:
            # What a ray passes before its last mirror lies before the pad.
            before = legs_of(path.blockers)[..., 0] < jnp.sum(path.reflects)
            behind = jnp.where(before, past.arrow[..., 1].cross(past.arrow[..., 0]), behind)
        segments = [beside[..., 0], -beside[..., 1], -behind]
        if arrow is None or eyes is None or bounds is None:
            inside = inward * limits.cross(ray[None])
        else:
            inside = inward * limits.cross(where(bounds, place - eyes, arrow[None]))
        along = step.dot(ray if flat is None else place - flat)
        steep = h * least.x + towards * (along * least.y)
        return jnp.concatenate([*(part.reshape(-1) for part in segments), inside, steep])

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


def meetings(
    camera: Camera, path: Unfolded, pad: Pad, inner: Windows = None
) -> Float[Array, " bounds"]:
    """Where all that may bound a view meets the pad, or the outermost surface of its layers.

    That is of `conditions`, the surface's own ends, and what lines of sight may pass at the lower
    side of every layer: the coordinate along the surface, 0 at its start and 1 at its end.
    """
    first, last = conditions(camera, path, pad)
    at, _ = safe_divide(first, first - last)
    ends = jnp.array([0.0, 1.0], at.dtype)
    if inner is None:
        return jnp.concatenate([at, ends])
    return jnp.concatenate([at, ends, inner.reshape(-1)])


def labels_of(path: Unfolded, pad: Pad) -> Int[Array, " bounds"]:
    """Labels of all `meetings`."""
    first, last = path.blockers.labels[..., 0], path.blockers.labels[..., 1]
    segments = jnp.stack([first, last, with_kind(first, codes.CROSSING)]).reshape(-1)
    if pad.cover is None:
        return jnp.concatenate([segments, jnp.array([*LIMITS, *PAD_ENDS])])
    own = pad.cover.flattest, pad.cover.edges, pad.cover.labels.reshape(-1)
    return jnp.concatenate([segments, jnp.array(LIMITS[:2]), *own])


def toward(
    camera: Camera, path: Unfolded, pad: Pad, inner: Windows, label: Int[Array, ""]
) -> Vector:
    """Along the line of sight that a label stands for, of any length."""
    axis, step = path.axis, pad.end - pad.start
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
    sign = jnp.where(second, 1.0, -1.0).astype(step.x.dtype)
    half = rotation(camera.field_of_view / 2)
    limit = axis.scaled(half.x) + axis.perpendicular().scaled(sign * half.y)
    along_pad = unit(step)
    above = along_pad.cross(path.eye(pad.start, pad.end) - pad.start)
    drop = along_pad.perpendicular().scaled(-above * jnp.sin(pad.grazing))
    flattest = drop + along_pad.scaled(sign * jnp.abs(above) * jnp.cos(pad.grazing))
    end = where(second, pad.end, pad.start)
    if pad.cover is not None and inner is not None:
        labels = jnp.concatenate([pad.cover.edges, pad.cover.labels.reshape(-1)])
        end = _own_end(pad, inner, labels, label)
    end = where(label >= 0, edge, end)
    is_limit = (label == codes.LEFT_LIMIT) | (label == codes.RIGHT_LIMIT)
    is_grazing = (label == low) | (label == high)
    sought = path.to(end, jnp.where(label >= 0, leg, LAST) if path.sheets else LAST).arrow
    return where(is_limit, limit, where(is_grazing, flattest, sought))


def _own_end(
    pad: Pad, inner: Float[Array, "rows 2"], labels: Int[Array, " ends"], label: Int[Array, ""]
) -> Vector:
    """Where the line of sight to an end of a layered pad meets the surface seen, or its line."""
    entries = jnp.concatenate([jnp.array([0.0, 1.0], inner.dtype), inner.reshape(-1)])
    return pad.start + (pad.end - pad.start).scaled(entries[jnp.argmax(labels == label)])
