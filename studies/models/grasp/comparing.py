"""States of a closing beside the oracle's: forces by every link's balance, and many digits."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
from jaxtyping import Array

from studies.models.grasp.closing import Path
from studies.models.grasp.conditions import Problem
from studies.models.grasp.objects import Circle
from studies.models.grasp.transfer import Joints, pads
from studies.oracles import grasp as exact

SHUT = 1e-7
"""Contacts nearer than this (mm) and joints nearer to a stop (rad) can bear a force."""

LINKS = ("intermediate", "distal")


class Comparison(NamedTuple):
    """Both ways of computing forces on one path.

    Attributes:
        error: largest difference over all states: contact forces times 10 mm and moments of stops,
            and what the links' balance leaves, over the largest moment or force in play.
        states: how many were compared.
        undetermined: states with more holds than degrees of freedom, whose forces no statics gives.
    """

    error: float
    states: int
    undetermined: int


class ExactComparison(NamedTuple):
    """One state beside the same equilibrium in many digits.

    Attributes:
        joints: error of the flexion angles, rad.
        forces: error of motor moment and contact forces, over what the motor's angle, changed by
            its own size, would do to them (the condition-scaled error of
            `designopt.study.stability`).
        right: whether the choice of what holds was right and the reference was found, or no
            statics gives the forces, as more holds than degrees of freedom.
    """

    joints: float
    forces: float
    right: bool


def setting_of(problem: Problem, command: float) -> exact.Setting:
    """A problem in plain numbers, as the oracle takes it; of objects it takes circles."""
    finger, thing = problem.finger, problem.thing
    body, spring = jax.tree.map(float, (finger.body, problem.spring))
    (first, second), (pip, dip) = finger.body.gaps, finger.body.flexions
    circle = None
    if isinstance(thing, Circle):
        circle = complex(*thing.center.tolist()), float(thing.radius)
    return exact.Setting(
        pins={name: complex(*getattr(finger.pins, name).tolist()) for name in "CDEFGH"},
        lengths=(body.intermediate, body.distal),
        depth=body.axis_height + body.protrusion,
        starts=(float(first), float(second)),
        rim=body.rim,
        limits=(float(pip), float(dip)),
        spring=spring.stiffness,
        servo=spring.servo,
        preload=spring.preload,
        command=command,
        circle=circle,
    )


def holds(path: Path, state: int) -> tuple[tuple[float | None, float | None], np.ndarray]:
    """The stop on which each joint rests, or ``None``, and which contacts are closed."""
    limits = map(float, path.problem.finger.body.flexions)
    pip, dip = (
        0.0 if angle < SHUT else limit if angle > limit - SHUT else None
        for angle, limit in zip(path.joints[state].tolist(), limits, strict=True)
    )
    return (pip, dip), path.gaps[state] < SHUT


def compare(path: Path) -> Comparison:
    """Compare the forces of all states of a path that are equilibria with every link's balance."""
    setting = setting_of(path.problem, 0.0)
    load = (float(path.problem.load[0]), float(path.problem.load[1]))
    touching = (
        [] if path.problem.thing is None else _contacts(path.problem, jnp.asarray(path.joints))
    )
    touching = jax.tree.map(np.asarray, touching)
    worst, states, undetermined = 0.0, 0, 0
    for i in np.flatnonzero(path.ok).tolist():
        stops, closed = holds(path, i)
        held, shut = (stops[0] is not None, stops[1] is not None), np.flatnonzero(closed)
        if len(shut) + sum(held) > 2:
            undetermined += 1
            continue
        pip, dip = path.joints[i].tolist()
        pushes = []
        for pad, j in (divmod(j, path.per_pad) for j in shut.tolist()):
            place, normal = (complex(*part[i, j].tolist()) for part in touching[pad])
            pushes.append(exact.Push(LINKS[pad], place, normal))
        motor = float(path.motor[i])
        found = exact.balance(setting, (pip, dip), pushes, held, motor, load)
        wound = exact.winding(setting, dip, mpmath.fp) + setting.preload
        size = max(abs(motor), setting.spring * abs(wound), *map(abs, load), 1e-300)
        differences = [
            *(10 * (found.forces - path.forces[i][shut])),
            *(found.stops - np.where(held, path.stops[i], 0.0)),
        ]
        worst = max(worst, found.residual, *(abs(d) / size for d in differences))
        states += 1
    return Comparison(float(worst), states, undetermined)


def reference(path: Path, state: int) -> exact.Exact | None:
    """One state in many digits; ``None`` where it is undetermined or was not found."""
    held, closed = holds(path, state)
    setting = setting_of(path.problem, float(path.commands[state]))
    shut = bool(closed[0]), bool(closed[1])
    found: Any = exact.solve(setting, path.joints[state], held, shut)  # mpmath drops its type
    return found


def compare_exactly(path: Path, state: int) -> ExactComparison:
    """Compare one state with its reference."""
    held, closed = holds(path, state)
    if closed.sum() + sum(stop is not None for stop in held) > 2:
        return ExactComparison(0.0, 0.0, True)
    found = reference(path, state)
    if found is None or not found.right:
        return ExactComparison(math.inf, math.inf, False)
    servo = float(path.problem.spring.servo)
    joints = max(abs(float(a - b)) for a, b in zip(found.joints, path.joints[state], strict=True))
    moment = abs(float(found.motor)) + servo * abs(path.commands[state])
    errors = [float(found.motor) - path.motor[state]]
    errors += [10 * (float(a) - b) for a, b in zip(found.forces, path.forces[state], strict=True)]
    return ExactComparison(joints, float(np.max(np.abs(errors))) / moment, True)


@eqx.filter_jit
def _contacts(problem: Problem, joints: Array) -> list[tuple[Array, Array]]:
    """Places and normals of the contacts on each pad, shape (states, contacts, 2)."""
    thing = problem.thing
    assert thing is not None

    def on_pads(q: Joints) -> list[tuple[Array, Array]]:
        both = [(pad, thing.contacts(pad)) for pad in pads(problem.finger.body, q)]
        return [(pad.at(found.along).stacked(), found.normal.stacked()) for pad, found in both]

    return jax.vmap(on_pads)(joints)
