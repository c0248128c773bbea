"""The coupled finger over angles of PIP, in closed form.

Its four-bar A-B-Q-P has the proximal phalanx A-P as its frame, the intermediate one A-B as its
input, the distal one B-Q as its output, and the bar P-Q between these.

Source: J. M. McCarthy, G. S. Soh, *Geometric Design of Linkages*, 2nd ed., Springer, 2011, ch. 2
(position, velocity and transmission angle of the four-bar).
"""

from __future__ import annotations

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_divide
from designopt.vectors import Vector, fold_angle, rotation, vector
from studies.models.finger import Finger, coupling_pins_of
from studies.models.linkage_design.postures import turn_dyad

Row = Float[Array, " pip"]


class CoupledPostures(eqx.Module):
    """A coupled finger over angles of PIP.

    Attributes:
        places: O, A, B, T and all pins in the frame of the proximal phalanx, mm.
        dip: flexion of DIP, rad.
        ratio: dDIP/dPIP.
        reach: how far the dyad B-Q-P is from the nearer of stretching and folding, mm; negative
            where it cannot be assembled.
        transmission: angle between P-Q and B-Q, rad, 0 to π/2.
    """

    places: dict[str, Vector]
    dip: Row
    ratio: Row
    reach: Row
    transmission: Row


def find_coupled_postures(finger: Finger, pip: Row) -> CoupledPostures:
    """A coupled finger over angles of PIP, assembled as it is when straight.

    The ratio by virtual velocities: Q does not move along the bar, whose other pin is fixed.

    Args:
        finger: its body and pins.
        pip: flexion of PIP, rad.

    Raises:
        UserError: it has no pins, or is not coupled.

    Example:
        >>> from studies.models.body import BodySpec
        >>> from studies.models.finger_parts import Body
        >>> from studies.models.pins import CouplingPins
        >>> pins = CouplingPins(jnp.array([7.9, -2.1]), jnp.array([25.2, -6.3]))
        >>> finger = Finger.of(Body.of(BodySpec(axis_height=10.0)), pins)
        >>> found = find_coupled_postures(finger, jnp.array([0.0, jnp.pi / 2]))
        >>> jnp.rad2deg(found.dip).round().tolist()
        [0.0, 90.0]
    """
    body, pins = finger.body, coupling_pins_of(finger)
    knuckle, zero = rotation(-pip), jnp.zeros_like(pip)
    axis_b, p, q = Vector(body.intermediate, jnp.zeros(())), vector(pins.P), vector(pins.Q)
    b, arm = axis_b.turned(knuckle), q - axis_b
    turn, bar_turn, reach = turn_dyad(p - b, p - axis_b, arm, p - q)
    turned_arm, bar = arm.turned(turn), (p - q).turned(bar_turn)
    ratio, _ = safe_divide(-b.cross(bar), turned_arm.cross(bar))
    distal = Vector(body.distal, jnp.zeros(())).turned(turn)
    places = {
        "O": Vector(zero - body.proximal, zero),
        "A": Vector(zero, zero),
        "B": b,
        "T": b + distal,
        "P": Vector(zero + p.x, zero + p.y),
        "Q": b + turned_arm,
    }
    if finger.motor is not None:
        assert pins.K is not None  # as `Finger.of` refuses a motor without it
        axis, k = vector(finger.motor.axis(body, pins)), vector(pins.K).turned(knuckle)
        places |= {"K": k, "M": Vector(zero + axis.x, zero + axis.y), "N": k + axis}
    return CoupledPostures(
        places=places,
        dip=-turn.turned(knuckle.conjugate()).angle(),
        ratio=ratio - 1,
        reach=reach,
        transmission=fold_angle(turned_arm, bar),
    )


def with_motor_arm(finger: Finger, arm: Float[Array, ""] | float) -> Finger:
    """The coupled finger with pin K where the motor's parallelogram transmits best.

    A-K is then at right angles to M-A in the middle of PIP's range, so that its transmission angle
    is 90° less half of that range at both ends.

    Args:
        finger: with pins; where it has K, that is replaced. Without a motor it is as it was.
        arm: |AK|, mm.
    """
    if finger.motor is None:
        return finger
    pins = coupling_pins_of(finger)
    towards = vector(finger.motor.axis(finger.body, pins))
    along = towards.scaled(1 / towards.length())
    half = rotation((finger.body.flexion - jnp.pi) / 2)
    return replace(finger, pins=replace(pins, K=arm * along.turned(half).stacked()))
