"""The finger as a MuJoCo model: its linkage with spring, servo, joint stops and pads.

Driven slowly it goes as `closing.close` says. Over the default closings of design B, with the
softness of `kinematics.export.mjcf` (loops ``solref`` −1e8, −2e4; stops and contacts 0.001, 2; all
``solimp`` 0.9999), PIP differs by at most 0.01° and DIP by 0.02°, moments and contact forces by
0.1 % of the largest, and the pins of a loop are at most 0.001 mm apart.
"""

from __future__ import annotations

import math

import numpy as np

from kinematics.export.mjcf import Stop, linkage_mjcf
from kinematics.export.mjcf_bodies import Disc, Pad, PinholeCamera, Volume
from studies.models.finger import Finger, camera_of, spring_of
from studies.models.finger_parts import PHALANGES
from studies.models.grasp.objects import Circle
from studies.models.linkage_design.problem import pin_places

Place = tuple[float, float]

WIDEST = math.radians(120.0)
"""Field of view of a simulator's camera at most: a flat picture of more is all edge."""

MOTOR = "theta"
"""The input that the motor turns: the angle of the crank, which is the intermediate phalanx in a
coupled finger. Closing makes it smaller."""


def finger_volumes(finger: Finger) -> list[Volume]:
    """What the finger's parts take up at its two sides: bars, axles, and the faces of phalanges.

    Axles and bars lie in their layers; the faces, dorsal and palmar, and the tip's wall go through
    all layers outside the pads. (The rear wall has openings for the coupler and is left out.)
    Without links there are none.
    """
    links, body = finger.links, finger.body
    if links is None:
        return []
    at = {name: (float(x), float(y)) for name, (x, y) in pin_places(finger).items()}
    edges, half_bar = np.asarray(links.edges).tolist(), float(links.bar_width) / 2
    found = []

    def add(
        name: str, of: str, corners: list[Place], rounding: float, inner: int, outer: int
    ) -> None:
        low, high = edges[inner][0], edges[outer][1]
        for side, across in (("left", (low, high)), ("right", (-high, -low))):
            found.append(Volume(f"{name}, {side}", of, corners, rounding, across))

    for bar, pins in links.kind.outlines.items():
        corners = [at[pin] for pin in pins if pin in at]
        if len(corners) > 1:
            layer = links.layer_of(bar)
            add(bar, bar, corners, half_bar, layer, layer)
    for axle, (one, other) in {"A": PHALANGES[:2], "B": PHALANGES[1:]}.items():
        inner, outer = sorted((links.layer_of(one), links.layer_of(other)))
        # On both phalanges: a bar that hangs on one of them touches that of the other.
        for phalanx in (one, other):
            radius = float(links.axle_diameter) / 2
            add(f"axle {axle} of {phalanx}", phalanx, [at[axle]], radius, inner, outer)
    half, last = float(links.shell) / 2, len(edges) - 1
    palmar, dorsal = float(body.palmar) + half, float(body.dorsal) - half
    middle, tip = float(body.intermediate), float(body.intermediate + body.distal)
    root, (pip, dip) = -float(body.proximal), map(float, body.gaps)
    # Palmar faces end where the pads do, dorsal ones at the axes: flexion takes these apart.
    below = (root, -pip), (pip, middle - dip), (middle + dip, tip)
    above = (root, 0.0), (0.0, middle), (middle, tip)
    for face, height, spans in (("palmar", palmar, below), ("dorsal", dorsal, above)):
        for phalanx, (start, end) in zip(PHALANGES, spans, strict=True):
            line = [(start + half, height), (end - half, height)]
            add(f"{face} face of {phalanx}", phalanx, line, half, 1, last)
    wall = [(tip - half, palmar), (tip - half, dorsal)]
    add("tip", "distal", wall, half, 1, last)
    return found


def grasp_mjcf(finger: Finger, thing: Circle | None = None) -> str:
    """The text of a MuJoCo model of the finger, straight.

    It has what `conditions.energy` has: the spring, the servo between the motor's angle (the
    control of the actuator `MOTOR`) and the crank, stops of PIP and DIP, and pads that touch an
    object without friction. The proximal pad is there for objects that a user adds. Parts touch
    each other, but for those of bodies that share a pin; see `finger_volumes`. Sensors ``pip`` and
    ``dip`` read the flexion of the joints, and there is the finger's camera. A coupled finger has
    no spring, its bar is the only stop of DIP, and its motor reaches the angle that it is given.

    Args:
        finger: its body, pins and spring.
        thing: what it closes on, if anything.

    Raises:
        UserError: the finger has no pins, or no spring that its linkage needs.
    """
    kind = finger.kind
    motors = {MOTOR: float(spring_of(finger).servo)} if kind.springs else None
    joints = zip(kind.inputs["joints"], map(float, finger.body.flexions), strict=False)
    ends = dict(zip(PHALANGES, np.asarray(finger.pads(), float).tolist(), strict=True))
    discs = []
    if thing is not None:
        x, y = thing.center.tolist()
        discs.append(Disc("object", (x, y), float(thing.radius)))
    return linkage_mjcf(
        finger.linkage("crank"),
        motors=motors,
        stops=[Stop((host, body), -end, 0.0) for (_, body, host), end in joints],
        pads=[
            Pad(f"{name} pad", name, (start[0], start[1]), (end[0], end[1]))
            for name, (start, end) in ends.items()
        ],
        discs=discs,
        volumes=finger_volumes(finger),
        cameras=[_camera(finger)] if finger.camera is not None else [],
        angles={"pip": ("intermediate", "proximal"), "dip": ("distal", "intermediate")},
    )


def _camera(finger: Finger) -> PinholeCamera:
    """The camera as a pinhole: a simulator's camera has no other lens, so that it sees less."""
    camera = camera_of(finger)
    sold = camera.at(finger.body)
    x, y = np.asarray(sold.position, float).tolist()
    field, pixels = min(float(sold.field_of_view), WIDEST), round(float(sold.pixels))
    return PinholeCamera("camera", camera.phalanx, (x, y), float(sold.direction), field, pixels)
