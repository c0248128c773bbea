"""A design judged posture by posture by the general linkage solver, not by the search's code."""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.programs import QuickJit
from designopt.solution import Solution
from designopt.vectors import fold_angle
from kinematics.model.linkage import Linkage
from kinematics.solve.poses import solve_poses
from kinematics.solve.solver import Pose
from studies.models.checks import Check
from studies.models.finger import Finger, linkage_pins, links_of, pins_of
from studies.models.linkage_design.clearances import (
    faces_of,
    find_clearances,
    find_face_meetings,
    find_free_meetings,
)
from studies.models.linkage_design.forces import (
    Loads,
    find_held_force,
    find_pinch_forces,
    find_stresses,
)
from studies.models.linkage_design.problem import (
    MOTOR,
    PINCH,
    SYMBOLS,
    TIP,
    from_faces,
    grids,
    pairs_on_links,
    pin_places,
)
from studies.models.linkage_design.spec import LimitsSpec, MotorSpec
from studies.models.linkage_design.transmission import finger_transmission
from studies.models.pins import pin_name

STEP_DEG = 1.0
"""Step of the square of postures on which a design is judged, degrees."""


@dataclass(frozen=True)
class Verdict:
    """A design over the square of postures; squares have PIP along their first axis.

    Attributes:
        pip_deg: angles of PIP, degrees.
        dip_deg: angles of DIP, degrees.
        angles_deg: transmission angles by name, degrees, squares.
        crank_deg: turn of the crank from straight in the closing direction, degrees, a square.
        ratio: φ₂/φ₁ by differences of that, a square.
        checks: every requirement but that on the transmission angle.
    """

    pip_deg: Float[np.ndarray, " pip"]
    dip_deg: Float[np.ndarray, " dip"]
    angles_deg: dict[str, Float[np.ndarray, "pip dip"]]
    crank_deg: Float[np.ndarray, "pip dip"]
    ratio: Float[np.ndarray, "pip dip"]
    checks: tuple[Check, ...]

    @property
    def least_deg(self) -> float:
        """The least transmission angle over all postures, degrees."""
        return min(float(np.min(values)) for values in self.angles_deg.values())

    @property
    def assembles(self) -> bool:
        """Whether the linkage assembles in every posture."""
        return self.checks[0].met

    @property
    def crank_range_deg(self) -> float:
        """How far the crank turns over all postures, degrees."""
        return float(np.ptp(self.crank_deg))


def judged(finger: Finger, limits: LimitsSpec, motor: MotorSpec) -> Verdict:
    """A design over the whole square of postures, every requirement with what it comes to.

    Args:
        finger: its body, pins, links and spring.
        limits: what every posture must leave.
        motor: what turns the crank.
    """
    pip, dip = grids(finger.body, STEP_DEG)
    linkage = finger.linkage()
    square = np.stack(np.meshgrid(pip, dip, indexing="ij"), axis=-1)

    poses, angles = everywhere(linkage, -jnp.asarray(square))
    pose = poses.value
    crank, plate, distal = (
        np.asarray(pose.bodies[name].angle()) for name in ("crank", "plate", "distal")
    )
    crank = np.unwrap(np.unwrap(crank, axis=1), axis=0)
    crank, plate = crank[0, 0] - crank, np.unwrap(plate[0] - distal[0])
    crank_range = float(np.rad2deg(np.ptp(crank)))
    by_pip = np.diff(crank, axis=0) / np.diff(pip)[:, None]
    by_dip, by_plate = np.diff(crank, axis=1) / np.diff(dip), np.diff(plate) / np.diff(dip)
    rates = np.asarray(crank_rates(linkage, -jnp.asarray(square)))
    ratio = rates[..., 1] / rates[..., 0]
    at, pairs = pin_places(finger), pairs_on_links(pins_of(finger).names)
    apart = {(a, b): float(np.hypot(*(at[a] - at[b]))) for a, b in pairs}
    checks = [
        Check("postures that assemble", square[..., 0].size, int(jnp.sum(poses.ok)), ""),
        Check("dyads from lock-up", limits.assembly, float(jnp.min(poses.margin))),
        Check("crank closing with PIP", limits.turn, float(np.min(by_pip)), ""),
        Check("crank closing with DIP", limits.turn, float(np.min(by_dip)), ""),
        Check("plate turning with DIP", limits.turn, float(np.min(by_plate)), ""),
        Check("range of the crank", limits.crank_range_deg, crank_range, "°", False),
        *(
            Check(f"pins {pin_name(a)} and {pin_name(b)} apart", limits.spacing, apart[a, b])
            for a, b in pairs
        ),
        Check("|AF|", limits.crank_offset, apart["A", "F"]),
        Check("|EF|", limits.crank_length, apart["F", "E"], at_least=False),
        *check_inside(finger, pose, limits),
        *check_clear(finger, pose, limits),
        *_strong(finger, limits, motor, jnp.asarray(pip)),
        Check("time to close", limits.closing_s, crank_range / motor.speed_deg, "s", False),
    ]
    if finger.motor is not None:
        least = float(np.rad2deg(jnp.min(motor_angle(pose))))
        checks.append(Check(MOTOR, limits.transmission_deg, least, "°"))
    if limits.force_ratio is not None:
        checks.append(Check("φ₂/φ₁", limits.force_ratio, float(np.max(ratio)), "", False))
    degrees = {SYMBOLS[name]: np.rad2deg(np.asarray(values)) for name, values in angles.items()}
    angles_deg = np.rad2deg(pip), np.rad2deg(dip)
    return Verdict(*angles_deg, degrees, np.rad2deg(crank), ratio, tuple(checks))


@QuickJit
def everywhere(
    linkage: Linkage, inputs: Float[Array, "pip dip 2"]
) -> tuple[Solution[Pose], dict[str, Float[Array, "pip dip"]]]:
    """Poses and transmission angles by the general solver.

    Args:
        linkage: the joint-driven finger.
        inputs: angles of both joints, rad, flexion negative.
    """
    poses = solve_poses(linkage, inputs)
    return poses, finger_transmission(poses.value)


@QuickJit
def crank_rates(linkage: Linkage, inputs: Float[Array, "pip dip 2"]) -> Float[Array, "pip dip 2"]:
    """Turn of the crank per turn of each joint, by the general solver's derivatives.

    Args:
        linkage: the joint-driven finger.
        inputs: as in `everywhere`.
    """

    def turn(one: Float[Array, "2"]) -> Float[Array, ""]:
        return solve_poses(linkage, one).value.bodies["crank"].angle()

    return jax.vmap(jax.vmap(jax.jacfwd(turn)))(inputs)


def motor_angle(pose: Pose) -> Float[Array, "*batch"]:
    """Transmission angle of the motor's parallelogram, between coupler and crank, rad."""
    at = pose.joints
    return fold_angle(at["K"] - at["F"], at["N"] - at["K"])


def check_inside(finger: Finger, pose: Pose, limits: LimitsSpec) -> list[Check]:
    """That every pin keeps inside the faces and ends of its phalanx, in all poses.

    Args:
        finger: with pins and links.
        pose: its poses.
        limits: what is asked for.
    """
    checks, keep, pins = [], float(from_faces(finger, limits)), linkage_pins(finger)
    for name in pins.names:
        host, place = pins.kind.hosts[name], pose.joints[pin_name(name)]
        if host != "proximal":  # whose body points from O to A, and is fixed
            origin = pose.joints["B" if host == "distal" else "A"]
            place = (place - origin).turned(pose.bodies[host].conjugate())
        for side, distance in faces_of(place, host, finger.body).items():
            requirement = f"pin {pin_name(name)} inside the {side}"
            checks.append(Check(requirement, keep, float(jnp.min(distance))))
    return checks


def _strong(
    finger: Finger, limits: LimitsSpec, motor: MotorSpec, pip: Float[Array, " pip"]
) -> list[Check]:
    """Forces of pinches with the straight distal pad, and what they do to bars and pins."""
    body = finger.body
    tip = float(body.distal - body.rim)
    held = float(jnp.min(find_held_force(finger, pip, jnp.asarray([limits.pinch_at]))))
    each = find_pinch_forces(finger, pip, 1.0, tip)
    at_tip = motor.moment / float(jnp.max(each.crank_moment))
    loaded = find_pinch_forces(finger, pip, limits.tip_force, tip)
    return [
        Check(PINCH, limits.pinch_force, held, "N"),
        Check(TIP, limits.tip_force, at_tip, "N"),
        *check_strength(finger, loaded, limits),
    ]


def check_strength(finger: Finger, loads: Loads, limits: LimitsSpec) -> list[Check]:
    """Strength over stress in bars and pins, at least the factor of safety.

    Args:
        finger: with links.
        loads: with the force at the tip that is asked for.
        limits: what is asked for.
    """
    stresses, links, found = find_stresses(finger, loads), links_of(finger), []
    for part, of_each, strength in (
        ("bars", stresses.bars, links.bar_strength),
        ("pins", stresses.pins, links.pin_strength),
    ):
        stress = max(float(jnp.max(one)) for one in of_each.values())
        factor = float(strength) / stress if stress > 0 else math.inf
        found.append(Check(f"strength over stress in {part}", limits.safety, factor, ""))
    return found


_clearances = QuickJit(find_clearances, ["meetings"])


def check_clear(finger: Finger, pose: Pose, limits: LimitsSpec) -> list[Check]:
    """That moving parts keep clear of each other and of faces; arguments as of `check_inside`."""
    places = {"H" if name == pin_name("H") else name: at for name, at in pose.joints.items()}
    meetings = dict.fromkeys([*find_free_meetings(finger), *find_face_meetings(finger)])
    found = _clearances(finger, places, meetings=tuple(meetings))
    return [Check(name, limits.clearance, float(jnp.min(each))) for name, each in found.items()]
