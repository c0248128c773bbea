"""The three-phalanx finger of paper B: what its linkage transmits, by the names of its pins.

Pins are those of ``gallery/linkages/finger.toml``: A (PIP) and B (DIP) carry the phalanges, plate
C-D-G', rod D-E, crank F-E, bar G-G'.
"""

from __future__ import annotations

from jaxtyping import Array, Float

from designopt.vectors import direction_to_meeting, fold_angle
from kinematics.solve.solver import Pose

Angle = Float[Array, "*batch"]


def finger_transmission(pose: Pose) -> dict[str, Angle]:
    """Transmission angles of the finger, rad, 0 to π/2.

    Where a body is held by two links, force acts along the line to the point in which they meet,
    its instant centre; that and not the angle between the links decides.

    Returns:
        ``D1``: rod to AD, crank to PIP. ``D2``: rod to ID with I the meeting point of BC and GG',
        crank to DIP. ``C`` and ``H``: of the four-bar B-C-G'-G, at C and at G'. ``E``: crank to
        rod, the motor's side. ``P``: of the force on pin C, along CP with P the meeting point of
        rod and bar, to the distal phalanx BC.
    """
    at = pose.joints
    h, rod, phalanx = at["G'"], at["E"] - at["D"], (at["B"], at["C"])
    bar = (at["G"], h)
    return {
        "D1": fold_angle(rod, at["D"] - at["A"]),
        "D2": fold_angle(rod, direction_to_meeting(at["D"], phalanx, bar)),
        "C": fold_angle(at["C"] - at["B"], h - at["C"]),
        "H": fold_angle(h - at["C"], at["G"] - h),
        "E": fold_angle(rod, at["E"] - at["F"]),
        "P": fold_angle(direction_to_meeting(at["C"], (at["D"], at["E"]), bar), at["C"] - at["B"]),
    }
