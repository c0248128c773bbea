"""The finger as a MuJoCo model: its linkage with spring, servo, joint stops and pads.

Driven slowly it goes as `closing.close` says. Over the default closings of design B, with the
softness of `kinematics.export.mjcf` (loops ``solref`` −1e8, −2e4; stops and contacts 0.001, 2; all
``solimp`` 0.9999), PIP differs by at most 0.01° and DIP by 0.02°, moments and contact forces by
0.1 % of the largest, and the pins of a loop are at most 0.001 mm apart.
"""

from __future__ import annotations

import numpy as np

from kinematics.export.mjcf import Stop, linkage_mjcf
from kinematics.export.mjcf_bodies import Disc, Pad
from studies.models.finger import PHALANGES, Finger, spring_of
from studies.models.grasp.objects import Circle

MOTOR = "theta"
"""The input that the motor turns: the crank's angle. Closing makes it smaller."""


def grasp_mjcf(finger: Finger, thing: Circle | None = None) -> str:
    """The text of a MuJoCo model of the finger, straight.

    It has what `conditions.energy` has: the spring, the servo between the motor's angle (the
    control of the actuator `MOTOR`) and the crank, stops of PIP and DIP, and pads that touch an
    object without friction. The proximal pad is there for objects that a user adds.

    Args:
        finger: its body, pins and spring.
        thing: what it closes on, if anything.

    Raises:
        UserError: the finger has no pins, or no spring.
    """
    spring, limit = spring_of(finger), float(finger.body.flexion)
    ends = dict(zip(PHALANGES, np.asarray(finger.pads(), float).tolist(), strict=True))
    discs = []
    if thing is not None:
        x, y = thing.center.tolist()
        discs.append(Disc("object", (x, y), float(thing.radius)))
    return linkage_mjcf(
        finger.linkage("crank"),
        motors={MOTOR: float(spring.servo)},
        stops=[
            Stop(("proximal", "intermediate"), -limit, 0.0),
            Stop(("intermediate", "distal"), -limit, 0.0),
        ],
        pads=[
            Pad(f"{name} pad", name, (start[0], start[1]), (end[0], end[1]))
            for name, (start, end) in ends.items()
        ],
        discs=discs,
    )
