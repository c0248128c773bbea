"""The chamber's wall as rings, bent and pressed, and which part of each the camera sees.

Paper A measures wall points from a reference ray through the pinhole, and its top DE ends on that
ray (T_D = Δd_d). Turned about that ray, the profile is a round chamber whose radius is h + Δl at
A, B and C, and h − Δl_D at D: a reading, which keeps every length of the image, and so η, as the
paper has it. Between these points the wall is straight.

Bent, a ring lies in the plane across its place on the centre line. With c the ring's centre seen
from the pinhole, (c_x, c_z) in the plane of bending, and t = (t_x, t_z) the centre line's
direction there, a ray (u, v, 1) passes through the ring of radius r if

    (u c_z − c_x)² + (c·t)² v² ≤ r² (u t_x + t_z)²,

an ellipse in the image. An object presses the wall flat to depth p: the ring is cut by a chord
across the plane of bending, in the image a line u = const. Both are convex, so what is seen
through all nearer rings, each an aperture, is convex as well, and symmetric about the plane of
bending; from any point inside, its outline is the least of the rings' distances in each direction.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from optics.chamber.bending import bend_center_line
from optics.chamber.chamber import Chamber

FIELD_STOP = 1.2
"""Tangent of the angle from the chamber's axis beyond which nothing is followed."""


class Rings(eqx.Module):
    """Rings of a straight chamber's wall, from near the lens to its top.

    Attributes:
        arc: distances s along the centre line, mm.
        radius: of the wall there, mm.
        pinhole_offset: δ, distance of the pinhole behind the start of the centre line, mm.
        length: of the centre line, mm.
        region: of each ring, the wall that it ends: 0 red, 1 blue, 2 yellow.
        ends: index of the last ring of each region: that at B, at C and at D.
    """

    arc: Float[Array, " rings"]
    radius: Float[Array, " rings"]
    pinhole_offset: Float[Array, ""]
    length: Float[Array, ""]
    region: tuple[int, ...] = eqx.field(static=True)
    ends: tuple[int, int, int] = eqx.field(static=True)

    @classmethod
    def of(cls, chamber: Chamber, per_region: int = 20) -> Rings:
        """Rings of a chamber, as many in every region, evenly along it, the last at its end."""
        radii = compute_wall_radii(chamber)
        lengths = (chamber.length_ab, chamber.length_bc, chamber.length_cd)
        share = jnp.asarray(np.arange(1, per_region + 1) / per_region, chamber.length_ab.dtype)
        start = jnp.zeros_like(chamber.length_ab)
        arcs, walls = [], []
        for region, length in enumerate(lengths):
            arcs.append(start + share * length)
            walls.append(radii[region] + share * (radii[region + 1] - radii[region]))
            start = start + length
        return cls(
            arc=jnp.concatenate(arcs),
            radius=jnp.concatenate(walls),
            pinhole_offset=chamber.pinhole_offset,
            length=start,
            region=tuple(np.repeat(np.arange(3), per_region).tolist()),
            ends=(per_region - 1, 2 * per_region - 1, 3 * per_region - 1),
        )


def compute_wall_radii(chamber: Chamber) -> Float[Array, "4"]:
    """Radii of the round chamber at A, B, C and D in mm: h + Δl, and h − Δl_D at D.

    Example:
        >>> chamber = Chamber(40, 30, 30, 4.1, 2.0, 0.035, 2.5, 4.0, 3.5, 8.6, 0.84)
        >>> [round(radius, 2) for radius in compute_wall_radii(chamber).tolist()]
        [12.7, 10.6, 9.55, 6.1]
    """
    height = chamber.reference_height
    offsets = (chamber.offset_a, chamber.offset_b, chamber.offset_c, -chamber.offset_d)
    return height + jnp.stack(offsets)


class Posture(eqx.Module):
    """How a finger is bent and pressed.

    Attributes:
        bend: angle between both ends of the finger, in radians.
        direction: the side to which a positive bend goes, in the image: 0 is right, a right angle
            is down.
        pressed: by how much the wall is pressed in at every ring, mm; positive on that side,
            negative on the other one.
    """

    bend: Float[Array, "*batch"]
    direction: Float[Array, "*batch"]
    pressed: Float[Array, "*batch rings"]


def press_wall(
    arc: Float[Array, " rings"],
    place: Float[Array, ""],
    radius: Float[Array, ""],
    depth: Float[Array, ""],
) -> Float[Array, " rings"]:
    """How deep a round object presses a wall along its length, by its osculating parabola.

    Args:
        arc: of the rings, mm.
        place: where along the finger it presses deepest, mm.
        radius: of the object, mm.
        depth: the deepest, mm; negative presses the other side.

    Example:
        >>> press_wall(
        ...     jnp.array([40.0, 50.0, 60.0]), jnp.array(50.0), jnp.array(20.0), jnp.array(3.0)
        ... ).tolist()
        [0.5, 3.0, 0.5]
    """
    left = jnp.abs(depth) - (arc - place) ** 2 / (2 * radius)
    return jnp.sign(depth) * jnp.maximum(left, 0)


class Spans(eqx.Module):
    """What every ring spans in the plane of bending, in tangents u of the angle to the axis.

    Attributes:
        low: its side away from that to which a positive bend goes.
        high: its other side.
        seen_low: the same of what is seen through all nearer rings and the field stop.
        seen_high: likewise; below ``seen_low`` where nothing is seen of it.
        margin: how far the ring's nearest point is in front of the pinhole plane, and how large
            its radius is, the lesser, in mm; only if it is positive is the ring imaged.
    """

    low: Float[Array, "*batch rings"]
    high: Float[Array, "*batch rings"]
    seen_low: Float[Array, "*batch rings"]
    seen_high: Float[Array, "*batch rings"]
    margin: Float[Array, "*batch rings"]

    @property
    def width(self) -> Float[Array, "*batch rings"]:
        """Width of what is seen, as a difference of tangents; negative where it is hidden."""
        return self.seen_high - self.seen_low


class _Bent(eqx.Module):
    """Rings in the plane of bending, seen from the pinhole; ``reach`` is half a ring's height."""

    across: Float[Array, " rings"]
    along: Float[Array, " rings"]
    sine: Float[Array, " rings"]
    cosine: Float[Array, " rings"]
    radius: Float[Array, " rings"]
    reach_high: Float[Array, " rings"]
    reach_low: Float[Array, " rings"]


def _bent_rings(rings: Rings, bend: Float[Array, ""], pressed: Float[Array, " rings"]) -> _Bent:
    line = bend_center_line(rings.arc, bend, rings.length)
    return _Bent(
        across=line.across,
        along=line.along + rings.pinhole_offset,
        sine=jnp.sin(line.turned),
        cosine=jnp.cos(line.turned),
        radius=rings.radius,
        reach_high=rings.radius - jnp.maximum(pressed, 0),
        reach_low=rings.radius + jnp.minimum(pressed, 0),
    )


def find_spans(rings: Rings, bend: Float[Array, ""], pressed: Float[Array, " rings"]) -> Spans:
    """What the rings span in the plane of bending.

    Differentiable, at no bend too; where ``margin`` is not positive the spans mean nothing.

    Example:
        >>> rings = Rings.of(Chamber(40, 30, 30, 4.1, 2.0, 0.035, 2.5, 4.0, 3.5, 8.6, 0.84))
        >>> spans = jax.jit(find_spans)(rings, jnp.zeros(()), jnp.zeros(len(rings.arc)))
        >>> bool(jnp.allclose(spans.low, -spans.high))  # a straight finger is symmetric
        True
    """
    return _spans(_bent_rings(rings, bend, pressed))


def _spans(ring: _Bent) -> Spans:
    high_depth = ring.along - ring.reach_high * ring.sine
    low_depth = ring.along + ring.reach_low * ring.sine
    margin = jnp.minimum(jnp.minimum(high_depth, low_depth), ring.radius)
    high = (ring.across + ring.reach_high * ring.cosine) / jnp.where(margin > 0, high_depth, 1)
    low = (ring.across - ring.reach_low * ring.cosine) / jnp.where(margin > 0, low_depth, 1)
    stop = jnp.asarray(FIELD_STOP, high.dtype)
    # What does not lie in front of the camera is seen by no ray: an empty span.
    seen_high = jax.lax.cummin(jnp.where(margin > 0, jnp.minimum(high, stop), -stop))
    seen_low = jax.lax.cummax(jnp.where(margin > 0, jnp.maximum(low, -stop), stop))
    return Spans(low, high, seen_low, seen_high, margin)


class Apertures(eqx.Module):
    """What is seen through every ring and all nearer ones.

    Attributes:
        outline: rays (x, y, 1) along its outline, given by x and y, right and down, in the sense
            from right to down; all at one point where nothing is seen.
        seen: whether anything is seen.
        spans: in the plane of bending.
    """

    outline: Float[Array, "*batch rings angles 2"]
    seen: Bool[Array, "*batch rings"]
    spans: Spans


def find_apertures(rings: Rings, posture: Posture, angles: int = 256) -> Apertures:
    """What the camera sees through every ring of a bent and pressed finger.

    Args:
        rings: of the straight finger.
        posture: one.
        angles: number of points of an outline.

    Example:
        >>> rings = Rings.of(Chamber(40, 30, 30, 4.1, 2.0, 0.035, 2.5, 4.0, 3.5, 8.6, 0.84))
        >>> straight = Posture(jnp.zeros(()), jnp.zeros(()), jnp.zeros(len(rings.arc)))
        >>> find = jax.jit(find_apertures, static_argnames="angles")
        >>> find(rings, straight, angles=16).outline.shape
        (60, 16, 2)
    """
    ring = _bent_rings(rings, posture.bend, posture.pressed)
    seen = _spans(ring)
    # A ring is seen through those before it, so what is seen through the last one that shows
    # anything is inside them all.
    last = jnp.maximum(jnp.sum(jnp.cumprod(seen.width > 0)) - 1, 0)
    pole = (seen.seen_low[last] + seen.seen_high[last]) / 2
    turn = jnp.linspace(0, 2 * jnp.pi, angles, endpoint=False, dtype=pole.dtype)
    distance = jax.vmap(_distances, in_axes=(0, None, None))(ring, pole, turn)
    stop = _stop_distances(pole, turn)
    nearest = jax.lax.cummin(jnp.minimum(distance, stop[None]))
    nearest = jnp.where(seen.width[:, None] > 0, jnp.maximum(nearest, 0), 0)
    u = pole + nearest * jnp.cos(turn)[None]
    v = nearest * jnp.sin(turn)[None]
    cosine, sine = jnp.cos(posture.direction), jnp.sin(posture.direction)
    outline = jnp.stack([u * cosine - v * sine, u * sine + v * cosine], axis=-1)
    return Apertures(outline, seen.width > 0, seen)


def _distances(
    ring: _Bent, pole: Float[Array, ""], turn: Float[Array, " angles"]
) -> Float[Array, " angles"]:
    """From a point in the plane of bending to one ring's outline, in every direction."""
    cosine, sine = jnp.cos(turn), jnp.sin(turn)
    # notation: A ρ² + 2 B ρ + C = 0 is the ring's ellipse along a ray from the pole; C ≤ 0 inside.
    off = pole * ring.along - ring.across
    facing = pole * ring.sine + ring.cosine
    depth = ring.across * ring.sine + ring.along * ring.cosine
    a = cosine**2 * (ring.along**2 - (ring.radius * ring.sine) ** 2) + (depth * sine) ** 2
    b = cosine * (ring.along * off - ring.radius**2 * ring.sine * facing)
    c = off**2 - (ring.radius * facing) ** 2
    root = jnp.sqrt(jnp.maximum(b**2 - a * c, 0))
    # A ring that the camera's plane nearly cuts is a hyperbola, A < 0: not every ray meets it.
    ahead = jnp.where(a > 0, (root - b) / jnp.where(a > 0, a, 1), 2 * FIELD_STOP)
    distance = jnp.where(b < 0, ahead, -c / jnp.where(b + root > 0, b + root, 1))
    for reach, side in ((ring.reach_high, 1.0), (ring.reach_low, -1.0)):
        speed = cosine * (side * ring.along - reach * ring.sine)
        room = reach * facing - side * off
        chord = room / jnp.where(speed > 0, speed, 1)
        distance = jnp.where(speed > 0, jnp.minimum(distance, chord), distance)
    return distance


def _stop_distances(
    pole: Float[Array, ""], turn: Float[Array, " angles"]
) -> Float[Array, " angles"]:
    along = pole * jnp.cos(turn)
    return -along + jnp.sqrt(jnp.maximum(along**2 + FIELD_STOP**2 - pole**2, 0))
