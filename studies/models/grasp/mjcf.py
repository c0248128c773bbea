"""The finger as a MuJoCo model: its linkage with spring, servo, joint stops and pads.

Driven slowly it goes as `closing.close` says. Over the default closings of design B, with the
softness of `kinematics.export.mjcf` (loops ``solref`` −1e8, −2e4; stops and contacts 0.001, 2; all
``solimp`` 0.9999), PIP differs by at most 0.01° and DIP by 0.02°, moments and contact forces by
0.1 % of the largest, and the pins of a loop are at most 0.001 mm apart.
"""

from __future__ import annotations

import math

from kinematics.export.mjcf import Stop, linkage_mjcf
from kinematics.export.mjcf_bodies import Disc, Pad
from kinematics.model.linkage import Linkage
from studies.models.body import RIM, BodySpec
from studies.models.grasp.objects import Circle

MOTOR = "theta"
"""The input that the motor turns: the crank's angle. Closing makes it smaller."""


def grasp_mjcf(
    linkage: Linkage, body: BodySpec, servo_stiffness: float, thing: Circle | None = None
) -> str:
    """The text of a MuJoCo model of the finger, straight.

    It has what `conditions.energy` has: the spring, the servo between the motor's angle (the
    control of the actuator `MOTOR`) and the crank, stops of PIP and DIP, and pads that touch an
    object without friction. The proximal pad is there for objects that a user adds.

    Args:
        linkage: driven by its crank, with its spring; see `linkage_of`.
        body: the section.
        servo_stiffness: k_s, N mm/rad.
        thing: what it closes on, if anything.
    """
    limit = math.radians(body.range_deg)
    height, axis = body.axis_height, body.intermediate
    ends = {
        "proximal": (-body.proximal + RIM, -height),
        "intermediate": (height, axis - height),
        "distal": (axis + height, axis + body.distal - RIM),
    }
    discs = []
    if thing is not None:
        x, y = thing.centre.tolist()
        discs.append(Disc("object", (x, y), float(thing.radius)))
    return linkage_mjcf(
        linkage,
        motors={MOTOR: servo_stiffness},
        stops=[
            Stop(("proximal", "intermediate"), -limit, 0.0),
            Stop(("intermediate", "distal"), -limit, 0.0),
        ],
        pads=[
            Pad(f"{name} pad", name, (start, body.palmar), (end, body.palmar))
            for name, (start, end) in ends.items()
        ],
        discs=discs,
    )
