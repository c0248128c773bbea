"""Stiff and extreme closings of the finger, judged state by state in many digits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from designopt.study.results import StabilityRow
from studies.models.finger import Finger, spring_of
from studies.models.finger_parts import FingerSpring
from studies.models.grasp import cases
from studies.models.grasp.closing import LANES, STEPS, close_all, there_and_back
from studies.models.grasp.comparing import compare_exactly
from studies.models.grasp.conditions import Problem
from studies.models.grasp.objects import Circle

TOLERANCE = 1e-9
"""Largest error of a state that is no failure, rad for joints and relative for forces."""

JUDGED = (30, 55, 80)
"""States that are judged, one of every closing in turn: soon after touching, later, at the end."""


class Family(NamedTuple):
    """Closings that are extreme in one respect."""

    case: str
    problems: list[Problem]
    commands: np.ndarray


def families(finger: Finger, end: float, seed: int) -> Iterator[Family]:
    """Every family; ``seed`` draws the mixed stiffnesses.

    Args:
        finger: the design with its ordinary stiffnesses.
        end: motor angle to close to, rad.
        seed: of the random draws.
    """
    body, middle = finger.body, float(finger.body.intermediate)
    height = float(body.axis_height)
    motion = np.tile(there_and_back(end), (LANES, 1))
    check = [cases.touching(body, *cases.check_touch(body))] * LANES
    decades = np.linspace(-6, 6, LANES)
    random = np.random.default_rng(seed)
    mixed = random.uniform(-6, 6, (LANES, 2))
    diameters = random.uniform(15, 90, LANES)
    own, same = spring_of(finger), [finger] * LANES
    usual = [math.log10(float(stiffness)) for stiffness in (own.stiffness, own.servo)]

    def stiff(spring: float, servo: float) -> Finger:
        return replace(finger, spring=FingerSpring(10.0**spring, own.preload, 10.0**servo))

    def family(
        case: str, fingers: list[Finger], things: list[Circle], commands: np.ndarray = motion
    ) -> Family:
        return Family(case, [*map(cases.problem_of, fingers, things)], commands)

    yield family("spring of 1e-6 to 1e6 N mm/rad", [stiff(d, usual[1]) for d in decades], check)
    yield family("servo of 1e-6 to 1e6 N mm/rad", [stiff(usual[0], d) for d in decades], check)
    things = [cases.circle_on_pad(body, diameter, 11.5) for diameter in diameters]
    fingers = [stiff(*pair) for pair in mixed]
    yield family("both drawn from 1e-6 to 1e6, circles of 15 to 90 mm", fingers, things)
    # The last place on the intermediate pad, and half a millimetre on either side of it.
    short, beyond = -(10.0 ** np.linspace(-0.3, -9, 5)), 10.0 ** np.linspace(-9, -0.3, 6)
    places = middle - height + np.concatenate([short, [0.0], beyond])
    things = [cases.touching(body, 0.6, place, 12.0) for place in places]
    yield family("contact at a pad's end, within 1e-9 to 0.5 mm", same, things)
    # A circle before the DIP axis touches the ends of both pads of the straight finger at once.
    things = []
    for radius in np.linspace(1.1, 4.0, LANES) * height:
        under = cases.touching(body, 0.7, middle, radius)
        things.append(Circle(under.center + _inward(0.7, radius, height), radius))
    yield family("both pads touched at once, at their ends", same, things)
    places = middle + np.linspace(4.5, 16, LANES)
    things = [cases.touching(body, 0.5, place, cases.PINCH_RADIUS) for place in places]
    further = np.tile(np.linspace(0, 2 * end, STEPS), (LANES, 1))
    yield family("pinches loaded beyond their limit", same, things, further)


def _inward(pip: float, radius: float, height: float) -> np.ndarray:
    """From a circle that would touch under B to the one that touches ``height`` beside B."""
    lift = radius - math.sqrt(max(radius**2 - height**2, 0.0))
    return lift * np.array([math.sin(pip), math.cos(pip)])


def assess(family: Family) -> StabilityRow:
    """Close a family and judge its states; a state without an equilibrium is a failure.

    Gradients are judged by the test suite, against central differences; here they are NaN.
    """
    failures = states = non_finite = 0
    worst = 0.0
    for lane, path in enumerate(close_all(family.problems, family.commands)):
        numbers = (path.joints, path.motor, path.forces, path.residual, path.margin, path.stops)
        non_finite += sum(int(np.sum(~np.isfinite(part))) for part in numbers)
        states += len(path.ok)
        failures += int(np.sum(~path.ok))
        state = JUDGED[lane % len(JUDGED)]
        if path.ok[state]:
            found = compare_exactly(path, state)
            error = max(found.joints, found.forces)
            worst = max(worst, error)
            failures += not (found.right and error <= TOLERANCE)
    return StabilityRow(
        case=family.case,
        dtype="float64",
        cases=states,
        infeasible=0,
        failures=int(failures),
        worst_error=float(worst),
        worst_gradient_error=math.nan,
        worst_gradient_relative_error=math.nan,
        non_finite=non_finite,
    )
