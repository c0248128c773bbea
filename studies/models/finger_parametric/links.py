"""What is measured and required of a finger's linkage, six-bar or coupled."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.interpreter import interpret
from designopt.vectors import Vector, fold_angle, rotation, vector
from kinematics.solve.clearance import find_separation
from studies.models.finger import Finger, coupling_pins_of, linkage_pins, links_of
from studies.models.finger_parametric.asking import Arrays, Asked, achieved, asking, joined
from studies.models.finger_parts import FingerSpring
from studies.models.link_layers import Links, Meeting
from studies.models.linkage_design.analysis import layers_fit
from studies.models.linkage_design.clearances import (
    FACES,
    corners_of,
    face_corners,
    faces_of,
    find_face_meetings,
    find_free_meetings,
    name_of,
)
from studies.models.linkage_design.coupling.forces import find_loads
from studies.models.linkage_design.coupling.judging import DIP_ERROR, judge_coupled
from studies.models.linkage_design.coupling.postures import find_coupled_postures
from studies.models.linkage_design.coupling.problem import ASSEMBLY, GROWING, TRANSMISSION
from studies.models.linkage_design.coupling.walls import WALLS, find_wall_gap
from studies.models.linkage_design.forces import Loads, find_pinch_forces, find_stresses
from studies.models.linkage_design.judging import judged
from studies.models.linkage_design.postures import Postures, postures_at
from studies.models.linkage_design.problem import (
    ANGLE,
    LENGTH,
    MOMENT,
    MOTOR,
    PINCH,
    SYMBOLS,
    TIP,
    force_inequalities,
    from_faces,
    grids,
    inequalities,
    pairs_on_links,
)
from studies.models.linkage_design.spec import LimitsSpec, MotorSpec, SpringSpec
from studies.models.linkage_kinds import SIX_BAR
from studies.models.links import AXLES, OUTLINES, LinksTable
from studies.models.pins import pin_name

STEP_DEG = 15.0
"""Step of the postures in which a design is evaluated, as in the first solve of its search; it is
judged at every degree."""

DEGREES = float(np.rad2deg(1.0))

LEAST, WIDTH, LOCK_UP = "transmission angles", "width of the finger", "dyads from lock-up"
BARS, PINS = (f"strength over stress in {part}" for part in ("bars", "pins"))
CLOSING = "time to close"

KNOWN = {
    LEAST: "min_transmission",
    PINCH: "pinch_force",
    TIP: "tip_force",
    "range of the crank": "crank_range",
    "|AF|": "crank_offset",
    "|EF|": "crank_length",
    "φ₂/φ₁": "force_ratio",
    LOCK_UP: "lock_up",
    ASSEMBLY: "lock_up",
    WIDTH: "width",
    MOTOR: "mu.K",
} | {symbol: symbol.replace("μ_", "mu.") for symbol in (*SYMBOLS.values(), TRANSMISSION)}
"""Names of measures that people write, by the labels of their requirements."""


def completed(finger: Finger) -> Finger:
    """A finger with pins, and with the usual links and spring where it has none."""
    kind = finger.kind
    if finger.links is None:
        layers = [list(parts) for parts in kind.layers]
        finger = replace(finger, links=Links.of(LinksTable(layers=layers)))
    if finger.spring is None and kind.springs:
        spring = SpringSpec()
        usual = FingerSpring(spring.stiffness, spring.preload, spring.servo)
        finger = replace(finger, spring=usual)
    return finger


def own_limits(finger: Finger) -> LimitsSpec:
    """The limits of the settings for a finger of which only its file is known: with its width."""
    limits = LimitsSpec()
    width = max(limits.width, float(interpret(lambda one: links_of(completed(one)).width, finger)))
    return limits.model_copy(update={"width": width})


class LinkageAspect:
    """Transmission, forces and clearances of a finger's linkage over all its postures.

    Attributes:
        asked: all measures.
        gaps: the clearances; half a bar and the shell lie between a pin's axis and a face.
    """

    concerned: tuple[str, ...] = ("pins.", "body.", "spring.")

    def __init__(self, finger: Finger, limits: LimitsSpec, motor: MotorSpec) -> None:
        """Measures and requirements of a linkage.

        Args:
            finger: with pins.
            limits: what every posture must leave.
            motor: what turns the crank.
        """
        self._limits, self._motor = limits, motor
        made = completed(finger)
        self._six_bar = finger.kind is SIX_BAR
        self._angles = grids(finger.body, STEP_DEG)
        self._pairs = pairs_on_links(linkage_pins(finger).names, finger.kind)
        # All that a judgement has, so that both have the same requirements.
        self._meetings = (*dict.fromkeys([*find_free_meetings(made), *find_face_meetings(made)]),)
        self.gaps = dict[str, float]()
        self.asked = [
            *self._transmission(made),
            *self._motion(),
            *self._forces(),
            *self._room(made),
        ]

    def _ask(self, label: str, limit: float | None, *rest: Any, **more: Any) -> Asked:
        given = {"scale": LENGTH, "known": KNOWN, "where": self._where} | more
        return asking(label, limit, *rest, **given)

    def _where(self, index: tuple[int, ...]) -> str:
        """The posture of an element: squares have PIP along their first axis, rows are of one."""
        if len(index) != 2:
            return ""
        pip, dip = (np.rad2deg(one[i]) for one, i in zip(self._angles, index, strict=True))
        return f"at PIP {pip:.3g}°, DIP {dip:.3g}°"

    def _transmission(self, finger: Finger) -> Iterable[Asked]:
        least = self._limits.transmission_deg
        limits: dict[str, float | None] = {LEAST: least}
        limits |= dict.fromkeys(SYMBOLS.values() if self._six_bar else [TRANSMISSION])
        if finger.motor is not None:
            limits[MOTOR] = least
        for label, limit in limits.items():
            yield self._ask(label, limit, "°", scale=ANGLE * DEGREES, limits=(0.0, 90.0))

    def _motion(self) -> Iterable[Asked]:
        limits = self._limits
        yield self._ask(LOCK_UP if self._six_bar else ASSEMBLY, limits.assembly)
        if self._six_bar:
            for ratio in ("crank closing with PIP", "crank closing with DIP"):
                yield self._ask(ratio, limits.turn, "", scale=1.0)
            yield self._ask("plate turning with DIP", limits.turn, "", scale=1.0)
            most = limits.crank_range_deg
            yield self._ask("range of the crank", most, "°", "greatest", scale=DEGREES)
            if limits.force_ratio is not None:
                yield self._ask("φ₂/φ₁", limits.force_ratio, "", "greatest", scale=1.0)
        else:
            yield self._ask(GROWING, limits.turn, "", scale=1.0)
            yield self._ask(DIP_ERROR, limits.dip_error_deg, "°", "greatest", scale=1.0)
        yield self._ask(CLOSING, limits.closing_s, "s", "greatest", scale=1.0)

    def _forces(self) -> Iterable[Asked]:
        limits = self._limits
        if self._six_bar:
            yield self._ask(PINCH, limits.pinch_force, "N", scale=MOMENT / limits.pinch_at)
        yield self._ask(TIP, limits.tip_force, "N", scale=1.0)
        for label in (BARS, PINS):
            yield self._ask(label, limits.safety, "", scale=1.0)

    def _room(self, finger: Finger) -> Iterable[Asked]:
        limits = self._limits
        keep = float(interpret(partial(from_faces, limits=limits), finger))
        for label in self._apart:
            yield self._ask(label, limits.spacing)
        if self._six_bar:
            yield self._ask("|AF|", limits.crank_offset)
            yield self._ask("|EF|", limits.crank_length, "mm", "greatest")
        at = {name: Vector(jnp.zeros(()), jnp.zeros(())) for name in linkage_pins(finger).names}
        labels = list[str]()  # in their order, which JAX does not keep
        jax.eval_shape(lambda *given: labels.extend(_inside(*given)), finger, at)
        for label in labels:
            yield self._gap(label, keep, keep - limits.clearance)
        for meeting in self._meetings:
            yield self._gap(name_of(meeting), limits.clearance)
        if not self._six_bar:
            yield self._ask(WALLS, limits.clearance)
        yield self._ask(WIDTH, limits.width, "mm", "greatest")

    def _gap(self, label: str, limit: float, taken: float = 0.0) -> Asked:
        asked = self._ask(label, limit)
        self.gaps[asked.measure.name] = taken
        return asked

    @property
    def _apart(self) -> list[str]:
        return [f"pins {pin_name(one)} and {pin_name(other)} apart" for one, other in self._pairs]

    def evaluate(self, finger: Finger, of: frozenset[str]) -> Arrays:
        """Every measure in postures `STEP_DEG` apart, by the functions of the search."""
        del of  # they share their postures; what is not used is not compiled
        made = completed(finger)
        found = self._of_six_bar(made) if self._six_bar else self._of_coupled(made)
        pins = linkage_pins(made).places()
        zero = jnp.zeros_like(made.body.intermediate)
        pins |= {"A": Vector(zero, zero), "B": Vector(made.body.intermediate, zero)}
        for label, (one, other) in zip(self._apart, self._pairs, strict=True):
            found[label] = (pins[one] - pins[other]).length()
        found[WIDTH] = links_of(made).width
        named = {asked.label: asked.measure.name for asked in self.asked}
        return {named[label]: values for label, values in found.items()}

    def _of_six_bar(self, finger: Finger) -> Arrays:
        limits, motor, (pip, dip) = self._limits, self._motor, map(jnp.asarray, self._angles)
        postures = _row_by_row(finger, pip, dip)
        found = {SYMBOLS[name]: DEGREES * values for name, values in postures.angles.items()}
        found[LEAST] = joined(found.values())
        found[LOCK_UP] = joined(postures.reach)
        crank = DEGREES * postures.crank
        found |= {"range of the crank": crank, CLOSING: crank / self._motor.speed_deg}
        found |= {
            "crank closing with PIP": postures.pip_ratio,
            "crank closing with DIP": postures.dip_ratio,
            "plate turning with DIP": postures.gamma_slope,
        }
        slack = inequalities(finger, postures, limits)
        found["|AF|"] = limits.crank_offset + LENGTH * slack["|AF|"]
        found["|EF|"] = limits.crank_length - LENGTH * slack["|EF|"]
        if limits.force_ratio is not None:
            found["φ₂/φ₁"] = limits.force_ratio - slack["φ₂/φ₁"] / postures.pip_ratio
        strong = force_inequalities(finger, postures, limits, motor)
        # What a pinch has to spare at its place: infinite where it never gives way, the force
        # itself has no slope there.
        found[PINCH] = limits.pinch_force + MOMENT / limits.pinch_at * strong[PINCH]
        found[TIP] = limits.tip_force + strong[TIP]
        tip = finger.body.distal - finger.body.rim
        loads = jax.lax.map(
            lambda angle: find_pinch_forces(finger, angle[None], limits.tip_force, tip), pip
        )
        found |= _strength(finger, loads)
        found |= _inside(finger, postures.inner | postures.outer | {"C": postures.distal_c})
        found |= find_all_clearances(finger, _in_one_frame(finger, postures, pip), self._meetings)
        if finger.motor is not None:
            at = postures.outer
            found[MOTOR] = DEGREES * fold_angle(at["K"] - at["F"], at["N"] - at["K"])
        return found

    def _of_coupled(self, finger: Finger) -> Arrays:
        limits, motor, pip = self._limits, self._motor, jnp.asarray(self._angles[0])
        body = finger.body
        rows = jax.lax.map(lambda angle: find_coupled_postures(finger, angle[None]), pip)
        postures = jax.tree.map(lambda leaf: leaf[:, 0], rows)
        off = DEGREES * (postures.dip[-1] - body.flexions[1])
        transmission = DEGREES * postures.transmission
        found: Arrays = {LEAST: transmission, TRANSMISSION: transmission}
        found |= {ASSEMBLY: postures.reach, GROWING: postures.ratio}
        found[DIP_ERROR] = jnp.stack([off, -off])
        found[CLOSING] = DEGREES * body.flexion / motor.speed_deg
        reach = body.distal - body.rim
        moment, loads = find_loads(finger, pip, limits.tip_force, reach)
        found[TIP] = motor.moment * limits.tip_force / moment
        found |= _strength(finger, loads)
        at, axis_b = postures.places, Vector(body.intermediate, jnp.zeros(()))
        q = vector(coupling_pins_of(finger).Q) - axis_b
        found |= _inside(finger, at | {"Q": q})
        found |= find_all_clearances(finger, at, self._meetings)
        found[WALLS] = find_wall_gap(finger, at)
        if finger.motor is not None:
            found[MOTOR] = DEGREES * fold_angle(at["K"] - at["A"], at["N"] - at["K"])
        return found

    def judge(self, finger: Finger) -> dict[str, float]:
        """Every measure at every degree, by the general linkage solver."""
        made = completed(finger)
        verdict = (judged if self._six_bar else judge_coupled)(made, self._limits, self._motor)
        found = achieved((*verdict.checks, layers_fit(self._limits, links_of(made))), KNOWN)
        angles = {KNOWN.get(name): np.min(values) for name, values in verdict.angles_deg.items()}
        found |= {name: float(least) for name, least in angles.items() if name is not None}
        return found | {KNOWN[LEAST]: verdict.least_deg}


def _inside(finger: Finger, at: dict[str, Vector]) -> Arrays:
    """Distances of all pins from faces and ends; places of each in the frame of its phalanx."""
    pins = linkage_pins(finger)
    return {
        f"pin {pin_name(pin)} inside the {side}": distance
        for pin in pins.names
        for side, distance in faces_of(at[pin], pins.kind.hosts[pin], finger.body).items()
    }


def _row_by_row(finger: Finger, pip: Float[Array, " pip"], dip: Float[Array, " dip"]) -> Postures:
    """The postures of a square, one angle of PIP after the other.

    The loop keeps them in memory: XLA would compute them anew for each of the measures that follow,
    which takes a hundred times as long, to compile and to run.
    """
    flexion = rotation(-dip)
    rows = jax.lax.map(lambda angle: postures_at(finger, rotation(-angle[None]), flexion), pip)
    # What PIP decides, too, has one row each; all else is the same in every one.
    return jax.tree.map(lambda leaf: leaf[:, 0] if leaf.ndim == 3 else leaf[0], rows)


def _in_one_frame(
    finger: Finger, postures: Postures, pip: Float[Array, " pip"]
) -> dict[str, Vector]:
    """Axes and pins in the frame of the proximal phalanx, one for every posture."""
    zero, knuckle = jnp.zeros_like(finger.body.intermediate), rotation(-pip)[:, None]
    inner = jax.tree.map(lambda leaf: leaf[None] if leaf.ndim else leaf, postures.inner)
    inner |= {"B": Vector(finger.body.intermediate, zero)}
    found = {name: place.turned(knuckle) for name, place in inner.items()} | postures.outer
    return found | {"A": Vector(zero, zero), "O": Vector(-finger.body.proximal, zero)}


def find_all_clearances(
    finger: Finger, places: Mapping[str, Vector], meetings: Sequence[Meeting]
) -> Arrays:
    """`find_clearances` of many parts at once: one small program, whatever their number.

    Args:
        finger: with links.
        places: of axes and pins, in one frame.
        meetings: of parts whose pins have places.
    """
    links, radii, hulls = links_of(finger), [], ([], [])
    for one in meetings:
        if one.second in FACES:
            second, radius = face_corners(places, one.second, finger), 0.0
        elif one.second in OUTLINES:
            second, radius = corners_of(places, OUTLINES[one.second]), links.bar_width / 2
        else:
            diameter = links.axle_diameter if one.second in AXLES else links.pin_diameter
            second, radius = corners_of(places, one.second), diameter / 2
        radii.append(links.bar_width / 2 + radius)
        hulls[0].append(corners_of(places, OUTLINES[one.first]))
        hulls[1].append(second)
    batch = jnp.broadcast_shapes(
        *(one.shape[:-2] for one in hulls[1]), *(one.shape[:-2] for one in hulls[0])
    )

    def stacked(found: Sequence[Array]) -> Float[Array, "meetings *batch corners 2"]:
        """With the last corner once more where one has fewer, which adds nothing to a hull."""
        whole = (jnp.broadcast_to(one, (*batch, *one.shape[-2:])) for one in found)
        most = max(one.shape[-2] for one in found)
        return jnp.stack(
            [
                jnp.concatenate([one] + [one[..., -1:, :]] * (most - one.shape[-2]), axis=-2)
                for one in whole
            ]
        )

    between = find_separation(*map(stacked, hulls))
    return {name_of(one): between[i] - radii[i] for i, one in enumerate(meetings)}


def _strength(finger: Finger, loads: Loads) -> Arrays:
    """Strength over stress in all bars, and in all pins."""
    stresses, links = find_stresses(finger, loads), links_of(finger)
    return {
        label: joined(strength / one for one in of_each.values())
        for label, of_each, strength in (
            (BARS, stresses.bars, links.bar_strength),
            (PINS, stresses.pins, links.pin_strength),
        )
    }
