"""The conditions of the finger's equilibrium, as equations and as an energy.

The energy U(q) = ½ k (Δγ(q₂) + γ_p)² + ½ k_s (φ(q) − α)² − load · q is least where no pad overlaps
the object and both joints are within their stops. Its conditions, with motor moment
T_a = k_s (α − φ) and contact forces f_i ≥ 0 at gaps g_i ≥ 0 (Birglen, Laliberté & Gosselin,
*Underactuated Robotic Hands*, 2008, ch. 3; the elastic servo is this project's):

    F = ∇U − Σ f_i ∇g_i,   F_j ≥ 0 at the lower stop, ≤ 0 at the upper one, 0 between them.

Unknowns are q, T_a and f. T_a is kept beside q, and moments are counted in √(k k_s): then no
coefficient is larger than √(k / k_s) or its inverse; the raw equations spread over k / k_s.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.numerics import as_float, safe_sqrt
from designopt.vectors import rotation
from studies.models.finger import Finger, spring_of
from studies.models.finger_parts import FingerSpring
from studies.models.grasp.objects import Object
from studies.models.grasp.transfer import Joints, pads, transfer


class Problem(eqx.Module):
    """What an equilibrium is asked of.

    Attributes:
        finger: the design.
        command: α, angle of the motor behind its servo stiffness, rad, 0 in the straight finger.
        load: moments on PIP and DIP from elsewhere, N mm, positive in flexion.
        thing: what is grasped; ``None`` leaves contacts out of the equations.
        drag: moment that resists every joint over the angle it moves from ``resting``, in moment
            units per rad; 0 in an equilibrium.
        resting: joints from where a drag counts, rad.
    """

    finger: Finger
    command: Float[Array, ""] = eqx.field(converter=as_float)
    load: Float[Array, "2"] = eqx.field(converter=as_float)
    thing: Object | None
    drag: Float[Array, ""] = eqx.field(converter=as_float, default=0.0)
    resting: Float[Array, "2"] = eqx.field(converter=as_float, default_factory=lambda: np.zeros(2))

    @property
    def spring(self) -> FingerSpring:
        """The finger's spring and servo.

        Moments are computed in its `moment_unit`, forces in that over `length_unit`.
        """
        return spring_of(self.finger)

    @property
    def length_unit(self) -> Float[Array, ""]:
        """Length between the two joints, mm; gaps are computed in this unit."""
        return self.finger.body.intermediate

    @property
    def limit(self) -> Float[Array, "2"]:
        """Upper stops of PIP and DIP, rad."""
        return jnp.stack(self.finger.body.flexions)


class Unknowns(eqx.Module):
    """Joints (rad), motor moment in the spring's moment unit, forces in that over `length_unit`."""

    joints: Float[Array, "*batch 2"]
    motor: Float[Array, "*batch"]
    forces: Float[Array, "*batch contacts"]


class Touch(eqx.Module):
    """All contacts of a posture, those of the intermediate pad first.

    Attributes:
        gaps: over the length unit.
        slopes: their derivatives by PIP and DIP.
        along: mm from the phalanx's joint along its pad.
    """

    gaps: Float[Array, " contacts"]
    slopes: Float[Array, "contacts 2"]
    along: Float[Array, " contacts"]


class Parts(eqx.Module):
    """What the equations are made of.

    Attributes:
        lag: α − φ, rad.
        slack: F, the moment that stops have to bear, in moment units.
        touch: all contacts.
        ratios: φ₁ and φ₂.
        reach: of the dyads, mm.
    """

    lag: Float[Array, ""]
    slack: Float[Array, "2"]
    touch: Touch
    ratios: Float[Array, "2"]
    reach: Float[Array, ""]


class Linear(eqx.Module):
    """The mechanism with its derivatives by the joints: of ``slack``, and of ``touch.gaps``."""

    parts: Parts
    curvature: Float[Array, "2 2"]
    lifts: Float[Array, "contacts 2"]


@jax.jit  # traced once, though its shapes are asked for before the iteration
def linear_at(problem: Problem, unknowns: Unknowns) -> Linear:
    """The mechanism in one posture, seen once for values and derivatives."""

    def at(joints: Joints) -> tuple[Any, Parts]:
        parts = parts_at(problem, eqx.tree_at(lambda u: u.joints, unknowns, joints))
        return (parts.slack, parts.touch.gaps), parts

    (curvature, lifts), parts = jax.jacfwd(at, has_aux=True)(unknowns.joints)
    return Linear(parts, curvature, lifts)


def parts_at(problem: Problem, unknowns: Unknowns) -> Parts:
    """What all conditions are made of, in one posture."""
    finger, joints = problem.finger, unknowns.joints
    found = transfer(finger, joints)
    spring = problem.spring.contrast * (found.winding + problem.spring.preload) * found.slope
    slack = -unknowns.motor * found.ratios - problem.load / problem.spring.moment_unit
    slack = slack + jnp.stack([jnp.zeros_like(spring), spring])
    slack = slack + problem.drag * (joints - problem.resting)
    touch = touches(problem, joints)
    slack = slack - touch.slopes.T @ unknowns.forces
    return Parts(problem.command - found.crank, slack, touch, found.ratios, found.reach)


def touches(problem: Problem, joints: Joints) -> Touch:
    """Where both pads are nearest to the object, and how their gaps change with the joints.

    A gap changes as fast as the pad's nearest point moves along the contact's normal: what slides
    along the object or along the pad changes no distance. That is the virtual work of a force too.
    """
    body, thing = problem.finger.body, problem.thing
    if thing is None:
        nothing = jnp.zeros((0,), joints.dtype)
        return Touch(nothing, jnp.zeros((0, 2), joints.dtype), nothing)
    unit = problem.length_unit
    axis_b = rotation(-joints[0]).scaled(body.intermediate)
    found, slopes = [], []
    for pad, moved_by_dip in zip(pads(body, joints), (False, True), strict=True):
        contact = thing.contacts(pad)
        place = pad.at(contact.along)
        # Flexion is clockwise: it moves a point at (x, y) from its axis towards (y, −x).
        by_pip, by_dip = (contact.normal.cross(arm) for arm in (place, place - axis_b))
        slopes.append(
            jnp.stack([by_pip, by_dip if moved_by_dip else jnp.zeros_like(by_dip)], axis=1)
        )
        found.append(contact)
    return Touch(
        jnp.concatenate([contact.gap for contact in found]) / unit,
        jnp.concatenate(slopes) / unit,
        jnp.concatenate([contact.along for contact in found]),
    )


def energy(problem: Problem, joints: Joints) -> Float[Array, ""]:
    """U(q) over the spring's `moment_unit`."""
    found, contrast = transfer(problem.finger, joints), problem.spring.contrast
    wound, lag = found.winding + problem.spring.preload, problem.command - found.crank
    work = problem.load[0] * joints[0] + problem.load[1] * joints[1]
    return (contrast * wound * wound + lag * lag / contrast) / 2 - work / problem.spring.moment_unit


def straight(problem: Problem) -> Unknowns:
    """The straight finger without any force, the first guess of a closing from open."""
    dtype = problem.command.dtype
    count = 0 if problem.thing is None else 2 * problem.thing.count
    return Unknowns(jnp.zeros(2, dtype), jnp.zeros((), dtype), jnp.zeros(count, dtype))


def equations(unknowns: Unknowns, problem: Problem) -> Unknowns:
    """What must vanish: the motor's equation, the box of each joint and the contacts.

    Fischer and Burmeister's function turns each complementarity into an equation: A. Fischer,
    *Optimization* 24 (1992); for a box with two ends, S. C. Billups' composition of two.
    """
    parts = parts_at(problem, unknowns)
    return conditions(problem, unknowns, parts.lag, parts.slack, parts.touch.gaps)


def conditions(
    problem: Problem,
    unknowns: Unknowns,
    lag: Float[Array, ""],
    slack: Float[Array, "2"],
    gaps: Float[Array, " contacts"],
) -> Unknowns:
    """`equations`, from what the mechanism does: α − φ, F, and gaps over the length unit."""
    joints, contrast = unknowns.joints, problem.spring.contrast
    # Weights decide which of two conditions a step believes in. Moments are of order κ or 1/κ
    # where the servo is the stiffer part, and √κ is as far from both.
    soft, stiff = jnp.sqrt(jnp.minimum(contrast, 1.0)), jnp.maximum(contrast, 1.0)
    weights = soft * jnp.stack([stiff, 1 / stiff])
    box = _either(joints, -_either(problem.limit - joints, -slack * weights))
    motor = (contrast * unknowns.motor - lag) / stiff
    touching = _either(gaps, unknowns.forces * soft * stiff)
    return Unknowns(box, motor, touching)


def _either(first: Float[Array, " n"], second: Float[Array, " n"]) -> Float[Array, " n"]:
    """Fischer and Burmeister's function: 0 just where both are ≥ 0 and one of them is 0."""
    # a + b − √(a² + b²) cancels where a + b > 0, and 2 a b / (a + b + √(a² + b²)) elsewhere. A
    # moment of 1e-9 units beside a joint of 1 rad must keep its digits, whatever its sign.
    length = safe_sqrt(first * first + second * second)
    total = first + second
    positive = total > 0
    ratio = 2 * first * second / jnp.where(positive, total + length, 1.0)
    return jnp.where(positive, ratio, total - length)
