"""One equilibrium of the finger: a smooth complementarity problem, solved and checked.

The energy U(q) = ½ k (Δγ(q₂) + γ_p)² + ½ k_s (φ(q) − α)² − load · q is least where no pad overlaps
the object and both joints are within their stops. Its conditions, with motor moment
T_a = k_s (α − φ) and contact forces f_i ≥ 0 at gaps g_i ≥ 0 (Birglen, Laliberté & Gosselin,
*Underactuated Robotic Hands*, 2008, ch. 3; the elastic servo is this project's):

    F = ∇U − Σ f_i ∇g_i,   F_j ≥ 0 at the lower stop, ≤ 0 at the upper one, 0 between them.

Unknowns are q, T_a and f. T_a is kept beside q, and moments are counted in √(k k_s): then no
coefficient is larger than √(k / k_s) or its inverse; the raw equations spread over k / k_s.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Float

from designopt.numerics import as_float, safe_sqrt
from designopt.solution import Solution
from designopt.vectors import rotation
from studies.finger_grasp.finger import Finger, Joints, pads, transfer
from studies.finger_grasp.objects import Object

RESIDUAL_TOLERANCE = 1e-9
"""Largest `Solution.residual` of a state that is reported, in float64 (float32: 1e-4)."""

MAX_STEPS = 24


Method = Literal["newton", "dogleg", "levenberg-marquardt"]


class GRASP(eqx.Enumeration):
    """What can be the matter with an equilibrium."""

    successful = ""
    unconverged = (
        "the equilibrium's equations were not solved from this start; close in smaller steps"
    )
    locked = "the linkage cannot be assembled in this posture; change the pins or the stops"
    unstable = "this equilibrium is not stable: the finger leaves it; close in smaller steps"


class Problem(eqx.Module):
    """What an equilibrium is asked of.

    Attributes:
        finger: the design.
        command: α, angle of the motor behind its servo stiffness, rad, 0 in the straight finger.
        load: moments on PIP and DIP from elsewhere, N mm, positive in flexion.
        thing: what is grasped; ``None`` leaves contacts out of the equations.
    """

    finger: Finger
    command: Float[Array, ""] = eqx.field(converter=as_float)
    load: Float[Array, "2"] = eqx.field(converter=as_float)
    thing: Object | None


class State(eqx.Module):
    """The finger in equilibrium.

    Attributes:
        joints: flexion of PIP and DIP, rad.
        motor: T_a, N mm.
        forces: contact forces, N: those on the intermediate pad first, then on the distal one.
        gaps: of the same contacts, mm.
        along: the contacts' places, mm from the phalanx's joint along its pad: k₁, then k₂.
        stops: moments of the stops on PIP and DIP, N mm, positive in flexion (a lower stop).
    """

    joints: Joints
    motor: Float[Array, ""]
    forces: Float[Array, " contacts"]
    gaps: Float[Array, " contacts"]
    along: Float[Array, " contacts"]
    stops: Float[Array, "2"]


class Unknowns(eqx.Module):
    """Joints (rad), motor moment in `Finger.moment_unit`, forces in that over `length_unit`."""

    joints: Float[Array, "*batch 2"]
    motor: Float[Array, "*batch"]
    forces: Float[Array, "*batch contacts"]


def solve(
    problem: Problem,
    guess: Unknowns,
    *,
    method: Method = "newton",
    tolerance: ArrayLike = 0.0,
    max_steps: int = MAX_STEPS,
) -> Solution[State]:
    """The equilibrium near a guess, by root finding on Fischer and Burmeister's equations.

    Derivatives in ``problem`` are implicit. Failure is data: see `GRASP`.

    Args:
        problem: finger, motor angle, load and object.
        guess: where to start, such as the previous state of a closing (`unknowns_of`).
        method: which of Optimistix' iterations.
        tolerance: relative and absolute, not below 8 units of rounding; may be traced.
        max_steps: cap on iterations.

    Returns:
        The state. ``residual`` is the largest violation of the equations, recomputed from the
        state: |motor equation| in rad, and for every stop and contact the smaller of distance
        (rad, or gap over the finger's length unit) and of moment over the largest in play. It is
        no more than `RESIDUAL_TOLERANCE` where the solution is ok. ``margin`` is the least
        curvature of the energy, at the found forces, along the directions that stops and closed
        contacts leave free, over the largest curvature (1 where none is free): negative where the
        equilibrium is not stable.
    """
    start, unravel = ravel_pytree(jax.lax.stop_gradient(guess))
    floor = 8 * jnp.finfo(start.dtype).eps
    tight: Any = jnp.maximum(as_float(tolerance).astype(start.dtype), floor)
    options: dict[str, Any] | None = None
    if method == "newton":
        # Newton has no trust region: a joint that leaves its stops comes back to them.
        bounds = [
            eqx.tree_at(
                lambda u: u.joints,
                jax.tree.map(lambda leaf, far=far: jnp.full_like(leaf, far), guess),
                jnp.full_like(guess.joints, end),
            )
            for far, end in (
                (-jnp.inf, 0.0),
                (jnp.inf, math.radians(problem.finger.body.range_deg)),
            )
        ]
        options = dict(zip(("lower", "upper"), (ravel_pytree(b)[0] for b in bounds), strict=True))
    kind = {
        "newton": optx.Newton,
        "dogleg": optx.Dogleg,
        "levenberg-marquardt": optx.LevenbergMarquardt,
    }[method]
    found = optx.root_find(
        lambda y, problem: ravel_pytree(equations(unravel(y), problem))[0],
        # The pseudo-inverse picks one answer where more holds than freedoms leave several.
        kind(tight, tight, linear_solver=lx.AutoLinearSolver(well_posed=False)),
        start,
        problem,
        options=options,
        max_steps=max_steps,
        # The pseudo-inverse keeps derivatives finite where two states meet.
        adjoint=optx.ImplicitAdjoint(linear_solver=lx.AutoLinearSolver(well_posed=False)),
        throw=False,
    ).value
    found = jnp.where(jnp.all(jnp.isfinite(found)), found, start)
    return _judged(problem, unravel(found))


def equations(unknowns: Unknowns, problem: Problem) -> Unknowns:
    """What must vanish: the motor's equation, the box of each joint and the contacts.

    Fischer and Burmeister's function turns each complementarity into an equation: A. Fischer,
    *Optimization* 24 (1992); for a box with two ends, S. C. Billups' composition of two.
    """
    finger, joints = problem.finger, unknowns.joints
    contrast = finger.contrast
    # Weights decide which of two conditions a step believes in. Moments are of order κ or 1/κ
    # where the servo is the stiffer part, and √κ is as far from both.
    soft, stiff = jnp.sqrt(jnp.minimum(contrast, 1.0)), jnp.maximum(contrast, 1.0)
    parts = _parts(problem, unknowns)
    upper = jnp.deg2rad(jnp.asarray(finger.body.range_deg, joints.dtype))
    weights = soft * jnp.stack([stiff, 1 / stiff])
    slack = parts.slack * weights
    box = _either(joints, -_either(upper - joints, -slack))
    motor = (contrast * unknowns.motor - parts.lag) / stiff
    touching = _either(parts.touch.gaps, unknowns.forces * soft * stiff)
    return Unknowns(box, motor, touching)


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


class _Parts(eqx.Module):
    """What the equations are made of.

    Attributes:
        lag: α − φ, rad.
        slack: F, the moment that stops have to bear, in moment units.
        touch: all contacts.
        reach: of the dyads, mm.
    """

    lag: Float[Array, ""]
    slack: Float[Array, "2"]
    touch: Touch
    reach: Float[Array, ""]


def _parts(problem: Problem, unknowns: Unknowns) -> _Parts:
    finger, joints = problem.finger, unknowns.joints
    found = transfer(finger, joints)
    spring = finger.contrast * (found.winding + finger.preload) * found.slope
    slack = -unknowns.motor * found.ratios - problem.load / finger.moment_unit
    slack = slack + jnp.stack([jnp.zeros_like(spring), spring])
    touch = touches(problem, joints)
    slack = slack - touch.slopes.T @ unknowns.forces
    return _Parts(problem.command - found.crank, slack, touch, found.reach)


def touches(problem: Problem, joints: Joints) -> Touch:
    """Where both pads are nearest to the object, and how their gaps change with the joints.

    A gap changes as fast as the pad's nearest point moves along the contact's normal: what slides
    along the object or along the pad changes no distance. That is the virtual work of a force too.
    """
    body, thing = problem.finger.body, problem.thing
    if thing is None:
        nothing = jnp.zeros((0,), joints.dtype)
        return Touch(nothing, jnp.zeros((0, 2), joints.dtype), nothing)
    unit = problem.finger.length_unit
    axis_b = rotation(-joints[0]).scaled(jnp.full_like(joints[0], body.intermediate))
    found, slopes = [], []
    for pad, moved_by_dip in zip(pads(body, joints), (False, True), strict=True):
        contact = thing.contacts(pad)
        reach = contact.along - pad.offset
        x, y = pad.start.x + reach * pad.along.x, pad.start.y + reach * pad.along.y
        # Flexion is clockwise: it moves a point at (x, y) from its axis towards (y, −x).
        by_pip = contact.normal.x * y - contact.normal.y * x
        by_dip = contact.normal.x * (y - axis_b.y) - contact.normal.y * (x - axis_b.x)
        found.append(contact)
        slopes.append(
            jnp.stack([by_pip, by_dip if moved_by_dip else jnp.zeros_like(by_dip)], axis=1)
        )
    return Touch(
        jnp.concatenate([contact.gap for contact in found]) / unit,
        jnp.concatenate(slopes) / unit,
        jnp.concatenate([contact.along for contact in found]),
    )


def gaps_of(problem: Problem, joints: Joints) -> Float[Array, " contacts"]:
    """Gaps of all contacts in mm, those of the intermediate pad first."""
    return touches(problem, joints).gaps * problem.finger.length_unit


def energy(problem: Problem, joints: Joints) -> Float[Array, ""]:
    """U(q) over `Finger.moment_unit`."""
    finger = problem.finger
    found, contrast = transfer(finger, joints), finger.contrast
    wound, lag = found.winding + finger.preload, problem.command - found.crank
    work = problem.load[0] * joints[0] + problem.load[1] * joints[1]
    return (contrast * wound * wound + lag * lag / contrast) / 2 - work / finger.moment_unit


def straight(problem: Problem) -> Unknowns:
    """The straight finger without any force, the first guess of a closing from open."""
    dtype = problem.command.dtype
    count = 0 if problem.thing is None else 2 * problem.thing.count
    return Unknowns(jnp.zeros(2, dtype), jnp.zeros((), dtype), jnp.zeros(count, dtype))


def unknowns_of(problem: Problem, state: State) -> Unknowns:
    """A state as the guess for a problem of the same finger and object."""
    finger = problem.finger
    unit = finger.moment_unit
    return Unknowns(state.joints, state.motor / unit, state.forces * finger.length_unit / unit)


def _judged(problem: Problem, found: Unknowns) -> Solution[State]:
    finger, joints = problem.finger, found.joints
    parts = _parts(problem, found)
    unit = finger.moment_unit
    state = State(
        joints,
        found.motor * unit,
        found.forces * unit / finger.length_unit,
        parts.touch.gaps * finger.length_unit,
        parts.touch.along,
        parts.slack * unit,
    )
    # Judgements carry no derivative; that of eigenvalues would not be finite where two coincide.
    seen = jax.lax.stop_gradient((problem, found, parts))
    residual, margin = _violation(*seen), _stability(*seen)
    known = jnp.isfinite(residual) & jnp.isfinite(margin)
    residual, margin = jnp.where(known, residual, 1.0), jnp.where(known, margin, 0.0)
    tolerance = RESIDUAL_TOLERANCE if joints.dtype == jnp.float64 else 1e-4
    result = GRASP.where(margin > 0, GRASP.successful, GRASP.unstable)
    result = GRASP.where(parts.reach > 0, result, GRASP.locked)
    result = GRASP.where(residual <= tolerance, result, GRASP.unconverged)
    return Solution(state, margin, residual, result)


def _violation(problem: Problem, found: Unknowns, parts: _Parts) -> Float[Array, ""]:
    """The largest violation by plain comparisons, not by the functions that were solved."""
    contrast, joints = problem.finger.contrast, found.joints
    upper = jnp.deg2rad(jnp.asarray(problem.finger.body.range_deg, joints.dtype))
    # Moments in play: what the motor gives now, and for the DIP joint what the spring gives.
    motor = jnp.abs(found.motor) * jnp.max(jnp.abs(transfer(problem.finger, joints).ratios))
    load = jnp.max(jnp.abs(problem.load)) / problem.finger.moment_unit
    spring = contrast * jnp.abs(problem.finger.preload) + jnp.zeros_like(motor)
    floor = jnp.minimum(contrast, 1 / contrast)
    largest = jnp.stack([motor + load, motor + load + spring]) + floor
    moment = parts.slack / largest
    low, high = jnp.abs(jnp.minimum(joints, moment)), jnp.abs(jnp.minimum(upper - joints, -moment))
    box = jnp.minimum(jnp.abs(moment), jnp.minimum(low, high))
    outside = jnp.maximum(-joints, joints - upper)
    touching = jnp.abs(jnp.minimum(parts.touch.gaps, found.forces / largest[1]))
    lag = contrast * found.motor - parts.lag
    worst = [jnp.abs(lag), jnp.max(box), jnp.max(outside)]
    if touching.size:
        worst.append(jnp.max(touching))
    return jnp.max(jnp.stack(worst))


def _stability(problem: Problem, found: Unknowns, parts: _Parts) -> Float[Array, ""]:
    """Least curvature of energy − Σ f g along what is free, over the largest; 1 if nothing is."""
    joints, contrast = found.joints, problem.finger.contrast

    def slack(joints: Joints) -> Float[Array, "2"]:
        return _parts(problem, eqx.tree_at(lambda u: u.joints, found, joints)).slack

    # F with the motor's moment held is the gradient but for what the servo's stiffness adds.
    ratios = transfer(problem.finger, joints).ratios
    curvature = jax.jacfwd(slack)(joints) + jnp.outer(ratios, ratios) / contrast
    upper = jnp.deg2rad(jnp.asarray(problem.finger.body.range_deg, joints.dtype))
    moment = jnp.abs(parts.slack)
    held = jnp.minimum(joints, upper - joints) < moment
    normals = jnp.where(held[:, None], jnp.eye(2, dtype=joints.dtype), 0.0)
    closed = parts.touch.gaps < found.forces
    normals = jnp.concatenate([normals, jnp.where(closed[:, None], parts.touch.slopes, 0.0)])
    # What no closed constraint moves along: everything, one direction across them, or nothing.
    gram = normals.T @ normals
    size = gram[0, 0] + gram[1, 1]
    spanned = gram[0, 0] * gram[1, 1] - gram[0, 1] ** 2 > 1e-12 * size * size
    across = jnp.where(
        gram[0, 0] > gram[1, 1],
        jnp.stack([-gram[0, 1], gram[0, 0]]),
        jnp.stack([gram[1, 1], -gram[0, 1]]),
    )
    one = across @ curvature @ across / jnp.where(size > 0, across @ across, 1.0)
    # Eigenvalues of a symmetric 2 × 2 matrix.
    middle = (curvature[0, 0] + curvature[1, 1]) / 2
    off = (curvature[0, 1] + curvature[1, 0]) / 2
    spread = safe_sqrt(((curvature[0, 0] - curvature[1, 1]) / 2) ** 2 + off**2)
    least, largest = middle - spread, jnp.abs(middle) + spread
    free = jnp.where(size > 0, one, least) / largest
    return jnp.where(spanned, jnp.ones_like(free), free)


def _either(first: Float[Array, " n"], second: Float[Array, " n"]) -> Float[Array, " n"]:
    """Fischer and Burmeister's function: 0 just where both are ≥ 0 and one of them is 0."""
    # a + b − √(a² + b²), without cancellation where both are positive.
    length = safe_sqrt(first * first + second * second)
    total = first + second
    positive = (first > 0) & (second > 0)
    ratio = 2 * first * second / jnp.where(positive, total + length, 1.0)
    return jnp.where(positive, ratio, total - length)
