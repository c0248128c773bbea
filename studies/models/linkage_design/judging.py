"""A design judged posture by posture by the general linkage solver, not by the search's code."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.solution import Solution
from kinematics.model.linkage import Linkage
from kinematics.solve.poses import solve_poses
from kinematics.solve.solver import Pose
from studies.models.finger import Body, Finger
from studies.models.linkage_design.problem import HOSTS, PAIRS, SYMBOLS, grid, pin_places, sides
from studies.models.linkage_design.spec import LimitsSpec
from studies.models.linkage_design.transmission import finger_transmission
from studies.models.pins import pin_name

STEP_DEG = 1.0
"""Step of the square of postures on which a design is judged, degrees."""


ROUNDING = 1e-9
"""What a requirement may miss by rounding, in its unit."""


@dataclass(frozen=True)
class Check:
    """One requirement, as required and as achieved.

    Attributes:
        name: what is required.
        required: the limit.
        achieved: the worst value over all postures.
        unit: of both.
        at_least: whether the limit is a least value (else a greatest one).
    """

    name: str
    required: float
    achieved: float
    unit: str = "mm"
    at_least: bool = True

    @property
    def slack(self) -> float:
        """How far inside the limit, in its unit; negative where it is not met."""
        inside = self.achieved - self.required
        return inside if self.at_least else -inside

    @property
    def met(self) -> bool:
        """Whether it is met, but for rounding."""
        return self.slack >= -ROUNDING


@dataclass(frozen=True)
class Verdict:
    """A design over the square of postures; squares have PIP along their first axis.

    Attributes:
        flexion_deg: angles of either joint, degrees.
        angles_deg: transmission angles by name, degrees, squares.
        crank_deg: turn of the crank from straight in the closing direction, degrees, a square.
        ratio: φ₂/φ₁ by differences of that, a square.
        checks: every requirement but that on the transmission angle.
    """

    flexion_deg: Float[np.ndarray, " angles"]
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


def judged(finger: Finger, limits: LimitsSpec) -> Verdict:
    """A design over the whole square of postures, every requirement with what it comes to.

    Args:
        finger: its body and pins.
        limits: what every posture must leave.
    """
    body, flexion = finger.body, grid(finger.body, STEP_DEG)
    linkage = finger.linkage()
    square = np.stack(np.meshgrid(flexion, flexion, indexing="ij"), axis=-1)

    poses, angles = everywhere(linkage, -jnp.asarray(square))
    pose = poses.value
    crank, plate, distal = (
        np.asarray(pose.bodies[name].angle()) for name in ("crank", "plate", "distal")
    )
    crank = np.unwrap(np.unwrap(crank, axis=1), axis=0)
    crank, plate = crank[0, 0] - crank, np.unwrap(plate[0] - distal[0])
    crank_range = float(np.rad2deg(np.ptp(crank)))
    by_pip, by_dip = np.diff(crank, axis=0), np.diff(crank, axis=1)
    step = flexion[1] - flexion[0]
    rates = np.asarray(crank_rates(linkage, -jnp.asarray(square)))
    ratio = rates[..., 1] / rates[..., 0]
    at = pin_places(finger)
    apart = {(a, b): float(np.hypot(*(at[a] - at[b]))) for a, b in PAIRS}
    checks = [
        Check("postures that assemble", square[..., 0].size, int(jnp.sum(poses.ok)), ""),
        Check("dyads from lock-up", limits.assembly, float(jnp.min(poses.margin))),
        Check("turn of the crank per PIP", limits.turn, float(np.min(by_pip) / step), ""),
        Check("turn of the crank per DIP", limits.turn, float(np.min(by_dip) / step), ""),
        Check("turn of the plate per DIP", limits.turn, float(np.min(np.diff(plate)) / step), ""),
        Check("range of the crank", limits.crank_range_deg, crank_range, "°", False),
        *(
            Check(f"pins {pin_name(a)} and {pin_name(b)} apart", limits.spacing, apart[a, b])
            for a, b in PAIRS
        ),
        Check("|AF|", limits.crank_offset, apart["A", "F"]),
        Check("|EF|", limits.crank_length, apart["E", "F"], at_least=False),
        *_inside(pose, body, limits),
    ]
    if limits.force_ratio is not None:
        checks.append(Check("φ₂/φ₁", limits.force_ratio, float(np.max(ratio)), "", False))
    degrees = {SYMBOLS[name]: np.rad2deg(np.asarray(values)) for name, values in angles.items()}
    return Verdict(np.rad2deg(flexion), degrees, np.rad2deg(crank), ratio, tuple(checks))


@jax.jit
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


@jax.jit
def crank_rates(linkage: Linkage, inputs: Float[Array, "pip dip 2"]) -> Float[Array, "pip dip 2"]:
    """Turn of the crank per turn of each joint, by the general solver's derivatives.

    Args:
        linkage: the joint-driven finger.
        inputs: as in `everywhere`.
    """

    def turn(one: Float[Array, "2"]) -> Float[Array, ""]:
        return solve_poses(linkage, one).value.bodies["crank"].angle()

    return jax.vmap(jax.vmap(jax.jacfwd(turn)))(inputs)


def _inside(pose: Pose, body: Body, limits: LimitsSpec) -> list[Check]:
    checks = []
    for name, host in HOSTS.items():
        place = pose.joints[pin_name(name)]
        if host != "proximal":  # whose body points from O to A, and is fixed
            origin = pose.joints["B" if host == "distal" else "A"]
            place = (place - origin).turned(pose.bodies[host].conjugate())
        inside = min(float(jnp.min(side)) for side in sides(place, host, body).values())
        requirement = f"pin {pin_name(name)} inside the {host} phalanx"
        checks.append(Check(requirement, limits.clearance, inside))
    return checks
