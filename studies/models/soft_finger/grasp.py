"""A bottle between the palm and a finger: the bend from its diameter, and back.

A hand of our own, for paper A (Fig. 13) gives photographs only. In the plane in which the finger
bends, its centre line starts at the origin along z and bends towards x, an arc of constant
curvature κ. A bottle is a circle that touches the palm, the line z = gap, at x = palm. The finger
is closed until its skin, a finger's radius off its centre line, touches the bottle.

A circle of radius q has its centre at (palm, gap + q), and touches the skin about a point (x, z)
of the centre line where their distance is q + r, r being the finger's radius, so that

    q = ((x − palm)² + (z − gap)² − r²) / (2 (r + z − gap)).

All these circles touch the palm at one point: a wider one encloses a narrower one, and the bottle
that the finger touches is the least over its centre line. About points between its ends the line
passes through the nearest one at a right angle, whence, with the whole circle of the arc,

    q = (2 (palm − r) − κ (palm² + gap² − r²)) / (2 (1 + κ (gap − r))).

Where that point would lie beyond the finger, the bottle touches its tip.
"""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt import Solution, combine_checks, find_root, safe_arctan2
from optics.chamber import bend_center_line

CLOSED = math.radians(120)
"""The farthest that the finger closes, in radians."""

TOUCHING = 1e-9
"""Of the finger's length: a bottle whose diameter comes back so nearly is touched. Bisection stops
at a bend within 1e-12."""


class GraspResult(eqx.Enumeration):
    """Whether a finger touches a bottle."""

    successful = ""
    too_wide = "The bottle is too wide: it meets the finger before that bends."
    too_narrow = "The bottle is too narrow: the closed finger does not touch it."
    not_found = "No bend was found at which the finger touches the bottle."


class BendResult(eqx.Enumeration):
    """Whether a finger with a bend holds a bottle."""

    successful = ""
    beyond = "The finger is bent farther than it closes around a bottle."
    away = "The finger is bent away from the palm: it holds nothing."
    closed = "The finger has reached the palm: there is no room for a bottle."


class Hand(eqx.Module):
    """A finger and a palm.

    Attributes:
        palm: from the finger's centre line to where the bottle touches the palm, mm.
        gap: how far the palm lies beyond the finger's base, mm.
        radius: from the finger's centre line to its skin, where this is pressed in, mm.
        length: of the finger, mm.
    """

    palm: Float[Array, "*batch"]
    gap: Float[Array, "*batch"]
    radius: Float[Array, "*batch"]
    length: Float[Array, "*batch"]


class Touch(eqx.Module):
    """Where a bent finger touches a bottle.

    Attributes:
        diameter: of the bottle, mm.
        arc: where along the centre line, mm; the finger's length if it is its tip.
        relative_radius: of a cylinder that would press a straight wall as the bottle presses the
            bent one, mm.
    """

    diameter: Float[Array, "*batch"]
    arc: Float[Array, "*batch"]
    relative_radius: Float[Array, "*batch"]


def touched(hand: Hand, bend: Float[Array, ""]) -> Touch:
    """The bottle that a bent finger touches, in closed form, and where.

    Args:
        hand: what holds it.
        bend: angle between both ends of the finger, in radians; not negative.
    """
    curvature = bend / hand.length
    radius = _along(hand, curvature)
    arc = _nearest(hand, curvature, radius)
    at_tip = arc > hand.length
    radius = jnp.where(at_tip, _tip(hand, bend), radius)
    # At a distance u along the centre line from the nearest place, the bottle's centre is by
    # u² (1 − κ(q + r)) / (2 (q + r)) farther away.
    reach = radius + hand.radius
    free = jnp.maximum(1 - curvature * reach, jnp.finfo(reach.dtype).eps)
    return Touch(2 * radius, jnp.where(at_tip, hand.length, arc), reach / free)


def diameter_of(hand: Hand, bend: Float[Array, ""]) -> Solution[Float[Array, ""]]:
    """The diameter of the bottle that a finger with this bend holds, mm.

    Returns:
        In closed form, with derivatives; ``margin`` is the least bend, in radians, that leads out
        of what a holding finger can have, or the diameter over the finger's length, if that is
        less.
    """
    diameter = touched(hand, bend).diameter
    margin, result = combine_checks(
        BendResult.successful,
        (bend, BendResult.away),
        (CLOSED - bend, BendResult.beyond),
        (diameter / hand.length, BendResult.closed),
    )
    return Solution(diameter, margin, jnp.zeros_like(diameter), result)


def bend_around(hand: Hand, diameter: Float[Array, ""]) -> Solution[Float[Array, ""]]:
    """The bend at which the finger touches a bottle, in radians.

    In closed form where it touches between its ends, else by bisection of its tip's distance.

    Returns:
        The bend, with derivatives; ``margin`` is by how much wider or narrower the bottle may be,
        mm.
    """
    radius = diameter / 2
    reach, center = radius + hand.radius, hand.gap + radius
    # From the circle of the arc: (1/κ − reach)² = (palm − 1/κ)² + centre².
    # Of a bottle that is too wide for this, the finger's base is within reach.
    beyond = hand.palm**2 + center**2 - reach**2
    curvature = 2 * (hand.palm - reach) / jnp.where(beyond > 0, beyond, 1)
    within = curvature * hand.length
    at_tip = _nearest(hand, curvature, radius) > hand.length

    def off(bend: Float[Array, ""], known: tuple[Hand, Float[Array, ""]]) -> Float[Array, ""]:
        hand, radius = known
        return (_tip(hand, bend) - radius) / hand.length

    closed = jnp.asarray(CLOSED, diameter.dtype)
    between = jnp.zeros_like(closed), closed
    tip = find_root(off, closed, (hand, radius), method="bisection", bracket=between)
    bend = jnp.where(at_tip, tip.value, within)
    widest = touched(hand, jnp.zeros_like(bend)).diameter
    narrowest = touched(hand, closed).diameter
    margin, result = combine_checks(
        GraspResult.successful,
        (widest - diameter, GraspResult.too_wide),
        (diameter - narrowest, GraspResult.too_narrow),
    )
    held = margin > 0
    # What means nothing is at least a bend that the finger can have, and moves with nothing.
    bend = jnp.where(held, bend, jax.lax.stop_gradient(jnp.clip(bend, 0, closed)))
    off_by = jnp.abs(touched(hand, bend).diameter - diameter) / hand.length
    found = ~held | (off_by < TOUCHING)
    return Solution(bend, margin, off_by, GraspResult.where(found, result, GraspResult.not_found))


def _along(hand: Hand, curvature: Float[Array, ""]) -> Float[Array, ""]:
    """Radius of the bottle that the whole circle of the arc touches, mm."""
    room = 2 * (hand.palm - hand.radius)
    bent_in = hand.palm**2 + hand.gap**2 - hand.radius**2
    return (room - curvature * bent_in) / (2 * (1 + curvature * (hand.gap - hand.radius)))


def _nearest(hand: Hand, curvature: Float[Array, ""], radius: Float[Array, ""]) -> Float[Array, ""]:
    """How far along the circle of the arc its point nearest to the bottle's centre is, mm."""
    center = hand.gap + radius
    straight = curvature == 0
    some = jnp.where(straight, 1, curvature)
    turned = safe_arctan2(some * center, 1 - some * hand.palm)
    return jnp.where(straight, center, turned / some)


def _tip(hand: Hand, bend: Float[Array, ""]) -> Float[Array, ""]:
    """Radius of the bottle that the tip touches, mm; not positive if it has reached the palm."""
    tip = bend_center_line(hand.length, bend, hand.length)
    off = (tip.across - hand.palm) ** 2 + (tip.along - hand.gap) ** 2 - hand.radius**2
    room = hand.radius + tip.along - hand.gap
    # No circle touches the palm and what is all below it.
    return jnp.where(room > 0, off / (2 * jnp.where(room > 0, room, 1)), -hand.radius)
