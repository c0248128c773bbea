"""Edges between what neighbouring rays see, found to rounding and with their derivatives.

At an edge some residual vanishes along the ray: the ray passes an end of a surface, two surfaces
meet, a curved one turns away, the grazing angle is the least one, or the image of the pad folds
back on itself. With this residual r(θ, p) = 0 of the ray's angle θ and all dimensions p,

    dθ/dp = −(∂r/∂p) / (∂r/∂θ)

by the implicit function theorem; which residual it is shows by the shortest Newton step to its
root.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import bisect, safe_divide
from optics.scene.scene import Layout
from optics.visibility import boundary_codes as codes
from optics.visibility.boundary_codes import label_of
from optics.visibility.fan import Fan
from optics.visibility.tracing import NOTHING, Leg

BISECTIONS = 52
"""Halvings of the fan's spacing: down to rounding."""


class Edge(eqx.Module):
    """Where a run of rays that see one pad by one path begins or ends.

    Attributes:
        angle: of the ray, from the axis, rad.
        coordinate: where it meets the pad.
        label: what bounds the run.
        slope: change of the coordinate with the angle, per rad.
        length: of the path, in the units of the placed scene.
        spans: coordinates at which the ray is reflected by each mirror of the path.
        step: Newton step that is left, rad.
    """

    angle: Float[Array, ""]
    coordinate: Float[Array, ""]
    label: Int[Array, ""]
    slope: Float[Array, ""]
    length: Float[Array, ""]
    spans: Float[Array, " reflections"]
    step: Float[Array, ""]


def find_edge(
    fan: Fan,
    present: Bool[Array, ""],
    label: Int[Array, ""],
    inside: Float[Array, ""],
    outside: Float[Array, ""],
) -> Edge:
    """The edge of a run between a ray inside and one outside of it, or the fan's limit.

    Args:
        fan: the scene in a pose.
        present: whether there is such a run.
        label: what the run sees, as `Fan.label`.
        inside: angle of a ray of the run, rad.
        outside: angle of one that is not, or of the limit of the field of view, rad.
    """
    still = jax.lax.stop_gradient(fan)
    pad, _, leg = fan.meaning(label)

    # Bisection by what is seen and not by a residual: it needs no guess which one vanishes, and is
    # right where several do.
    at, other = bisect(lambda angle: still.label(angle) == label, inside, outside, BISECTIONS)
    limit = jnp.abs(outside) >= still.camera.field_of_view / 2
    at_limit = limit & (other == outside)
    # Along both rays: the one just inside, and the one just outside. The first leg on which they
    # meet different surfaces is where the run ends; if they meet the same ones, the last leg, at
    # which the angle of incidence or the direction in which the image runs decides.
    legs = jax.vmap(still.follow)(jnp.stack([at, other]))
    changed = (legs.surface[0] != legs.surface[1]) & (jnp.arange(fan.bounces + 1) <= leg)
    where = jnp.where(jnp.any(changed), jnp.argmax(changed), leg)
    surfaces = legs.surface[:, where]
    distances = legs.length[:, where] - jnp.where(where > 0, legs.length[:, where - 1], 0.0)

    def residuals(angle: Float[Array, ""]) -> Float[Array, " residuals"]:
        return _residuals(fan, angle, pad, leg, where, surfaces, distances)

    value, slope = jax.jvp(residuals, (at,), (jnp.ones_like(at),))
    slope = jax.lax.stop_gradient(slope)
    steps, exist = safe_divide(value, slope)
    possible = _possible(fan.layout, surfaces) & exist
    which = jnp.argmin(jnp.where(possible, jnp.abs(steps), jnp.inf))
    # Only the derivative of the edge's angle is wanted: its value is the last ray inside.
    shift = jnp.where(possible[which], jax.lax.stop_gradient(steps[which]) - steps[which], 0.0)
    half = fan.camera.field_of_view / 2
    of_limit = jnp.sign(outside) * (half - jax.lax.stop_gradient(half))
    angle = at + jnp.where(present, jnp.where(at_limit, of_limit, shift), 0.0)

    def coordinate(angle: Float[Array, ""]) -> tuple[Float[Array, ""], Leg]:
        legs = fan.follow(angle)
        return legs.coordinate[leg], legs

    along, steep, legs = jax.jvp(coordinate, (angle,), (jnp.ones_like(angle),), has_aux=True)
    before = jnp.arange(fan.bounces) < leg
    return Edge(
        angle,
        along,
        jnp.where(
            at_limit,
            jnp.where(outside > 0, codes.LEFT_LIMIT, codes.RIGHT_LIMIT),
            _labels(fan.layout, pad, leg, where, surfaces)[which],
        ),
        steep,
        legs.length[leg],
        jnp.where(before, legs.coordinate[:-1], 0.0),
        jnp.where(at_limit, 0.0, jnp.abs(steps[which])),
    )


def _residuals(
    fan: Fan,
    angle: Float[Array, ""],
    pad: Int[Array, ""],
    leg: Int[Array, ""],
    where: Int[Array, ""],
    surfaces: Int[Array, "2"],
    distances: Float[Array, "2"],
) -> Float[Array, " residuals"]:
    """What vanishes at an edge, one way or another, along a ray just inside of it.

    Args:
        fan: the scene.
        angle: the ray's angle from the axis, rad.
        pad: the pad that it reaches.
        leg: on which leg.
        where: the leg on which it parts from the rays outside.
        surfaces: what it meets there, and what they meet.
        distances: how far along the leg these are.
    """

    def coordinate(angle: Float[Array, ""]) -> tuple[Float[Array, ""], Leg]:
        legs = fan.follow(angle)
        return legs.coordinate[leg], legs

    _, slope, legs = jax.jvp(coordinate, (angle,), (jnp.ones_like(angle),), has_aux=True)
    position, direction = jax.tree.map(
        lambda first, rest: jnp.where(where == 0, first, rest[where - 1]),
        (fan.start(angle), fan.heading(angle)),
        (legs.place, legs.direction),
    )
    last = jnp.where(where == 0, NOTHING, legs.surface[where - 1])
    mine, theirs = (
        fan.tracer.meeting(position, direction, surface, distance, last)
        for surface, distance in zip(surfaces, distances, strict=True)
    )
    return jnp.stack(
        [
            mine.coordinate,
            mine.coordinate - 1,
            theirs.coordinate,
            theirs.coordinate - 1,
            mine.distance - theirs.distance,  # they cross: the nearer one changes
            mine.horizon,
            theirs.horizon,
            legs.sine[leg] - jnp.sin(fan.grazing[pad]),
            slope,  # the image folds back: a concave mirror shows a place twice beyond
        ]
    )


def _possible(layout: Layout, surfaces: Int[Array, "2"]) -> Bool[Array, "9"]:
    """Which of the residuals make sense."""
    mine, theirs = surfaces
    curved = np.zeros(len(layout.surfaces) + 1, bool)
    curved[list(layout.curved)] = True
    other = (theirs != NOTHING) & (theirs != mine)
    mine_bends, theirs_bends = jnp.asarray(curved)[mine], jnp.asarray(curved)[theirs]
    always = jnp.ones_like(other)
    return jnp.stack(
        [always, always, other, other, other, mine_bends, theirs_bends & other, always, always]
    )


def _labels(
    layout: Layout,
    pad: Int[Array, ""],
    leg: Int[Array, ""],
    where: Int[Array, ""],
    surfaces: Int[Array, "2"],
) -> Int[Array, "9"]:
    """What the residuals mean."""
    mine, theirs = surfaces

    def named(surface: Int[Array, ""], kind: int) -> Int[Array, ""]:
        return label_of(where, surface, kind)

    own = (where == leg) & (mine == len(layout.mirrors) + pad)
    return jnp.stack(
        [
            jnp.where(own, codes.FIRST_PAD_END, named(mine, codes.FIRST_END)),
            jnp.where(own, codes.SECOND_PAD_END, named(mine, codes.SECOND_END)),
            named(theirs, codes.FIRST_END),
            named(theirs, codes.SECOND_END),
            named(theirs, codes.CROSSING),
            named(mine, codes.HORIZON),
            named(theirs, codes.HORIZON),
            jnp.asarray(codes.HIGH_GRAZING),
            jnp.asarray(codes.FOLD),
        ]
    )
