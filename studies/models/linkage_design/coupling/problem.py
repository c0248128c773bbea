"""The search's problem: the places of the coupling bar's two pins, over a grid of PIP."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.optimize import Evaluation, Problem, Requirement
from designopt.vectors import Vector, vector
from studies.models.finger import Finger, coupling_pins_of
from studies.models.link_layers import Meeting
from studies.models.linkage_design.clearances import (
    faces_of,
    find_clearances,
    find_free_meetings,
    name_of,
)
from studies.models.linkage_design.coupling.forces import find_moment
from studies.models.linkage_design.coupling.postures import (
    CoupledPostures,
    find_coupled_postures,
    with_motor_arm,
)
from studies.models.linkage_design.problem import LENGTH, TIP, coordinates, from_faces
from studies.models.linkage_design.spec import LimitsSpec, MotorSpec
from studies.models.linkage_kinds import COUPLED
from studies.models.pins import CouplingPins

TRANSMISSION = "μ_Q"
"""The transmission angle of the four-bar, between P-Q and B-Q."""

ASSEMBLY, GROWING, RANGE = "assembly of A-B-Q-P", "DIP growing with PIP", "DIP at the end of PIP"

APART = ("AP", "BQ", "PQ")
"""Pins whose distance the pins' places decide; that of K follows from the settings."""


class Asked(eqx.Module):
    """What a coupling is asked for, as data: one compiled program serves all settings.

    Attributes:
        finger: its body, links and motor; the pins are what is looked for.
        limits: what every posture must leave.
        motor: what turns the intermediate phalanx.
        allowance: kept beyond every length that is required, mm.
        pip: angles of PIP over its whole range, rad.
    """

    finger: Finger
    limits: LimitsSpec
    motor: MotorSpec
    allowance: Float[Array, ""]
    pip: Float[Array, " pip"]


def coupling_problem(
    finger: Finger,
    limits: LimitsSpec,
    pip: Float[np.ndarray, " pip"],
    allowance: float = 0.0,
    *,
    motor: MotorSpec,
) -> Problem:
    """Maximise the least transmission angle of the four-bar over angles of PIP.

    Args:
        finger: its body, links and motor; the pins are what is looked for.
        limits: what every posture must leave.
        pip: angles of PIP from straight to the end of its range, rad.
        allowance: kept beyond every length that is required, mm.
        motor: what turns the intermediate phalanx.

    Returns:
        A problem in `CouplingPins`, with ``least`` in rad, and `Asked` as its data.
    """
    body, keep = finger.body, from_faces(finger, limits) + allowance
    blank = replace(finger, pins=None, spring=None, camera=None, mirrors=(), layers=None)
    blank = replace(blank, assembly=None)
    asked = Asked(blank, limits, motor, jnp.asarray(allowance), jnp.asarray(pip))
    meetings = tuple(find_free_meetings(finger))
    low, high = body.palmar + keep, body.dorsal - keep
    rear, tip = keep - body.proximal, body.intermediate + body.distal - keep
    middle = body.intermediate
    # Beside their own phalanx, and as far into the intermediate one as bars of some length leave.
    lower, upper = (
        CouplingPins(*(jnp.stack([x, y]) for x in ends))
        for ends, y in (((rear, 0 * middle), low), ((0.9 * middle, tip), high))
    )
    scale = jax.tree.map(lambda leaf: jnp.full_like(leaf, LENGTH), lower)
    return Problem(
        _terms(meetings),
        lower,
        upper,
        scale,
        _requirements(meetings, np.rad2deg(pip)),
        coordinates(COUPLED.pins),
        (jax.tree.map(jnp.asarray, asked),),
    )


@functools.cache
def _terms(meetings: tuple[Meeting, ...]) -> Any:
    """The problem's terms; the same function for the same parts, so that it compiles once."""

    @jax.jit
    def terms(pins: CouplingPins, asked: Asked) -> Evaluation:
        limits, allowance = asked.limits, asked.allowance
        moved = with_motor_arm(replace(asked.finger, pins=pins), asked.motor.arm)
        postures = find_coupled_postures(moved, asked.pip)
        found = inequalities(moved, postures, limits, asked.motor, allowance)
        for name, between in find_clearances(moved, postures.places, meetings).items():
            found[name] = (between - limits.clearance - allowance) / LENGTH
        return Evaluation(least={TRANSMISSION: postures.transmission}, inequalities=found)

    return terms


def inequalities(
    finger: Finger,
    postures: CoupledPostures,
    limits: LimitsSpec,
    motor: MotorSpec,
    allowance: Any = 0.0,
) -> dict[str, Float[Array, "..."]]:
    """What the limits ask of a coupling; negative where it fails, scaled.

    All but the clearances of its parts from each other. Postures are from straight to the end of
    PIP's range.
    """
    body, pins = finger.body, coupling_pins_of(finger)
    # The turn, in rad, by which the allowance moves the shortest arm.
    turned = allowance / limits.spacing
    off = postures.dip[-1] - body.flexions[1]
    within = jnp.deg2rad(limits.dip_error_deg) - turned
    at = {name: vector(getattr(pins, name)) for name in COUPLED.pins} | axes(finger)
    apart = jnp.stack([(at[one] - at[other]).length() for one, other in APART])
    reach = body.distal - body.rim
    found = {
        ASSEMBLY: (postures.reach - limits.assembly - allowance) / LENGTH,
        GROWING: postures.ratio - limits.turn - turned,
        RANGE: (within + jnp.stack([off, -off])) / jnp.deg2rad(1.0),
        "pins apart": (apart - limits.spacing - allowance) / LENGTH,
        TIP: motor.moment / find_moment(body, postures, 1.0, reach) - limits.tip_force,
    }
    keep = from_faces(finger, limits) + allowance
    own = {"P": at["P"], "Q": at["Q"] - at["B"]}
    for name, place in own.items():
        for side, distance in faces_of(place, COUPLED.hosts[name], body).items():
            found[f"pin {name} inside the {side}"] = (distance - keep) / LENGTH
    return found


def axes(finger: Finger) -> dict[str, Vector]:
    """Both joints in the straight finger."""
    zero = jnp.zeros(())
    return {"A": Vector(zero, zero), "B": Vector(finger.body.intermediate, zero)}


def _requirements(
    meetings: tuple[Meeting, ...], pip_deg: Float[np.ndarray, " pip"]
) -> Mapping[str, Requirement]:
    def at_pip(name: str, index: tuple[int, ...]) -> str:
        return f"{name} at PIP {pip_deg[index[0]]:.3g}°" if index else name

    def pair(index: tuple[int, ...]) -> str:
        return f"pins {' and '.join(APART[index[0]])} apart"

    def end(index: tuple[int, ...]) -> str:
        return f"{'least' if index[0] == 0 else 'greatest'} {RANGE}"

    amounts = {
        TRANSMISSION: ("°", float(np.rad2deg(0.1))),
        ASSEMBLY: ("mm", LENGTH),
        GROWING: ("", 1.0),
        TIP: ("N", 1.0),
    }
    for name in "PQ":
        for side in ("palmar face", "dorsal face", "rear end", "tip"):
            amounts[f"pin {name} inside the {side}"] = ("mm", LENGTH)
    amounts |= {name_of(one): ("mm", LENGTH) for one in meetings}
    found = {
        name: Requirement(functools.partial(at_pip, name), *amount)
        for name, amount in amounts.items()
    }
    return found | {
        "pins apart": Requirement(pair, "mm", LENGTH),
        RANGE: Requirement(end, "°", 1.0),
    }
