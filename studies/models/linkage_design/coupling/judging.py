"""A coupled finger judged angle by angle by the general linkage solver."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.solution import Solution
from designopt.vectors import fold_angle
from kinematics.model.linkage import Linkage
from kinematics.solve.poses import solve_poses
from kinematics.solve.solver import Pose
from studies.models.checks import Check
from studies.models.finger import Finger, linkage_pins
from studies.models.linkage_design.coupling.forces import find_loads
from studies.models.linkage_design.coupling.problem import ASSEMBLY, GROWING, RANGE, TRANSMISSION
from studies.models.linkage_design.coupling.searching import pip_angles
from studies.models.linkage_design.coupling.walls import WALLS, find_wall_gap
from studies.models.linkage_design.judging import check_clear, check_inside, check_strength
from studies.models.linkage_design.problem import MOTOR, TIP, pairs_on_links, pin_places
from studies.models.linkage_design.spec import LimitsSpec, MotorSpec

DIP_ERROR = f"error of {RANGE}"
"""Name of the requirement that DIP reaches its range where PIP reaches its own."""


@dataclass(frozen=True)
class CoupledVerdict:
    """A coupled finger over its range.

    Attributes:
        pip_deg: angles of PIP, degrees.
        dip_deg: flexion of DIP at these, degrees.
        ratio: dDIP/dPIP, by the general solver's derivatives.
        angles_deg: transmission angles by name, degrees.
        moment: of the motor per force at the tip of the distal pad, N mm/N.
        checks: every requirement but that on the transmission angle.
    """

    pip_deg: Float[np.ndarray, " pip"]
    dip_deg: Float[np.ndarray, " pip"]
    ratio: Float[np.ndarray, " pip"]
    angles_deg: dict[str, Float[np.ndarray, " pip"]]
    moment: Float[np.ndarray, " pip"]
    checks: tuple[Check, ...]

    def check(self, name: str) -> Check:
        """The requirement of a name."""
        return next(one for one in self.checks if one.name == name)

    @property
    def least_deg(self) -> float:
        """The least transmission angle of the four-bar over all postures, degrees."""
        return float(np.min(self.angles_deg[TRANSMISSION]))

    @property
    def assembles(self) -> bool:
        """Whether the linkage assembles in every posture."""
        return self.checks[0].met

    @property
    def crank_range_deg(self) -> float:
        """How far the motor turns the intermediate phalanx, degrees."""
        return float(np.ptp(self.pip_deg))


def judge_coupled(finger: Finger, limits: LimitsSpec, motor: MotorSpec) -> CoupledVerdict:
    """A coupled finger over the whole range of PIP, every requirement with what it comes to.

    Args:
        finger: its body, pins and links.
        limits: what every posture must leave.
        motor: what turns the intermediate phalanx.
    """
    body, pins = finger.body, linkage_pins(finger)
    pip = pip_angles(body)
    poses, slope = _everywhere(finger.linkage(), -jnp.asarray(pip)[:, None])
    pose = poses.value
    bent = np.unwrap(-np.asarray(pose.bodies["distal"].angle()))
    dip, ratio = bent - pip, np.asarray(slope) - 1
    at = pose.joints
    angles = {TRANSMISSION: fold_angle(at["Q"] - at["B"], at["P"] - at["Q"])}
    off = abs(dip[-1] - float(body.flexions[1]))
    places, pairs = pin_places(finger), pairs_on_links(pins.names, pins.kind)
    reach = float(body.distal - body.rim)
    moment, _ = find_loads(finger, jnp.asarray(pip), 1.0, reach)
    _, loads = find_loads(finger, jnp.asarray(pip), limits.tip_force, reach)
    strongest = float(jnp.max(moment))
    turned, ok = float(np.rad2deg(np.ptp(pip))), int(jnp.sum(poses.ok))
    checks = [
        Check("postures that assemble", pip.size, ok, ""),
        Check(ASSEMBLY, limits.assembly, float(jnp.min(poses.margin))),
        Check(GROWING, limits.turn, float(np.min(ratio)), ""),
        Check(DIP_ERROR, limits.dip_error_deg, float(np.rad2deg(off)), "°", False),
        *(
            Check(
                f"pins {one} and {other} apart",
                limits.spacing,
                float(np.hypot(*(places[one] - places[other]))),
            )
            for one, other in pairs
        ),
        *check_inside(finger, pose, limits),
        *check_clear(finger, pose, limits),
        Check(WALLS, limits.clearance, float(jnp.min(find_wall_gap(finger, dict(at))))),
        Check(TIP, limits.tip_force, motor.moment / strongest, "N"),
        *check_strength(finger, loads, limits),
        Check("time to close", limits.closing_s, turned / motor.speed_deg, "s", False),
    ]
    if finger.motor is not None:
        pulled = fold_angle(at["K"] - at["A"], at["N"] - at["K"])
        angles["μ_K"] = pulled
        least = float(np.rad2deg(jnp.min(pulled)))
        checks.append(Check(MOTOR, limits.transmission_deg, least, "°"))
    degrees = {name: np.rad2deg(np.asarray(values)) for name, values in angles.items()}
    return CoupledVerdict(
        np.rad2deg(pip), np.rad2deg(dip), ratio, degrees, np.asarray(moment), tuple(checks)
    )


@jax.jit
def _everywhere(
    linkage: Linkage, inputs: Float[Array, "pip 1"]
) -> tuple[Solution[Pose], Float[Array, " pip"]]:
    """Poses by the general solver, and the turn of the distal phalanx per turn of PIP."""

    def turn(one: Float[Array, "1"]) -> Float[Array, ""]:
        return solve_poses(linkage, one).value.bodies["distal"].angle()

    return solve_poses(linkage, inputs), jax.vmap(jax.jacfwd(turn))(inputs)[:, 0]
