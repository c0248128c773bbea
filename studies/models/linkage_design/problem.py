"""The linkage as a design problem: the least transmission angle, in a body that can be built."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.io.spec import Spec
from designopt.optimize import Evaluation, Problem, Requirement
from designopt.vectors import Vector, rotation, vector
from studies.models.finger import Finger, linkage_pins, links_of, pins_of, spring_of
from studies.models.finger_parts import Body
from studies.models.link_layers import Meeting
from studies.models.linkage_design.clearances import (
    clearances_at,
    faces_of,
    find_free_meetings,
    name_of,
)
from studies.models.linkage_design.postures import Postures, postures_at
from studies.models.linkage_design.spec import LimitsSpec, MotorSpec
from studies.models.linkage_kinds import SIX_BAR, LinkageKind
from studies.models.pins import Pins, pin_name

LENGTH = 5.0
"""Lengths are scaled by it, mm."""

ANGLE = 0.1
"""The level of the transmission angles is scaled by it, rad."""

SYMBOLS = {"D1": "μ_D1", "D2": "μ_D2", "C": "μ_C", "H": "μ_G'", "E": "μ_E", "P": "μ_P"}
"""The transmission angles as people know them; H is the paper's G'."""

MOMENT = 10.0
"""Moments are scaled by it, N mm."""

PINCH_ALLOWANCE = 10.0
"""A pinch is asked for with so many times what the allowance is of the shortest link, as a part."""

PINCH, TIP = "pinch held", "force at the tip"

MOTOR = "transmission from the motor"
"""Name of the requirement on the parallelogram's own angle."""


def _coordinate(pin: str, index: tuple[int, ...]) -> str:
    return f"{'xy'[index[0]]} of pin {pin_name(pin)}"


def coordinates(pins: str) -> dict[str, Requirement]:
    """Names and unit of the parameters: the coordinates of pins, mm."""
    return {pin: Requirement(functools.partial(_coordinate, pin), "mm") for pin in pins}


def on_links(kind: LinkageKind) -> dict[str, str]:
    """Pins on every link of a kind of linkage.

    Example:
        >>> on_links(SIX_BAR)["distal phalanx"]
        'BC'
    """
    walls = {f"{phalanx} phalanx": pins for phalanx, pins in kind.walls.items()}
    return walls | dict(kind.outlines)


def pairs_on_links(pins: str, kind: LinkageKind = SIX_BAR) -> list[tuple[str, str]]:
    """Pins on one link whose distance the pins' places decide."""
    there = "AB" + pins
    links = ([pin for pin in link if pin in there] for link in on_links(kind).values())
    pairs = (pair for link in links for pair in combinations(link, 2))
    return [pair for pair in pairs if pair != ("A", "B")]


def pins_on_links(finger: Finger) -> dict[str, str]:
    """The pins on every link that the finger has."""
    there, links = pin_places(finger), on_links(finger.kind)
    pins = {link: "".join(pin for pin in on if pin in there) for link, on in links.items()}
    return {link: on for link, on in pins.items() if len(on) > 1}


def pin_places(finger: Finger) -> dict[str, Float[np.ndarray, "2"]]:
    """Places of A, B and all pins in the straight finger, plain numbers, mm."""
    pins = linkage_pins(finger)
    axes = {"A": np.zeros(2), "B": np.array([finger.body.intermediate, 0.0])}
    places = axes | {name: np.asarray(getattr(pins, name)) for name in pins.names}
    if finger.motor is not None:
        axis = np.asarray(finger.motor.axis(finger.body, pins))
        places |= {"M": axis, "N": axis + places["K"] - np.asarray(pins.crank_axis)}
    return places


USUAL_DEG = 90.0
"""Usual range of a joint, degrees."""

Angles = Float[np.ndarray, " angles"]
"""Flexion of one joint, rad."""


def grids(body: Body, step_deg: float) -> tuple[Angles, Angles]:
    """Flexion of PIP and of DIP from straight to the end of its range, both included, rad.

    A shorter range than `USUAL_DEG` has as many angles as that one, in smaller steps, for a
    compiled program is for one number of postures.
    """
    pip, dip = (
        np.deg2rad(np.linspace(0.0, end, math.ceil(max(end, USUAL_DEG) / step_deg - 1e-9) + 1))
        for end in body.ranges_deg
    )
    return pip, dip


def ends_of(body: Body) -> tuple[Vector, Vector]:
    """Turns of the intermediate and the distal phalanx at the ends of both joints' ranges."""
    pip, dip = (rotation(-jnp.reshape(end, (1,))) for end in body.flexions)
    return pip, dip


def with_motor_pin(finger: Finger, arm: float, ends: tuple[Vector, Vector]) -> Finger:
    """The finger with the crank's pin K where the motor's parallelogram transmits best.

    F-K is then at right angles to M-F in the middle of the crank's range, so that its transmission
    angle is nowhere less than 90° less half of that range.

    Args:
        finger: with pins and a motor; where it has K, that is replaced.
        arm: |FK|, mm.
        ends: `ends_of` its body.
    """
    assert finger.motor is not None
    pins = pins_of(finger)
    bare = replace(finger, motor=None, pins=replace(pins, K=None))
    crank_range = postures_at(bare, *ends).crank[0, 0]
    towards = vector(finger.motor.axis(finger.body, pins) - pins.F)
    along = towards.scaled(1 / towards.length()).turned(rotation((crank_range - jnp.pi) / 2))
    return replace(finger, pins=replace(pins, K=pins.F + arm * along.stacked()))


class Asked(eqx.Module):
    """What a linkage is asked for, as data: one compiled program serves all settings.

    Attributes:
        finger: its body, spring, links and motor; the pins are what is looked for.
        limits: what every posture must leave.
        motor: what turns the crank.
        allowance: kept beyond every length that is required, mm.
        ends: `ends_of` the body; a compiled program would compute them anew wherever it uses them.
    """

    finger: Finger
    limits: LimitsSpec
    motor: MotorSpec
    allowance: Float[Array, ""]
    ends: tuple[Vector, Vector]


def _numbers(spec: Spec) -> tuple[list[Any], tuple[type[Spec], tuple[str, ...]]]:
    fields = dict(spec)
    return list(fields.values()), (type(spec), tuple(fields))


def _spec(kind: tuple[type[Spec], tuple[str, ...]], numbers: Iterable[Any]) -> Spec:
    # Not validated again: under a transformation the numbers are no floats.
    return kind[0].model_construct(**dict(zip(kind[1], numbers, strict=True)))


for _kind in (LimitsSpec, MotorSpec):
    jax.tree_util.register_pytree_node(_kind, _numbers, _spec)


def linkage_problem(
    finger: Finger,
    limits: LimitsSpec,
    pip: Angles,
    dip: Angles,
    allowance: float = 0.0,
    *,
    motor: MotorSpec,
    meetings: Sequence[Meeting] | None = None,
) -> Problem:
    """Maximise the least of six transmission angles over a square of postures.

    Args:
        finger: its body; the pins are what is looked for.
        limits: what every posture must leave.
        pip: angles of PIP, rad; their combinations with those of DIP are the postures.
        dip: angles of DIP, rad.
        allowance: kept beyond every length that is required, mm.
        motor: what turns the crank.
        meetings: the parts whose clearance is asked for; all that can meet by default.

    Returns:
        A problem in `Pins`, with ``least`` in rad by the symbols of the angles, inequalities by
        the requirements' names, and `Asked` and the turns of the postures as its data.
    """
    if meetings is None:
        meetings = find_free_meetings(finger)
    blank = replace(finger, pins=None, camera=None, mirrors=(), layers=None, assembly=None)
    ends = ends_of(finger.body)
    asked = Asked(blank, limits, motor, jnp.asarray(allowance), ends)
    asked = jax.tree.map(jnp.asarray, asked)
    lower, upper = _box(finger, limits, allowance)
    scale = jax.tree.map(lambda leaf: jnp.full_like(leaf, LENGTH), lower)
    turns = (rotation(-jnp.asarray(angles)) for angles in (pip, dip))
    requirements = _requirements(finger, np.rad2deg(pip), np.rad2deg(dip))
    return Problem(
        _terms(tuple(meetings)),
        lower,
        upper,
        scale,
        requirements,
        coordinates(SIX_BAR.pins),
        (asked, *turns),
        name=f"linkage of a finger, clear at {meetings}",
    )


@functools.cache
def _terms(meetings: tuple[Meeting, ...]) -> Callable[..., Evaluation]:
    """The problem's terms; the same function for the same parts, so that it compiles once."""

    @jax.jit
    def terms(pins: Pins, asked: Asked, knuckle: Vector, flexion: Vector) -> Evaluation:
        limits, motor, allowance = asked.limits, asked.motor, asked.allowance
        moved = replace(asked.finger, pins=pins)
        if moved.motor is not None:
            moved = with_motor_pin(moved, motor.arm, asked.ends)
        postures = postures_at(moved, knuckle, flexion)
        found = inequalities(moved, postures, limits, allowance)
        found |= force_inequalities(moved, postures, limits, motor, allowance)
        for name, between in clearances_at(moved, postures, knuckle, meetings).items():
            found[name] = (between - limits.clearance - allowance) / LENGTH
        return Evaluation(
            least={SYMBOLS[name]: values for name, values in postures.angles.items()},
            inequalities=found,
        )

    return terms


def inequalities(
    finger: Finger, postures: Postures, limits: LimitsSpec, allowance: Any = 0.0
) -> dict[str, Float[Array, "..."]]:
    """What the limits ask of a design in given postures; negative where it fails, scaled.

    All but the clearances of its parts from each other.
    """
    body, pins = finger.body, pins_of(finger)
    keep = from_faces(finger, limits) + allowance
    # The turn, in rad, by which that moves the shortest link.
    turned = allowance / limits.spacing
    places = postures.inner | postures.outer | {"C": postures.distal_c}
    found = {
        "assembly of B-C-G'-G": (postures.reach[0] - limits.assembly - allowance) / LENGTH,
        "assembly of A-D-E-F": (postures.reach[1] - limits.assembly - allowance) / LENGTH,
        "crank closing with PIP": postures.pip_ratio - limits.turn,
        "crank closing with DIP": postures.dip_ratio - limits.turn,
        "plate turning with DIP": postures.gamma_slope - limits.turn,
        # Closing all the way, it is straight at one end of its range: no maximum, which a compiled
        # program would compute anew for every element beside it.
        "range of the crank": jnp.deg2rad(limits.crank_range_deg) - turned - postures.crank,
        "pins apart": (_distances(pins, body) - limits.spacing - allowance) / LENGTH,
        "|AF|": (vector(pins.F).length() - limits.crank_offset - allowance) / LENGTH,
        "|EF|": (limits.crank_length - allowance - vector(pins.E - pins.F).length()) / LENGTH,
    }
    for name in pins.names:
        for side, distance in faces_of(places[name], SIX_BAR.hosts[name], body).items():
            found[f"pin {pin_name(name)} inside the {side}"] = (distance - keep) / LENGTH
    if limits.force_ratio is not None:
        bound = limits.force_ratio * (1 - turned)
        found["φ₂/φ₁"] = bound * postures.pip_ratio - postures.dip_ratio
    return found


def force_inequalities(
    finger: Finger,
    postures: Postures,
    limits: LimitsSpec,
    motor: MotorSpec,
    allowance: Any = 0.0,
) -> dict[str, Float[Array, " pip"]]:
    """What a pinch asks of a design, whose first DIP angle is 0; negative where it fails, scaled.

    The stop of the DIP joint still presses, λ ≥ 0, and the motor is strong enough; see
    `forces.find_pinch_forces`.
    """
    body, spring = finger.body, spring_of(finger)
    first, second = postures.pip_ratio[:, 0], postures.dip_ratio[:, 0]
    wound = spring.stiffness * spring.preload * postures.gamma_slope[0]
    lever = limits.pinch_at * first - second * (limits.pinch_at + body.intermediate)
    # Near where it gives way the force goes with the inverse of a small difference of ratios.
    force = limits.pinch_force * (1 + PINCH_ALLOWANCE * allowance / limits.spacing)
    reach = body.distal - body.rim + body.intermediate
    return {
        PINCH: (wound * first + force * lever) / MOMENT,
        TIP: first * motor.moment / reach - limits.tip_force,
    }


def from_faces(finger: Finger, limits: LimitsSpec) -> Float[Array, ""]:
    """What axes of pins keep from faces and ends: half a bar, the shell and the clearance, mm."""
    links = links_of(finger)
    return links.bar_width / 2 + links.shell + limits.clearance


def _distances(pins: Pins, body: Body) -> Float[Array, " pairs"]:
    zero = jnp.zeros_like(body.intermediate)
    at = pins.places() | {"A": Vector(zero, zero), "B": Vector(body.intermediate, zero)}
    pairs = pairs_on_links(pins.names)
    return jnp.stack([(at[first] - at[second]).length() for first, second in pairs])


def _box(finger: Finger, limits: LimitsSpec, allowance: float) -> tuple[Pins, Pins]:
    """Where the pins may be in the straight finger.

    Over the height of their phalanx, and along it so far that designs of many kinds fit.
    """
    body, keep = finger.body, from_faces(finger, limits) + allowance
    low, high = body.palmar + keep, body.dorsal - keep
    rear, tip = -body.proximal + keep, body.intermediate + body.distal - keep
    length = body.intermediate
    spans = {
        "F": (rear * 0.6, 0.35 * length),
        "E": (rear, 0.25 * length),
        "D": (-0.65 * length, 0.65 * length),
        "C": (0.8 * length, (length + tip) / 2),
        "G": (-0.2 * length, length),
        "H": (-0.2 * length, 1.2 * length),
    }
    lower = Pins(**{name: jnp.array([span[0], low]) for name, span in spans.items()})
    upper = Pins(**{name: jnp.array([span[1], high]) for name, span in spans.items()})
    return lower, upper


def _requirements(
    finger: Finger,
    pip_deg: Float[np.ndarray, " pip"],
    dip_deg: Float[np.ndarray, " dip"],
) -> dict[str, Requirement]:
    lengths = ["assembly of B-C-G'-G", "assembly of A-D-E-F", "|AF|", "|EF|"]
    for name in SIX_BAR.hosts:
        for side in ("palmar face", "dorsal face", "rear end", "tip"):
            lengths.append(f"pin {pin_name(name)} inside the {side}")
    lengths += map(name_of, find_free_meetings(finger))
    ratios = ["crank closing with PIP", "crank closing with DIP", "plate turning with DIP", "φ₂/φ₁"]
    amounts = dict.fromkeys(lengths, ("mm", LENGTH)) | dict.fromkeys(ratios, ("", 1.0))
    amounts |= dict.fromkeys(SYMBOLS.values(), ("°", float(np.rad2deg(ANGLE))))
    amounts["range of the crank"] = ("°", float(np.rad2deg(1.0)))
    amounts |= {PINCH: ("N mm", MOMENT), TIP: ("N", 1.0)}
    pairs = pairs_on_links("FEDCGH" if finger.motor is None else "FEDCGHK")

    def at_pip(name: str, index: tuple[int, ...]) -> str:
        return f"{name} at PIP {pip_deg[index[0]]:.3g}°"

    def words(name: str, index: tuple[int, ...]) -> str:
        # What one angle decides is a row over DIP.
        axes = (("PIP", pip_deg), ("DIP", dip_deg))[2 - len(index) :]
        at = [f"{axis} {angles[i]:.3g}°" for (axis, angles), i in zip(axes, index, strict=True)]
        return f"{name} at {', '.join(at)}" if at else name

    def pair(index: tuple[int, ...]) -> str:
        first, second = pairs[index[0]]
        return f"pins {pin_name(first)} and {pin_name(second)} apart"

    found = {
        name: Requirement(
            functools.partial(at_pip if name in (PINCH, TIP) else words, name), *amount
        )
        for name, amount in amounts.items()
    }
    return found | {"pins apart": Requirement(pair, "mm", LENGTH)}
