"""Which parts of a pad one path shows, and what bounds them: found without derivatives.

From a (virtual) camera S, the part of a pad that is hidden by a segment AB, or seen through it, is
one interval: that where

    (A − S) × (P − S),   (P − S) × (B − S)   and   −(B − A) × (P − A),

all taken with the sign of (A − S) × (B − S), are positive. Each is linear along the pad, so its
values at the pad's two ends give the ends of the interval as quotients. Mirrors are such windows
and everything else casts such shadows; field of view and grazing angle are linear conditions too.
So nothing is sampled and nothing iterated.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from designopt.vectors import Vector, rotation
from optics.boundaries import Pad
from optics.camera import Camera
from optics.intervals import Interval, common_part, gaps
from optics.labels import (
    CROSSING,
    FIRST_PAD_END,
    HIGH_GRAZING,
    LEFT_LIMIT,
    LOW_GRAZING,
    RIGHT_LIMIT,
    SECOND_PAD_END,
    with_kind,
)
from optics.missing import angular_gap
from optics.unfolding import ROUNDING_UNITS, Edges, Unfolded, height, unit
from optics.views import ViewResult

SHORTEST_PIECE = 64
"""A piece no longer than so many units of rounding of the pad is rounding and not seen."""


class Verdict(eqx.Module):
    """How well one path shows one pad.

    Attributes:
        widest: the widest gap between what must not be met, in angles about the source.
        margin: its width, rad; negative where no line of sight is free.
        result: why nothing is seen.
    """

    widest: Interval
    margin: Float[Array, "*views"]
    result: ViewResult


def search(
    camera: Camera, path: Unfolded, pad: Pad
) -> tuple[Interval, Bool[Array, " gaps"], Verdict]:
    """One pad by one path.

    Returns:
        Candidates for pieces, which of them are there, and the verdict.
    """
    above = height(path.source, pad.start, unit(pad.end - pad.start))
    front = (above != 0) & (pad.side * above >= 0)
    turned_away = jnp.any(path.turned_away)
    window = _window(camera, path, pad, above)
    shadows, active = _shadows(camera, path, pad)
    pieces = gaps(window, shadows, active)
    pieces = Interval(
        pieces.start,
        pieces.end,
        _limit_met(path, pad, pieces.start, pieces.start_label),
        _limit_met(path, pad, pieces.end, pieces.end_label),
    )
    shortest = SHORTEST_PIECE * jnp.finfo(above.dtype).eps
    present = front & ~turned_away & (pieces.end - pieces.start > shortest)
    # The last shadow is what a field of view beyond 180° leaves out.
    outside = active[-1] & (shadows.start[-1] <= window.start) & (shadows.end[-1] >= window.end)
    looks = (window.end > window.start) & ~outside
    result = ViewResult.where(looks, ViewResult.blocked, ViewResult.missed)
    result = ViewResult.where(front, result, ViewResult.behind_pad)
    result = ViewResult.where(turned_away, ViewResult.behind_mirror, result)
    result = ViewResult.where(jnp.any(present), ViewResult.successful, result)
    widest = angular_gap(camera, path, pad, above)
    margin = widest.end - widest.start
    margin = jnp.where(above == 0, jnp.minimum(margin, 0.0), margin)
    return pieces, present, Verdict(widest, margin, result)


def _limit_met(
    path: Unfolded, pad: Pad, at: Float[Array, " gaps"], label: Int[Array, " gaps"]
) -> Int[Array, " gaps"]:
    """A label, and of the field of view's two limits the one on whose side the place lies.

    At half a turn both are one line, and which condition ends first is rounding.
    """
    step, toward = pad.end - pad.start, pad.start - path.source
    left = path.axis.cross(toward) + at * path.axis.cross(step) > 0
    is_limit = (label == LEFT_LIMIT) | (label == RIGHT_LIMIT)
    return jnp.where(is_limit, jnp.where(left, LEFT_LIMIT, RIGHT_LIMIT), label)


def _behind(
    edges: Edges, source: Vector, place: Vector
) -> tuple[Float[Array, "3 ..."], Bool[Array, "..."]]:
    """Three numbers that are all positive if a place lies behind segments, seen from a source.

    And which of the segments are seen edge-on, so that nothing lies behind them.
    """
    a, b, p = edges.starts - source, edges.ends - source, place - source
    cross = a.cross(b)
    rounding = ROUNDING_UNITS * jnp.finfo(cross.dtype).eps
    extent = (jnp.abs(a.x) + jnp.abs(a.y)) * (jnp.abs(b.x) + jnp.abs(b.y))
    ahead = [a.cross(p), p.cross(b), -(b - a).cross(place - edges.starts)]
    sign = jnp.sign(cross)
    return jnp.stack([sign * number for number in ahead]), jnp.abs(cross) <= rounding * extent


def _edge_labels(edges: Edges) -> Int[Array, "3 ..."]:
    crossing = with_kind(edges.start_labels, CROSSING)
    return jnp.stack([edges.start_labels, edges.end_labels, crossing])


def _limits(camera: Camera, path: Unfolded, arrow: Vector) -> Float[Array, "2"]:
    """Two numbers that are both positive if an arrow lies within a field of view below 180°."""
    half = camera.field_of_view / 2
    right, left = path.axis.turned(rotation(-half)), path.axis.turned(rotation(half))
    return jnp.stack([right.cross(arrow), arrow.cross(left)])


_PAD_ENDS = (FIRST_PAD_END, SECOND_PAD_END)
_LIMITS = (RIGHT_LIMIT, LEFT_LIMIT)


def _window(camera: Camera, path: Unfolded, pad: Pad, above: Float[Array, ""]) -> Interval:
    """The part of a pad that field of view, grazing angle and mirrors let through."""
    along = unit(pad.end - pad.start)
    # notation: where a ray meets the pad at s from the foot of the height h, tan(grazing) = h/|s|.
    h, sine, cosine = jnp.abs(above), jnp.sin(pad.grazing), jnp.cos(pad.grazing)
    wide = camera.field_of_view > jnp.pi

    @jax.vmap
    def conditions(place: Vector) -> Float[Array, " conditions"]:
        arrow = place - path.source
        s = along.dot(arrow)
        limits = jnp.where(wide, 1.0, _limits(camera, path, arrow))
        grazing = jnp.stack([h * cosine + s * sine, h * cosine - s * sine])
        through, edge_on = _behind(path.mirrors, path.source, place)
        through = jnp.where((edge_on | ~path.mirrors.active)[None], -1.0, through)
        through = jnp.where(path.reflects[None], through, 1.0)
        return jnp.concatenate([limits, grazing, through.reshape(-1)])

    labels = jnp.concatenate(
        [jnp.array([*_LIMITS, LOW_GRAZING, HIGH_GRAZING]), _edge_labels(path.mirrors).reshape(-1)]
    )
    at_start, at_end = conditions(pad.ends())
    return common_part(at_start, at_end, labels, _PAD_ENDS)


def _shadows(camera: Camera, path: Unfolded, pad: Pad) -> tuple[Interval, Bool[Array, " shadows"]]:
    """The parts of a pad that surfaces hide, and what a field of view beyond 180° leaves out."""
    blockers = path.blockers
    behind = jax.vmap(lambda place: _behind(blockers, path.source, place), out_axes=(0, None))
    (at_start, at_end), edge_on = behind(pad.ends())
    hidden = common_part(at_start, at_end, _edge_labels(blockers), _PAD_ENDS)
    active = path.in_the_way(pad.index) & ~edge_on & (hidden.start < hidden.end)
    limits = jax.vmap(lambda place: -_limits(camera, path, place - path.source))
    at_start, at_end = limits(pad.ends())
    outside = common_part(at_start, at_end, jnp.array(_LIMITS), _PAD_ENDS)
    beyond = (camera.field_of_view > jnp.pi) & (outside.start < outside.end)
    shadows = jax.tree.map(lambda many, one: jnp.append(many, one), hidden, outside)
    return shadows, jnp.append(active, beyond)
