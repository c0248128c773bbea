"""The problems of the study: objects in the places that its questions ask for."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from studies.models.finger import Finger
from studies.models.finger_parts import Body, FingerSpring
from studies.models.grasp.conditions import Problem
from studies.models.grasp.objects import Circle, Object, Polygon
from studies.models.grasp.spec import GraspSpec
from studies.models.pins import Pins

CHECK_RADIUS = 12.0
"""Least radius of the circle that is closed on, mm: that of the reference value."""

WRAP = 0.8
"""Largest part of the DIP range at which that circle is wrapped."""

PINCH_RADIUS = 8.0
"""Of the circles that are pinched, mm."""

REACH = 0.94
"""Largest part of the PIP range at which a circle on the proximal pad is first touched."""


def finger_of(spec: GraspSpec) -> Finger:
    """The finger of the settings."""
    spring = FingerSpring(spec.spring_stiffness, spec.preload, spec.servo_stiffness)
    return Finger.of(Body.of(spec.body), Pins.of(spec.pins), spring)


def problem_of(finger: Finger, thing: Object | None, load: tuple[float, float] = (0, 0)) -> Problem:
    """A problem at motor angle 0 with moments (N mm) that pull PIP and DIP open."""
    return Problem(finger, 0.0, -np.asarray(load, float), thing)


def touching(body: Body, pip: float, place: float, radius: float) -> Circle:
    """The circle that touches the intermediate phalanx ``place`` mm from A when PIP is ``pip``.

    Beyond the DIP axis it touches the distal phalanx, straight as it then is.
    """
    c, s = math.cos(pip), math.sin(pip)
    x, y = place, float(body.palmar) - radius
    return Circle(np.array([c * x + s * y, c * y - s * x]), radius)


class Touch(NamedTuple):
    """A circle on the intermediate pad.

    Attributes:
        pip: PIP flexion at which it touches, rad.
        place: k₁, its contact's distance from A, mm.
        radius: mm.
    """

    pip: float
    place: float
    radius: float


def _depth(body: Body) -> float:
    """Of the pads below the axes, mm."""
    return float(body.axis_height + body.protrusion)


def check_touch(body: Body) -> Touch:
    """The circle of the reference value (PIP 30°, k₁ = 11.5 mm, 12 mm), for any body.

    It touches halfway between the joints at a third of the range, and is so large that the distal
    pad touches it within the range.
    """
    (pip, dip), place = map(float, body.flexions), float(body.intermediate) / 2
    radius = place / math.tan(WRAP * dip / 2) - _depth(body)
    return Touch(pip / 3, place, max(CHECK_RADIUS, radius))


def circle_on_pad(body: Body, diameter: float, place: float) -> Circle:
    """The circle that lies on the proximal pad, ``place`` mm from A or nearer.

    It then touches the intermediate pad at the same distance from A, at
    PIP = 2 atan(place / (r + h)): A is equally far from both tangents.
    Small circles move nearer, so that this is within reach.
    """
    radius = diameter / 2
    farthest = (radius + _depth(body)) * math.tan(REACH * float(body.flexion) / 2)
    return Circle(np.array([-min(place, farthest), -_depth(body) - radius]), radius)


def wrapped_dip(body: Body, place: float, radius: float) -> float:
    """DIP at which a circle that touches the intermediate pad touches the distal one as well.

    In closed form, for B is equally far from both tangents: 2 atan((l − k₁) / (r + h)), rad.
    """
    over, across = float(body.intermediate) - place, radius + _depth(body)
    return 2 * math.atan(over / across)


def box(body: Body) -> Polygon:
    """A square of 24 mm that lies flat on the proximal pad, its near side 6 mm from A."""
    top = float(body.palmar)
    return Polygon(np.array([[-30.0, top - 24], [-6.0, top - 24], [-6.0, top], [-30.0, top]]))
