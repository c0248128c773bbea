"""Why a linkage cannot be assembled: which loop its lengths do not close."""

from __future__ import annotations

import math

import numpy as np

from kinematics.io.assembling import Assembled, Dimensions
from kinematics.model.loops import Leg, Loop, find_vector_loops
from kinematics.model.topology import WORLD

ROUNDING = 1e-12
"""How much too short links may be, relative to the loop, and still count as stretched."""


def find_open_loop(dimensions: Dimensions) -> str | None:
    """The loop with a leg longer than the others together can reach; none if there is no such."""
    for loop in find_vector_loops(dimensions.structure):
        reaches = [_reach(dimensions, leg) for leg in loop.legs]
        for number, (least, _) in enumerate(reaches):
            others = sum(most for n, (_, most) in enumerate(reaches) if n != number)
            if least > others + ROUNDING * least:
                return _said(loop, loop.legs[number], least, others)
    return None


def _reach(dimensions: Dimensions, leg: Leg) -> tuple[float, float]:
    """The least and the largest distance between the two ends of a leg, mm."""
    ends = [incidence for incidence in (leg.start, leg.end) if incidence.slider is None]
    if len(ends) == 2:
        length = math.dist(*(dimensions.places[leg.body, end.joint] for end in ends))
        return length, length
    slides = [i.slider for i in (leg.start, leg.end) if i.slider is not None]
    angles = [dimensions.angles[slider] for slider in slides]
    along = np.array([math.cos(angles[0]), math.sin(angles[0])])
    if len(slides) == 2:
        if abs(math.sin(angles[1] - angles[0])) > ROUNDING:
            return 0.0, math.inf  # the lines cross
        other = dimensions.points[slides[1]]
    else:
        other = dimensions.places[leg.body, ends[0].joint]
    step = other - dimensions.points[slides[0]]
    return abs(float(along[0] * step[1] - along[1] * step[0])), math.inf


def _said(loop: Loop, leg: Leg, apart: float, others: float) -> str:
    on = "the fixed body" if leg.body == WORLD else f"'{leg.body}'"
    names = []
    for end in (leg.start, leg.end):
        names.append(end.joint if end.slider is None else f"the line of {end.joint}")
    return (
        f"bodies: the loop {loop} cannot close: its other links reach {others:.6g} mm, but "
        f"{names[0]} and {names[1]} are {apart:.6g} mm apart on {on} "
        f"(margin {others - apart:.3g} mm); change these lengths"
    )


def explain_open_linkage(assembled: Assembled) -> str:
    """Message for a linkage that no loop alone keeps from closing."""
    worst = [
        joint for joint, gap in assembled.gaps.items() if gap >= 0.5 * max(assembled.gaps.values())
    ]
    return (
        f"bodies: the linkage cannot be assembled: at best {', '.join(worst)} stay"
        f"{'s' if len(worst) == 1 else ''} {assembled.gap:.3g} mm apart from the bodies there; "
        "sketch it nearer to the wanted assembly, or change its lengths"
    )
