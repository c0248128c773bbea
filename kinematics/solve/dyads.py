"""Closed forms of a loop with two unknowns, one for every kind of dyad.

Each solves  e = (vectors with unknowns)  for a known vector e, and returns what is unknown with
margins: signed distances to lock-up in the unit of the lengths, negative where there is no
answer. Beyond lock-up the parts come as near to closing as they can, and all slopes stay finite.

Source: J. J. Uicker, G. R. Pennock, J. E. Shigley, *Theory of Machines and Mechanisms*, ch. 2
(the four cases of the loop-closure equation, after M. A. Chace 1963).
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_divide, safe_sqrt
from designopt.vectors import Vector

Scalar = Float[Array, "*#batch"]  # of one pose or of several


def solve_rrr(
    e: Vector, a: Vector, b: Vector, side: Scalar, towards: Vector
) -> tuple[Vector, Vector, tuple[Scalar, Scalar]]:
    """RRR: the rotations α, β with e = α a + β b (intersection of two circles).

    Args:
        e: from the first pin to the last, mm.
        a: from the first pin to the middle one, in its body's frame, mm.
        b: from the middle pin to the last, in its body's frame, mm.
        side: +1 if the middle pin lies to the left of e, −1 if to the right.
        towards: direction to take for e where it vanishes and leaves the answer open, of any
            length.

    Returns:
        α, β and two margins: |a| + |b| − |e| (too far apart) and |e| − ||a| − |b|| (too near).
    """
    base = apart(e, towards)
    aa, bb, ee = a.squared(), b.squared(), base.squared()
    length_a, length_b = safe_sqrt(aa), safe_sqrt(bb)
    reach, difference = length_a + length_b, length_a - length_b
    # 16 area² of the triangle as (reach² − e²)(e² − difference²), after Heron: no cancellation
    # but that of the distances themselves.
    height = safe_sqrt((reach * reach - ee) * (ee - difference * difference))
    inverse, _ = safe_divide(jnp.ones_like(ee), ee)
    # Middle pin = x e + y e⊥; beyond lock-up, where y is 0, it stays at its distance: without the
    # clip the first link would stretch, and what is computed there would be of another linkage.
    length_e = safe_sqrt(ee)
    most = length_a * length_e * inverse
    along = jnp.clip(0.5 * (1 + reach * difference * inverse), -most, most)
    across = 0.5 * side * height * inverse
    middle = base.scaled(along) + base.perpendicular().scaled(across)
    return (
        _quotient(middle, a, aa),
        _quotient(e - middle, b, bb),
        (reach - length_e, length_e - jnp.abs(difference)),
    )


def solve_rrp(
    e: Vector, a: Vector, w: Vector, side: Scalar
) -> tuple[Vector, Scalar, tuple[Scalar]]:
    """RRP: the rotation α and the slide s with e = α a + s w (circle and line).

    Args:
        e: from the pin to the line's point, mm.
        a: from the pin to the sliding joint, in its body's frame, mm.
        w: direction of the line, a unit vector.
        side: sign of α a · w.

    Returns:
        α, s and the margin |a| − distance of the pin from the line.
    """
    aa = a.squared()
    length_a = safe_sqrt(aa)
    distance = w.cross(e)
    # A difference of squares as a product: |a|² − distance² would lose half of the digits near
    # lock-up, which is where the slide's place is wanted most.
    reach = safe_sqrt((length_a - distance) * (length_a + distance))
    slide = w.dot(e) - side * reach
    return _quotient(e - w.scaled(slide), a, aa), slide, (length_a - jnp.abs(distance),)


def solve_rpr(
    e: Vector, a: Vector, u: Vector, side: Scalar, towards: Vector
) -> tuple[Vector, Scalar, tuple[Scalar]]:
    """RPR: the rotation α and the slide s with e = α (a + s u) (tangent from a point to a circle).

    Args:
        e: from the body's pin to the joint in its slot, mm.
        a: from the pin to the slot's first point, in the body's frame, mm.
        u: direction of the slot in the body's frame, a unit vector.
        side: sign of (a + s u) · u.
        towards: direction to take for e where it vanishes and leaves the answer open, of any
            length.

    Returns:
        α, s and the margin |e| − distance of the pin from the slot.
    """
    e = apart(e, towards)
    distance = u.cross(a)
    length_e = e.length()
    # As a product for the same reason as in RRP.
    reach = side * safe_sqrt((length_e - distance) * (length_e + distance))
    arm = Vector(reach, distance).turned(u)
    return _quotient(e, arm, arm.squared()), reach - u.dot(a), (length_e - jnp.abs(distance),)


def solve_two_slides(
    e: Vector, v: Vector, w: Vector, side: Scalar
) -> tuple[Scalar, Scalar, tuple[Scalar]]:
    """PRP and RPP: the slides s, t with e = s v + t w (two lines).

    Args:
        e: from the first line's point to the second's, mm.
        v: direction of the first line, a unit vector.
        w: direction of the second, a unit vector.
        side: sign of w × v.

    Returns:
        s, t and the margin: the sine of the angle between the lines, negative beyond parallel,
        where the joint has gone through infinity.
    """
    sine = v.cross(w)
    # Cramer's rule. With parallel lines `safe_divide` leaves slides of 0 and slopes of 0 instead
    # of infinities, which would spoil the gradient of every other pose of a batch.
    s, _ = safe_divide(e.cross(w), sine)
    t, _ = safe_divide(v.cross(e), sine)
    return s, t, (-side * sine,)


def apart(e: Vector, towards: Vector) -> Vector:
    """A vector, or where it is too short to have a direction a short one along another.

    Where the outer pins of a dyad coincide, a whole circle of answers is left, of which the
    direction picks one. What replaces the vector is far below rounding.
    """
    least = 2 * jnp.finfo(e.x.dtype).tiny ** 0.25  # its fourth power can still be divided by
    known = e.squared() > least * least
    length = 1e3 * least
    directed = towards.squared() > 1e-6
    x = jnp.where(known, e.x, length * jnp.where(directed, towards.x, 1.0))
    return Vector(x, jnp.where(known, e.y, length * jnp.where(directed, towards.y, 0.0)))


def _quotient(image: Vector, original: Vector, squared: Scalar) -> Vector:
    """The rotation that turns one vector into another of the same length."""
    # A quotient of complex numbers and no angle: the branch cut of arctan2 would be a jump in all
    # that follows.
    product = image.turned(original.conjugate())
    inverse, _ = safe_divide(jnp.ones_like(squared), squared)
    return product.scaled(inverse)
