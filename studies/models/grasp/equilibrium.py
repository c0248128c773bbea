"""One equilibrium of the finger: Newton's iteration on its conditions, and the judgement of it."""

from __future__ import annotations

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from designopt.numerics import as_float, safe_sqrt
from designopt.solution import Solution
from studies.models.grasp.conditions import (
    Linear,
    Problem,
    Unknowns,
    conditions,
    equations,
    linear_at,
    parts_at,
)
from studies.models.grasp.transfer import Joints

RESIDUAL_TOLERANCE = 1e-9
"""Largest `Solution.residual` of a state that is reported, in float64 (float32: 1e-4)."""

SUFFICIENT, LEAST_SHARE, NEGLIGIBLE = 0.1, 1 / 16, 1e-9
"""A step that does not leave so much less of the equations, over its share, is halved, down to the
least share; unless what it leaves is negligible, for there only rounding is left to compare."""

MAX_STEPS = 48
"""Newton's steps from one state; a closing needs three or four from the state before."""


class GRASP(eqx.Enumeration):
    """What can be the matter with an equilibrium."""

    successful = ""
    unconverged = (
        "the equilibrium's equations were not solved from this start; close in smaller steps"
    )
    locked = "the linkage cannot be assembled in this posture; change the pins or the stops"
    unstable = "this equilibrium is not stable: the finger leaves it; close in smaller steps"


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


def solve(
    problem: Problem,
    guess: Unknowns,
    *,
    tolerance: ArrayLike = 0.0,
    max_steps: int = MAX_STEPS,
) -> Solution[State]:
    """The equilibrium near a guess, by Newton's iteration on Fischer and Burmeister's equations.

    Derivatives in ``problem`` are implicit. Failure is data: see `GRASP`.

    Args:
        problem: finger, motor angle, load and object.
        guess: where to start, such as the previous state of a closing (`unknowns_of`).
        tolerance: of the last step, relative and absolute, not below 8 units of rounding; may be
            traced.
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
    dtype = guess.joints.dtype
    floor = 8 * float(jnp.finfo(dtype).eps)
    tight = jnp.maximum(as_float(tolerance).astype(dtype), floor)
    guess, tight = jax.lax.stop_gradient((guess, tight))
    return _judged(problem, *_found(max_steps, problem, guess, tight))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _found(
    max_steps: int, problem: Problem, guess: Unknowns, tolerance: Float[Array, ""]
) -> tuple[Unknowns, Linear]:
    """Newton's iteration: where it ends, and the mechanism there.

    The mechanism is evaluated in one place, inside the loop, whose first turn only looks at the
    guess: what is judged later is what the last turn saw. That is half of the program that
    Optimistix' Newton compiles to, which evaluates it for its steps and leaves it to the caller to
    evaluate it for the judgement.
    """
    upper, contrast = problem.limit, problem.spring.contrast
    least = jnp.minimum(contrast, 1 / contrast)

    def turn(state: _Iteration) -> _Iteration:
        old, first = state.unknowns, state.count == 0
        share = jnp.where(first, 0.0, state.share)
        new = jax.tree.map(lambda a, b: a + share * b, old, state.move)
        # Newton has no trust region: a joint that leaves its stops comes back to them.
        new = eqx.tree_at(lambda u: u.joints, new, jnp.clip(new.joints, 0.0, upper))
        linear = linear_at(problem, new)
        slopes, value = _slopes(problem, new, linear)
        left = jnp.sqrt(value @ value)
        taken = (left <= (1 - SUFFICIENT * share) * state.left) | (left <= NEGLIGIBLE)
        taken = first | ((taken | (share <= LEAST_SHARE)) & jnp.isfinite(left))
        settled = (_change(new, old, least) <= tolerance) & ~first
        kept = jax.tree.map(
            lambda a, b: jnp.where(taken, a, b),
            (new, linear, left, _solved(new, slopes, value)),
            (old, state.linear, state.left, state.move),
        )
        share = jnp.where(taken, 1.0, state.share / 2)
        return _Iteration(state.count + 1, settled, share, *kept)

    one, still = jnp.ones_like(least), jax.tree.map(jnp.zeros_like, guess)
    nothing = jax.tree.map(jnp.zeros_like, jax.eval_shape(linear_at, problem, guess))
    last = jax.lax.while_loop(
        lambda state: ~state.settled & (state.count <= max_steps),
        turn,
        _Iteration(jnp.asarray(0), jnp.asarray(False), one, guess, nothing, one, still),
    )
    return last.unknowns, last.linear


@_found.defjvp
def _found_slope(max_steps: int, at: Any, towards: Any) -> tuple[Any, Any]:
    """By the implicit function theorem; derivatives of derivatives are not offered."""
    problem, guess, tolerance = at
    unknowns, linear = _found(max_steps, problem, guess, tolerance)
    _, change = jax.jvp(
        lambda p: ravel_pytree(equations(unknowns, p))[0], (problem,), (towards[0],)
    )
    move = _solved(unknowns, _slopes(problem, unknowns, linear)[0], change)
    _, moved = jax.jvp(parts_at, (problem, unknowns), (towards[0], move))
    # Curvature and lifts serve the iteration and the judgement, which carry no derivative.
    still = jax.tree.map(jnp.zeros_like, (linear.curvature, linear.lifts))
    return (unknowns, linear), (move, Linear(moved, *still))


class _Iteration(eqx.Module):
    """Where the iteration stands.

    Attributes:
        count: postures looked at.
        settled: whether the last step was small.
        share: of the next step that is to be taken.
        unknowns, linear: the last posture that was taken.
        left: length of what it leaves of the equations.
        move: Newton's step from it.
    """

    count: Int[Array, ""]
    settled: Bool[Array, ""]
    share: Float[Array, ""]
    unknowns: Unknowns
    linear: Linear
    left: Float[Array, ""]
    move: Unknowns


def _slopes(
    problem: Problem, at: Unknowns, linear: Linear
) -> tuple[Float[Array, "unknowns unknowns"], Float[Array, " unknowns"]]:
    """Derivative of `equations`, from that of the mechanism, and their value."""
    parts = linear.parts
    here, unravel = ravel_pytree(at)

    def nearby(flat: Float[Array, " unknowns"]) -> tuple[Any, Any]:
        there = unravel(flat)
        move = jax.tree.map(jnp.subtract, there, at)
        slack = parts.slack + linear.curvature @ move.joints
        slack = slack - parts.ratios * move.motor - parts.touch.slopes.T @ move.forces
        lag = parts.lag - parts.ratios @ move.joints
        gaps = parts.touch.gaps + linear.lifts @ move.joints
        value = ravel_pytree(conditions(problem, there, lag, slack, gaps))[0]
        return value, value

    return jax.jacfwd(nearby, has_aux=True)(here)


def _change(new: Unknowns, old: Unknowns, least: Float[Array, ""]) -> Float[Array, ""]:
    """Largest relative change; moments and forces, however small, count by their own size."""
    joints, rest = jnp.abs(new.joints), jnp.append(jnp.abs(new.forces), jnp.abs(new.motor))
    turned = jnp.abs(new.joints - old.joints)
    changed = jnp.append(jnp.abs(new.forces - old.forces), jnp.abs(new.motor - old.motor))
    return jnp.maximum(jnp.max(turned / (1 + joints)), jnp.max(changed / (least + rest)))


def _solved(
    like: Unknowns, slopes: Float[Array, "unknowns unknowns"], value: Float[Array, " unknowns"]
) -> Unknowns:
    """−slopes⁻¹ value by the pseudo-inverse, which picks one answer where there are several.

    There are where more holds than freedoms, and where two states meet.
    """
    # Rows are of very different size where stiffnesses are, and the small ones count as much.
    rows = jnp.max(jnp.abs(slopes), axis=1)
    rows = jnp.where(rows > 0, rows, 1.0)
    left, sizes, right = jnp.linalg.svd(slopes / rows[:, None])
    known = sizes > len(sizes) * jnp.finfo(sizes.dtype).eps * sizes[0]
    inverse = jnp.where(known, 1 / jnp.where(known, sizes, 1.0), 0.0)
    return ravel_pytree(like)[1](-(right.T @ (inverse * (left.T @ (value / rows)))))


def unknowns_of(problem: Problem, state: State) -> Unknowns:
    """A state as the guess for a problem of the same finger and object."""
    unit = problem.spring.moment_unit
    return Unknowns(state.joints, state.motor / unit, state.forces * problem.length_unit / unit)


def _judged(problem: Problem, found: Unknowns, linear: Linear) -> Solution[State]:
    joints, parts = found.joints, linear.parts
    unit, length = problem.spring.moment_unit, problem.length_unit
    motor, forces, gaps = (
        found.motor * unit,
        found.forces * unit / length,
        parts.touch.gaps * length,
    )
    state = State(joints, motor, forces, gaps, parts.touch.along, parts.slack * unit)
    # Judgements carry no derivative; that of eigenvalues would not be finite where two coincide.
    seen = jax.lax.stop_gradient((problem, found, linear))
    residual, margin = _violation(*seen), _stability(*seen)
    known = jnp.isfinite(residual) & jnp.isfinite(margin)
    residual, margin = jnp.where(known, residual, 1.0), jnp.where(known, margin, 0.0)
    tolerance = RESIDUAL_TOLERANCE if joints.dtype == jnp.float64 else 1e-4
    result = GRASP.where(margin > 0, GRASP.successful, GRASP.unstable)
    result = GRASP.where(parts.reach > 0, result, GRASP.locked)
    result = GRASP.where(residual <= tolerance, result, GRASP.unconverged)
    return Solution(state, margin, residual, result)


def _violation(problem: Problem, found: Unknowns, linear: Linear) -> Float[Array, ""]:
    """The largest violation by plain comparisons, not by the functions that were solved."""
    contrast, joints, parts = problem.spring.contrast, found.joints, linear.parts
    upper = problem.limit
    # Moments in play: what the motor gives now, and for the DIP joint what the spring gives.
    motor = jnp.abs(found.motor) * jnp.max(jnp.abs(parts.ratios))
    load = jnp.max(jnp.abs(problem.load)) / problem.spring.moment_unit
    spring = contrast * jnp.abs(problem.spring.preload) + jnp.zeros_like(motor)
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


def _stability(problem: Problem, found: Unknowns, linear: Linear) -> Float[Array, ""]:
    """Least curvature of energy − Σ f g along what is free, over the largest; 1 if nothing is."""
    joints, contrast, parts = found.joints, problem.spring.contrast, linear.parts
    # F with the motor's moment held is the gradient but for what the servo's stiffness adds.
    curvature = linear.curvature + jnp.outer(parts.ratios, parts.ratios) / contrast
    upper = problem.limit
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
