"""Transfer functions of the finger in one posture, from its joints to its motor and its spring."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_divide
from designopt.vectors import Vector, rotation
from studies.models.finger import Finger, pins_of
from studies.models.finger_parts import Body
from studies.models.linkage_design.postures import turn_dyad

Joints = Float[Array, "2"]
"""Flexion (PIP, DIP), rad, not negative."""


class Transfer(eqx.Module):
    """Turns of crank and plate in one posture, and their derivatives.

    Attributes:
        crank: φ, turn of the crank from the straight finger, rad, positive in closing.
        ratios: (φ₁, φ₂), derivatives of φ by PIP and DIP.
        winding: Δγ, turn of the plate relative to the distal phalanx from straight, rad.
        slope: γ', derivative of Δγ by DIP.
        reach: how far the nearer of both dyads is from stretching or folding, mm.
    """

    crank: Float[Array, ""]
    ratios: Float[Array, "2"]
    winding: Float[Array, ""]
    slope: Float[Array, ""]
    reach: Float[Array, ""]


def transfer(finger: Finger, joints: Joints) -> Transfer:
    """The finger's transfer functions in one posture, in closed form: two dyads.

    It is `find_postures` for one posture and without the transmission angles: G-H-C decides the
    plate from DIP alone, then D-E-F decides the crank. Ratios by virtual velocities: along the rod
    D and E move equally fast, along the bar G and H do.

    Args:
        finger: its body and pins.
        joints: flexion of PIP and DIP, rad.
    """
    at = pins_of(finger).places()
    axis_b = Vector(finger.body.intermediate, jnp.zeros_like(joints[0]))
    phalanx = (at["C"] - axis_b).turned(rotation(-joints[1]))
    c = axis_b + phalanx
    bar_turn, plate_turn, reach = turn_dyad(
        c - at["G"], at["C"] - at["G"], at["H"] - at["G"], at["C"] - at["H"]
    )
    bar = (at["H"] - at["G"]).turned(bar_turn)
    plate = (at["D"] - at["C"]).turned(plate_turn)
    plate_ratio, _ = safe_divide(-phalanx.cross(bar), (at["G"] + bar - c).cross(bar))

    knuckle = rotation(-joints[0])
    d = (c + plate).turned(knuckle)
    swing, rod_turn, outer_reach = turn_dyad(
        d - at["F"], at["D"] - at["F"], at["E"] - at["F"], at["D"] - at["E"]
    )
    pull = (at["D"] - at["E"]).turned(rod_turn)
    lever = (at["E"] - at["F"]).turned(swing).cross(pull)
    pip_ratio, _ = safe_divide(d.cross(pull), lever)
    along = phalanx.turned(knuckle).cross(pull) + plate_ratio * plate.turned(knuckle).cross(pull)
    dip_ratio, _ = safe_divide(along, lever)
    return Transfer(
        crank=-swing.angle(),
        ratios=jnp.stack([pip_ratio, dip_ratio]),
        # The distal phalanx has turned by −DIP; relative to it the plate has turned by that more.
        winding=plate_turn.angle() + joints[1],
        slope=1 - plate_ratio,
        reach=jnp.minimum(reach, outer_reach),
    )


@jax.jit
def transfers(finger: Finger, joints: Float[Array, "postures 2"]) -> Transfer:
    """`transfer` of many postures, compiled."""
    return jax.vmap(transfer, (None, 0))(finger, joints)


class Pad(eqx.Module):
    """A pad in one posture: a segment in the proximal phalanx's frame.

    Attributes:
        start: its end near the joint, mm.
        along: unit vector from there to its other end; the finger lies to its left.
        length: mm.
        offset: distance of ``start`` from the phalanx's joint along the pad, mm.
    """

    start: Vector
    along: Vector
    length: Float[Array, ""]
    offset: Float[Array, ""]

    def at(self, along: Float[Array, " places"]) -> Vector:
        """Places on the pad, by their distance from the phalanx's joint along it."""
        return self.start + self.along.scaled(along - self.offset)


def pads(body: Body, joints: Joints) -> tuple[Pad, Pad]:
    """The pads of the intermediate and of the distal phalanx; see `Body` for where they end."""
    inner, outer = rotation(-joints[0]), rotation(-joints[0] - joints[1])
    axis_b = inner.scaled(body.intermediate)
    (pip, dip), down = body.gaps, body.palmar - body.protrusion
    first, second = Vector(pip, down).turned(inner), Vector(dip, down).turned(outer)
    return (
        Pad(first, inner, body.intermediate - pip - dip, pip),
        Pad(axis_b + second, outer, body.distal - body.rim - dip, dip),
    )
