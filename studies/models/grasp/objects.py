"""Objects, fixed in the proximal phalanx's frame, and where a pad would touch them."""

from __future__ import annotations

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import as_float, safe_divide
from designopt.vectors import Vector, stack, vector, where
from studies.models.grasp.transfer import Pad

End = tuple[Float[Array, ""], Float[Array, ""]]
"""Place along a face, and height over it, mm."""


class Contacts(eqx.Module):
    """Where one pad is nearest to an object.

    Attributes:
        gap: mm, negative where pad and object overlap.
        along: the pad's nearest point, mm from the phalanx's joint along the pad.
        normal: unit vectors from the object to the pad, the direction of a force on the pad, in
            the proximal phalanx's frame.
    """

    gap: Float[Array, " contacts"]
    along: Float[Array, " contacts"]
    normal: Vector


class Object(eqx.Module):
    """What the finger closes on.

    Attributes:
        count: places at which it can touch one pad at once.
    """

    count: ClassVar[int]

    @abc.abstractmethod
    def contacts(self, pad: Pad) -> Contacts:
        """Where a pad is nearest; finite wherever the pad is."""

    @abc.abstractmethod
    def outline(self) -> Float[Array, "points 2"]:
        """A closed polygon to draw, mm."""


class Circle(Object):
    """A round object.

    Attributes:
        center: mm.
        radius: mm.
    """

    center: Float[Array, "2"] = eqx.field(converter=as_float)
    radius: Float[Array, ""] = eqx.field(converter=as_float)
    count: ClassVar[int] = 1

    def contacts(self, pad: Pad) -> Contacts:
        """Gap = distance of the centre from the segment − radius.

        Beside the segment the distance is signed, so that a pad which went past the centre counts
        as deep inside and not as beyond.
        """
        place = _in_pad(pad, vector(self.center))
        nearest = jnp.clip(place.x, 0.0, pad.length)
        past = place.x - nearest
        beside = past == 0
        to_pad = Vector(-past, -place.y)
        distance = jnp.where(beside, -place.y, to_pad.length())
        inverse, _ = safe_divide(jnp.ones_like(distance), distance)
        normal = Vector(
            jnp.where(beside, 0.0, to_pad.x * inverse), jnp.where(beside, 1.0, to_pad.y * inverse)
        )
        turned = normal.turned(pad.along)
        return Contacts((distance - self.radius)[None], (pad.offset + nearest)[None], turned[None])

    def outline(self) -> Float[Array, "points 2"]:
        """A regular polygon of 180 corners."""
        turn = jnp.linspace(0.0, 2 * jnp.pi, 181, dtype=self.center.dtype)
        return self.center[None] + self.radius * jnp.stack([jnp.cos(turn), jnp.sin(turn)], axis=1)


class Polygon(Object):
    """A convex object with sharp corners.

    A pad can lie flat on a side: that is two contacts at once, the ends of what both share. On
    others one of the two is open.

    Attributes:
        corners: counter-clockwise, mm.
    """

    corners: Float[Array, "corners 2"] = eqx.field(converter=as_float)
    count: ClassVar[int] = 2

    def contacts(self, pad: Pad) -> Contacts:
        """Gap along the separating axis: the largest over all axes of the least distance along it.

        Axes are the pad's normal, with the polygon's corners over it, and the sides' normals, with
        the pad's ends over them (C. Ericson, *Real-Time Collision Detection*, §5.2). Their gap is
        zero exactly where both touch and is the distance wherever one of both faces the other;
        while corner and pad's end are nearest to each other it is less than the distance.
        The second contact is the other end of the facing pair, cut to what both share.
        """
        # Neighbouring corners differ in parity once their number is even, so parity gives each
        # contact a place that it keeps while the pad rolls: forces stay with their corner.
        outline = self.corners
        if len(outline) % 2:
            outline = jnp.concatenate([outline, (outline[-1:] + outline[:1]) / 2])
        corners = _in_pad(pad, vector(outline))
        heights = -corners.y
        count = len(outline)
        first = jnp.argmin(jax.lax.stop_gradient(heights))
        before, after = (first - 1) % count, (first + 1) % count
        second = jnp.where(heights[before] < heights[after], before, after)
        even, odd = jnp.where(first % 2 == 0, first, second), jnp.where(first % 2, first, second)
        ends = (corners.x[even], heights[even]), (corners.x[odd], heights[odd])
        pad_faces = _cut(ends, pad.length)

        # Every side as the face, seen in its own frame: x along it, y into the object.
        following = corners[jnp.roll(jnp.arange(count), -1)]
        sides = following - corners
        length = sides.length()
        inverse, _ = safe_divide(jnp.ones_like(length), length)
        side = sides.scaled(inverse)
        tips = [
            (Vector(jnp.full_like(corners.x, x), jnp.zeros_like(corners.x)) - corners).turned(
                side.conjugate()
            )
            for x in (0.0, pad.length)
        ]
        # The tip nearer to the side's first corner takes that corner's place.
        swapped = (tips[0].x > tips[1].x) != (jnp.arange(count) % 2 == 1)
        one, two = (where(swapped, *pair) for pair in (tips[::-1], tips))
        places, side_gaps = jax.vmap(lambda a, b, size: _cut(((a.x, -a.y), (b.x, -b.y)), size))(
            one, two, length
        )
        # Whole features decide which face separates: those cut to it would make corners tie.
        over_sides = jnp.minimum(-tips[0].y, -tips[1].y)
        separation = jnp.concatenate([jnp.min(heights)[None], over_sides])
        best = jnp.argmax(jax.lax.stop_gradient(separation))
        face, on_side = jnp.maximum(best - 1, 0), best > 0
        # Back from places along the side to places along the pad.
        share, _ = safe_divide(places[face] - tips[0].x[face], tips[1].x[face] - tips[0].x[face])
        along = jnp.where(on_side, share * pad.length, pad_faces[0])
        gap = jnp.where(on_side, side_gaps[face], pad_faces[1])
        facing = side[face]
        normal = Vector(
            jnp.where(on_side, facing.y, 0.0), jnp.where(on_side, -facing.x, 1.0)
        ).turned(pad.along)
        return Contacts(gap, pad.offset + along, stack(normal, normal))

    def outline(self) -> Float[Array, "points 2"]:
        """Its corners, the first once more."""
        return jnp.concatenate([self.corners, self.corners[:1]])


def _in_pad(pad: Pad, place: Vector) -> Vector:
    """A place in the pad's frame: x along it from its start, y into the finger."""
    return (place - pad.start).turned(pad.along.conjugate())


def _cut(
    ends: tuple[End, End], length: float | Float[Array, ""]
) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
    """Places and heights of a segment's ends over a face, each cut to the face's extent.

    The higher end slides along the segment to above the face's edge, where the segment crosses it.
    The lower one keeps its height, so that the smaller of both is never more than the distance.
    """
    (x0, y0), (x1, y1) = ends
    rise, crosses = safe_divide(y1 - y0, x1 - x0)
    shared = crosses & (jnp.minimum(x0, x1) <= length) & (jnp.maximum(x0, x1) >= 0)
    places, heights = [], []
    for (x, y), other in zip(ends, (y1, y0), strict=True):
        inside = jnp.where(shared, jnp.clip(x, 0.0, length), x)
        places.append(inside)
        heights.append(jnp.where(y > other, y + rise * (inside - x), y))
    return jnp.stack(places), jnp.stack(heights)
