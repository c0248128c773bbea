"""Where the linkage is in every posture, and how it transmits, by the finger's own structure.

The linkage is two dyads. The first, G-H-C, lies between the intermediate and the distal phalanx:
it, and with it all of the plate, depends on DIP alone when seen from the intermediate phalanx. PIP
only turns the plate's pin D about A, and the second dyad, D-E-F, hangs on that. So the first is
solved for a row of DIP angles, and the second for the square of PIP and DIP angles.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_divide
from designopt.vectors import Vector, direction_to_meeting, fold_angle, rotation, vector
from kinematics.solve.dyads import solve_rrr
from studies.models.finger import Finger, pins_of


class Postures(eqx.Module):
    """A design in the postures of a grid; what DIP alone decides is a row, the rest a square.

    Attributes:
        inner: C, D, H and the finger tip T relative to A in the intermediate phalanx's frame, mm,
            rows; and G, which does not move there.
        distal_c: C relative to B in the distal phalanx's frame, mm; it does not move there.
        outer: E in the proximal phalanx's frame, mm, a square, and F, which does not move there;
            with a motor's parallelogram also K and N, squares, and M, which does not move there.
        reach: how far the dyads G-H-C (a row) and D-E-F (a square) are from the nearer of
            stretching and folding, mm; negative where they cannot be assembled.
        angles: transmission angles by name, rad, 0 to π/2, as `transmission.finger_transmission`
            defines them; ``C`` and ``H`` are rows.
        crank: turn φ of the crank from straight, rad, positive in the closing direction, a square.
        gamma_slope: dγ/dDIP of the plate's angle γ to the distal phalanx, a row.
        pip_ratio: φ₁ = ∂φ/∂PIP, a square.
        dip_ratio: φ₂ = ∂φ/∂DIP, a square.
    """

    inner: dict[str, Vector]
    distal_c: Vector
    outer: dict[str, Vector]
    reach: tuple[Float[Array, " dip"], Float[Array, "pip dip"]]
    angles: dict[str, Float[Array, "..."]]
    crank: Float[Array, "pip dip"]
    gamma_slope: Float[Array, " dip"]
    pip_ratio: Float[Array, "pip dip"]
    dip_ratio: Float[Array, "pip dip"]


def find_postures(finger: Finger, pip: Float[Array, " pip"], dip: Float[Array, " dip"]) -> Postures:
    """The linkage at all combinations of flexion angles; see `postures_at`.

    Args:
        finger: its body and pins.
        pip: flexion of the PIP joint, rad.
        dip: flexion of the DIP joint, rad.
    """
    return postures_at(finger, rotation(-pip), rotation(-dip))


def postures_at(finger: Finger, knuckle: Vector, flexion: Vector) -> Postures:
    """The linkage at all combinations of turns, each dyad on its side when straight.

    The turns are given as unit vectors, for a compiled program that turns angles into them itself
    does so anew wherever it uses them, which takes most of its time.

    Ratios by virtual velocities: along the rod D and E move equally fast, along the bar G and H do.

    Args:
        finger: its body and pins.
        knuckle: turns of the intermediate phalanx, one per PIP angle.
        flexion: turns of the distal phalanx in the intermediate one, one per DIP angle.
    """
    at = pins_of(finger).places()
    length = finger.body.intermediate
    axis_b = Vector(length, jnp.zeros_like(length))
    distal_c = at["C"] - axis_b

    # First dyad, in the intermediate phalanx's frame, one element per DIP angle.
    c = axis_b + distal_c.turned(flexion)
    bar, arm = at["H"] - at["G"], at["C"] - at["H"]
    turn, plate_turn, reach = turn_dyad(c - at["G"], at["C"] - at["G"], bar, arm)
    h = at["G"] + bar.turned(turn)
    d = c + (at["D"] - at["C"]).turned(plate_turn)
    bc, ch, along = c - axis_b, h - c, h - at["G"]
    plate_ratio, _ = safe_divide(-bc.cross(along), ch.cross(along))

    # Second dyad, in the proximal phalanx's frame, one element per posture.
    knuckle = knuckle[:, None]
    b, g = axis_b.turned(knuckle), at["G"].turned(knuckle)
    c_out, d_out, h_out = (place[None, :].turned(knuckle) for place in (c, d, h))
    crank, rod = at["E"] - at["F"], at["D"] - at["E"]
    swing, rod_turn, square_reach = turn_dyad(d_out - at["F"], at["D"] - at["F"], crank, rod)
    arm_e, pull = crank.turned(swing), rod.turned(rod_turn)
    e = at["F"] + arm_e
    lever = arm_e.cross(pull)
    pip_ratio, _ = safe_divide(d_out.cross(pull), lever)
    along_plate = (c_out - b).cross(pull)
    dip_ratio, _ = safe_divide(
        along_plate + plate_ratio[None, :] * (d_out - c_out).cross(pull), lever
    )
    outer = {"E": e, "F": at["F"]}
    if finger.motor is not None:
        axis, arm_k = (
            vector(finger.motor.axis(finger.body, pins_of(finger))),
            (at["K"] - at["F"]).turned(swing),
        )
        outer |= {"K": at["F"] + arm_k, "N": axis + arm_k, "M": axis}
    phalanx, bar_line = (b, c_out), (g, h_out)
    rod_line = (d_out, e)
    tip = axis_b + Vector(finger.body.distal, jnp.zeros_like(length)).turned(flexion)
    return Postures(
        inner={"C": c, "D": d, "G": at["G"], "H": h, "T": tip},
        distal_c=distal_c,
        outer=outer,
        reach=(reach, square_reach),
        angles={
            "D1": fold_angle(pull, d_out),
            "D2": fold_angle(pull, direction_to_meeting(d_out, phalanx, bar_line)),
            "C": fold_angle(bc, ch),
            "H": fold_angle(ch, along),
            "E": fold_angle(pull, arm_e),
            "P": fold_angle(direction_to_meeting(c_out, rod_line, bar_line), c_out - b),
        },
        crank=-swing.angle(),
        gamma_slope=1 - plate_ratio,
        pip_ratio=pip_ratio,
        dip_ratio=dip_ratio,
    )


def turn_dyad(
    e: Vector, straight: Vector, a: Vector, b: Vector
) -> tuple[Vector, Vector, Float[Array, "..."]]:
    """Turns of both links of a dyad from where they are in the straight finger, and its reach."""
    side = jnp.where(straight.cross(a) > 0, 1.0, -1.0).astype(a.x.dtype)
    turn, other, margins = solve_rrr(e, a, b, side, straight)
    return turn, other, jnp.minimum(*margins)
