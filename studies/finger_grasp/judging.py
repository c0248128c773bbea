"""States of a closing beside the same equilibria in many digits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import mpmath
import numpy as np

from studies.models.grasp.closing import Path
from studies.models.grasp.comparing import SHUT
from studies.models.grasp.conditions import Problem
from studies.models.grasp.objects import Circle
from studies.oracles import grasp as exact


@dataclass(frozen=True)
class Verdict:
    """One state beside its reference.

    Attributes:
        joints: error of the flexion angles, rad.
        forces: error of motor moment and contact forces, over what the motor's angle, changed by
            its own size, would do to them (the condition-scaled error of
            `designopt.study.stability`).
        right: whether the choice of what holds was right and the reference was found.
        open: more holds than degrees of freedom: no statics gives the forces, nothing is compared.
    """

    joints: float
    forces: float
    right: bool
    open: bool


def setting_of(problem: Problem, command: float) -> exact.Setting:
    """A problem on a circle in plain numbers."""
    finger, thing = problem.finger, problem.thing
    body, spring = jax.tree.map(float, (finger.body, problem.spring))
    assert isinstance(thing, Circle)
    return exact.Setting(
        pins={name: tuple(getattr(finger.pins, name).tolist()) for name in "CDEFGH"},
        lengths=(body.intermediate, body.distal),
        axis_height=body.axis_height,
        rim=body.rim,
        limit=body.flexion,
        values={
            "log_spring": math.log(spring.stiffness),
            "log_servo": math.log(spring.servo),
            "preload": spring.preload,
            "command": command,
        },
        circle=(*thing.center.tolist(), float(thing.radius)),
    )


def holds(path: Path, state: int) -> tuple[tuple[float | None, float | None], tuple[bool, bool]]:
    """Which stop each joint rests on, and which pads touch."""
    limit = float(path.problem.finger.body.flexion)
    held = [
        0.0 if angle < SHUT else limit if angle > limit - SHUT else None
        for angle in path.joints[state].tolist()
    ]
    closed = (path.gaps[state] < SHUT).tolist()
    return (held[0], held[1]), (closed[0], closed[1])


def reference(path: Path, state: int) -> exact.Exact | None:
    """One state in many digits; ``None`` where it is undetermined or was not found."""
    held, closed = holds(path, state)
    setting = setting_of(path.problem, float(path.commands[state]))
    with mpmath.workdps(exact.DIGITS):
        return exact.solve(setting, path.joints[state], held, closed)


def judge(path: Path, state: int) -> Verdict:
    """Compare one state with its reference."""
    held, closed = holds(path, state)
    if sum(closed) + sum(stop is not None for stop in held) > 2:
        return Verdict(0.0, 0.0, True, True)
    found = reference(path, state)
    if found is None or not found.right:
        return Verdict(math.inf, math.inf, False, False)
    servo = float(path.problem.spring.servo)
    joints = max(abs(float(a - b)) for a, b in zip(found.joints, path.joints[state], strict=True))
    moment = abs(float(found.motor)) + servo * abs(path.commands[state])
    errors = [float(found.motor) - path.motor[state]]
    errors += [10 * (float(a) - b) for a, b in zip(found.forces, path.forces[state], strict=True)]
    return Verdict(joints, float(np.max(np.abs(errors))) / moment, True, False)
