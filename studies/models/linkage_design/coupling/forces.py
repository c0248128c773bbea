"""What a force on the distal pad asks of motor, pins and bars of a coupled finger.

Coupling bar and coupler are two-force members, so that the balance of the distal phalanx, and then
that of the intermediate one, gives all forces. Both sides of the finger carry half of them. Without
friction, weight and deformation.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import ArrayLike

from designopt.numerics import safe_divide
from designopt.vectors import Vector, rotation
from studies.models.finger import Finger
from studies.models.finger_parts import Body
from studies.models.linkage_design.coupling.postures import (
    CoupledPostures,
    Row,
    find_coupled_postures,
)
from studies.models.linkage_design.forces import Loads


def find_moment(body: Body, postures: CoupledPostures, force: ArrayLike, place: ArrayLike) -> Row:
    """The moment of the motor that holds a force on the distal pad, by virtual work, N mm.

    Args:
        body: of the finger.
        postures: its own.
        force: on the pad at right angles, N.
        place: along the pad from the DIP axis, mm.
    """
    per_turn = place * (1 + postures.ratio) + body.intermediate * jnp.cos(postures.dip)
    return jnp.asarray(force) * per_turn


def find_loads(finger: Finger, pip: Row, force: ArrayLike, place: ArrayLike) -> tuple[Row, Loads]:
    """The motor's moment, and the forces in pins and bars, by the balance of every part.

    Args:
        finger: coupled.
        pip: flexion of PIP, rad.
        force: on the distal pad at right angles, N.
        place: along the pad from the DIP axis, mm.
    """
    postures = find_coupled_postures(finger, pip)
    at, body = postures.places, finger.body
    turn = rotation(-(pip + postures.dip))
    zero = jnp.zeros_like(body.intermediate)
    push = Vector(zero, zero + force).turned(turn)
    along = _unit(at["P"] - at["Q"])
    arm = (at["Q"] - at["B"]).cross(along)
    bar = along.scaled(safe_divide(-(zero + place) * force, arm)[0])
    # On the intermediate phalanx, which the axle presses as the distal one is not held otherwise.
    axle_b = bar + push
    moment = at["B"].cross(axle_b)
    axle_a, pins = axle_b, {}
    axial, bending = {"coupling": bar.length()}, {}
    if finger.motor is not None:
        towards = _unit(at["M"] - at["A"])
        pull = towards.scaled(safe_divide(-moment, at["K"].cross(towards))[0])
        axle_a = axle_b + pull
        pins = dict.fromkeys("KMN", pull.length())
        axial |= dict.fromkeys(("coupler", "driver"), pull.length())
        bending["driver"] = jnp.abs(moment)
    pins |= {"A": axle_a.length(), "B": axle_b.length(), "P": bar.length(), "Q": bar.length()}
    return moment, Loads(pins, bending, axial)


def _unit(along: Vector) -> Vector:
    length = along.length()
    return Vector(safe_divide(along.x, length)[0], safe_divide(along.y, length)[0])
