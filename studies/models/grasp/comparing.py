"""Forces by virtual work beside forces by the balance of every link, state by state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from studies.models.grasp.closing import Path
from studies.models.grasp.conditions import Problem
from studies.models.grasp.free_body import Push, balance, pin_places
from studies.models.grasp.objects import Contacts
from studies.models.grasp.transfer import Joints, Pad, pads

SHUT = 1e-7
"""Contacts nearer than this (mm) and joints nearer to a stop (rad) can bear a force."""

LINKS = ("intermediate", "distal")


@dataclass(frozen=True)
class Comparison:
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


def compare(path: Path) -> Comparison:
    """Compare all states of a path that are equilibria."""
    finger, spring = path.problem.finger, path.problem.spring
    straight = {name: np.asarray(getattr(finger.pins, name)) for name in "FEDCGH"}
    middle, limit = float(finger.body.intermediate), float(finger.body.flexion)
    stiffness, preload = float(spring.stiffness), float(spring.preload)
    load = np.asarray(path.problem.load)
    touching = None if path.problem.thing is None else _touching(path)
    worst, states, undetermined = 0.0, 0, 0
    for i in np.flatnonzero(path.ok).tolist():
        joints = path.joints[i]
        shut = np.flatnonzero(path.gaps[i] < SHUT)
        held = (joints < SHUT) | (joints > limit - SHUT)
        if len(shut) + held.sum() > 2:
            undetermined += 1
            continue
        pushes = (
            [] if touching is None else [_push(touching, i, j, path.per_pad) for j in shut.tolist()]
        )
        at = pin_places(straight, middle, joints)
        plate, was = at["D"] - at["C"], straight["D"] - straight["C"]
        turned = np.arctan2(*plate[::-1]) - np.arctan2(*was[::-1]) + joints.sum()
        wound = np.angle(np.exp(1j * turned)) + preload
        found = balance(
            at,
            pushes,
            (bool(held[0]), bool(held[1])),
            motor=float(path.motor[i]),
            spring=stiffness * wound,
            load=load,
        )
        size = max(abs(path.motor[i]), stiffness * abs(wound), np.abs(load).max(), 1e-300)
        differences = [
            *(10 * (found.forces - path.forces[i][shut])),
            *(found.stops - np.where(held, path.stops[i], 0.0)),
        ]
        worst = max(worst, found.residual, *(abs(d) / size for d in differences))
        states += 1
    return Comparison(float(worst), states, undetermined)


@eqx.filter_jit
def _touch_all(problem: Problem, joints: Float[Array, "states 2"]) -> Any:
    thing = problem.thing
    assert thing is not None

    def one(q: Joints) -> Any:
        both = pads(problem.finger.body, q)
        return tuple(thing.contacts(pad) for pad in both), both

    return jax.vmap(one)(joints)


def _touching(path: Path) -> tuple[tuple[Contacts, Contacts], tuple[Pad, Pad]]:
    found = _touch_all(path.problem, jnp.asarray(path.joints))
    return jax.tree.map(np.asarray, found)


def _push(
    touching: tuple[tuple[Contacts, Contacts], tuple[Pad, Pad]],
    state: int,
    index: int,
    per_pad: int,
) -> Push:
    which, inner = divmod(index, per_pad)
    contact, pad = touching[0][which], touching[1][which]
    reach = contact.along[state, inner] - pad.offset[state]
    start = np.array([pad.start.x[state], pad.start.y[state]])
    along = np.array([pad.along.x[state], pad.along.y[state]])
    normal = np.array([contact.normal.x[state, inner], contact.normal.y[state, inner]])
    return Push(LINKS[which], start + reach * along, normal)
