"""Poses of groups without a closed form: followed from the sketch, then solved by Newton.

The curve of poses between the sketch's inputs and the wanted ones is followed by pseudo-arc-length
continuation: at a turning point, where the pose moves infinitely fast with the input, it is the
input that turns round, and the linkage is known to lock there. Nothing jumps to another assembly.

Source: E. L. Allgower, K. Georg, *Introduction to Numerical Continuation Methods*, ch. 2-6.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from kinematics.model.linkage import Linkage
from kinematics.solve.evaluation import Drive, evaluate
from kinematics.solve.steps import Plan

Scalar = Float[Array, ""]
Vectors = Float[Array, " unknowns"]

MOVING, REACHED, TURNED, LOST = 0, 1, 2, 3
FIRST_STEP = 0.1
"""Length of the first step, in radians and units of the linkage's size."""
LARGEST_STEP = 0.3
LEAST_STEP = 1e-6
LEAST_COSINE = 0.96
"""Of the angle between tangents at the ends of one step; larger angles halve the step."""
NEAR = 1e-3
"""How far the last solve may move the unknowns; farther, it has gone to another assembly."""
MAX_STEPS = 400
ROUNDING_UNITS = 16
"""Margins down to so many units of rounding below zero count as touching, not as apart."""
CORRECTIONS = 5


def home_unknowns(linkage: Linkage, plan: Plan, size: Scalar) -> Vectors:
    """The unknowns of the plan's iterated groups in the assembled sketch."""
    values = [
        value
        for group in plan.iterated
        for value in (
            *(linkage.home_angle(body) for body in group.angles),
            *(
                (linkage.reference.slides[slider] + linkage.slide_shift(slider)) / size
                for slider in group.sliders
            ),
        )
    ]
    # A starting value only: the derivative is that of the equations where Newton's method ends.
    return jax.lax.stop_gradient(jnp.stack(values))


def split(plan: Plan, unknowns: Vectors) -> dict[int, Float[Array, "..."]]:
    """The unknowns of each iterated group."""
    parts, start = {}, 0
    for group in plan.iterated:
        end = start + len(group.angles) + len(group.sliders)
        parts[group.index] = unknowns[start:end]
        start = end
    return parts


def loop_gaps(
    linkage: Linkage,
    plan: Plan,
    unknowns: Vectors,
    inputs: Float[Array, " inputs"],
    signs: Float[Array, " groups"],
) -> Vectors:
    """What is missing in the loops of the iterated groups, in units of the linkage's size."""
    parts = {index: (part, ()) for index, part in split(plan, unknowns).items()}
    state = evaluate(linkage, plan, Drive.at(inputs, inputs), signs, parts)
    gaps = [gap for group in plan.iterated for gap in state.gaps[group.index]]
    return jnp.stack([entry for gap in gaps for entry in (gap.x, gap.y)])


class Followed(NamedTuple):
    """Where following ended; it carries no derivative.

    Attributes:
        unknowns: the unknowns there.
        part: how much of the way was made, 0 to 1.
        status: `REACHED`, `TURNED`, or `LOST` (also if steps ran out).
    """

    unknowns: Vectors
    part: Scalar
    status: Int[Array, ""]


def track(
    linkage: Linkage,
    plan: Plan,
    inputs: Float[Array, " inputs"],
    signs: Float[Array, " groups"],
    home: tuple[Float[Array, " inputs"], Vectors],
) -> Followed:
    """Follow the unknowns of iterated groups from the assembled sketch to the wanted inputs.

    Args:
        linkage: its dimensions, `Linkage.scaled`.
        plan: the plan.
        inputs: wanted inputs, rad or units of the linkage's size.
        signs: assembly of each group.
        home: inputs and unknowns of the assembled sketch, in the same units.
    """
    # The path has no derivative of its own: only where it leads does, by the implicit function
    # theorem in `newton_correct`. No reverse pass goes through a loop of unknown length.
    linkage, inputs, home = jax.lax.stop_gradient((linkage, inputs, home))
    way = inputs - home[0]
    length = jnp.sqrt(jnp.sum(way * way))
    way = way / jnp.where(length > 0, length, 1.0)

    def equations(point: Float[Array, " extended"]) -> Vectors:
        return loop_gaps(linkage, plan, point[:-1], home[0] + point[-1] * way, signs)

    def passable(point: Float[Array, " extended"]) -> Bool[Array, ""]:
        return _upstream_exists(linkage, plan, point[:-1], home[0] + point[-1] * way, signs)

    return _walk_along(equations, passable, home[1], length)


def _upstream_exists(
    linkage: Linkage,
    plan: Plan,
    unknowns: Vectors,
    inputs: Float[Array, " inputs"],
    signs: Float[Array, " groups"],
) -> Bool[Array, ""]:
    """Whether the closed-form groups before the iterated ones can be assembled."""
    last = plan.steps.index(plan.iterated[-1])
    before = [g for g in plan.groups if plan.steps.index(g) < last and g.kind != "iterated"]
    parts = {index: (part, ()) for index, part in split(plan, unknowns).items()}
    state = evaluate(linkage, plan, Drive.at(inputs, inputs), signs, parts)
    margins = [margin for group in before for margin in state.margins[group.index]]
    least = -ROUNDING_UNITS * jnp.finfo(inputs.dtype).eps
    return jnp.all(jnp.asarray([margin >= least for margin in margins], bool))


def newton_correct(
    linkage: Linkage,
    plan: Plan,
    inputs: Float[Array, " inputs"],
    signs: Float[Array, " groups"],
    guess: Vectors,
) -> Vectors:
    """The unknowns of iterated groups by Newton's method, with implicit derivatives."""
    # A quarter of a second, which linkages of closed forms do without.
    import lineax as lx
    import optimistix as optx

    def gaps(unknowns: Vectors, args: tuple[Linkage, Float[Array, " inputs"]]) -> Vectors:
        return loop_gaps(args[0], plan, unknowns, args[1], signs)

    tolerance = _tolerance(inputs)
    return optx.root_find(
        gaps,
        optx.Newton(tolerance, tolerance),
        guess,
        (linkage, inputs),
        max_steps=8,
        # The pseudo-inverse keeps the derivative finite where the linkage locks.
        adjoint=optx.ImplicitAdjoint(linear_solver=lx.AutoLinearSolver(well_posed=False)),
        throw=False,
    ).value


def solve_iterated(
    linkage: Linkage,
    plan: Plan,
    inputs: Float[Array, " inputs"],
    signs: Float[Array, " groups"],
    followed: Followed,
) -> dict[int, tuple[Float[Array, "..."], tuple[Scalar, Scalar]]]:
    """The unknowns of iterated groups and their margins, for `evaluation.evaluate`.

    Args:
        linkage: its dimensions, `Linkage.scaled`.
        plan: the plan.
        inputs: wanted inputs, rad or units of the linkage's size.
        signs: assembly of each group.
        followed: where `track` came.

    Returns:
        By group its unknowns and two margins: the smallest singular value of the scaled Jacobian
        (minus the part of the way that was not made, where the linkage locks), and the same for
        a way that could not be followed.
    """
    solved = newton_correct(linkage, plan, inputs, signs, followed.unknowns)

    def gaps(unknowns: Vectors) -> Vectors:
        return loop_gaps(linkage, plan, unknowns, inputs, signs)

    # Newton's method started beside the curve may end on another branch; then its answer is a
    # pose of another assembly, and counts as none.
    near = jnp.max(jnp.abs(solved - followed.unknowns)) < NEAR
    closed = jnp.max(jnp.abs(gaps(solved))) < 64 * _tolerance(inputs)
    reached = (followed.status == REACHED) & near & closed
    unknowns = jnp.where(reached, solved, followed.unknowns)
    missing = -jnp.maximum(1 - followed.part, LEAST_STEP)
    turned = followed.status == TURNED
    indices = group_indices(plan, jax.jacfwd(gaps)(unknowns))
    worst = functools.reduce(jnp.minimum, indices.values())
    return {
        group: (
            part,
            (
                jnp.where(turned & (indices[group] <= worst), missing, indices[group]),
                jnp.where(reached | turned, indices[group], missing),
            ),
        )
        for group, part in split(plan, unknowns).items()
    }


def group_indices(plan: Plan, jacobian: Float[Array, "gaps unknowns"]) -> dict[int, Scalar]:
    """Smallest singular value of each iterated group's own part of the Jacobian of their gaps."""
    indices, start = {}, 0
    for group in plan.iterated:
        own = slice(start, start + 2 * len(group.loops))
        indices[group.index] = smallest_singular_value(jacobian[own, own])
        start = own.stop
    return indices


def _tolerance(inputs: Float[Array, " inputs"]) -> float:
    return 16 * float(jnp.finfo(inputs.dtype).eps)


def smallest_singular_value(jacobian: Float[Array, "rows columns"]) -> Scalar:
    """Smallest singular value of a matrix whose columns are scaled to length 1: 0 to 1."""
    # Columns of length 1, so that an angle beside a slide, or a short link beside a long one, does
    # not decide the value: what is left is how nearly parallel the columns are.
    squares = jnp.sum(jacobian * jacobian, axis=0)
    used = squares > jnp.finfo(squares.dtype).tiny
    scale = jnp.where(used, jax.lax.rsqrt(jnp.where(used, squares, 1.0)), 0.0)
    return jnp.linalg.svd(jacobian * scale[None, :], compute_uv=False)[-1]


class _Walk(NamedTuple):
    point: Float[Array, " extended"]
    tangent: Float[Array, " extended"]
    step: Scalar
    growing: Bool[Array, ""]
    steps: Int[Array, ""]
    status: Int[Array, ""]


def _walk_along(
    equations: Callable[[Float[Array, " extended"]], Vectors],
    passable: Callable[[Float[Array, " extended"]], Bool[Array, ""]],
    start: Vectors,
    length: Scalar,
) -> Followed:
    """Follow the curve on which the equations hold until its last coordinate is ``length``."""
    rounding = float(jnp.finfo(start.dtype).eps)
    # A corrected point is on the curve to somewhat more than rounding; powers of it, so that the
    # same program works in float32. What is left of the way may be coarser: the last Newton solve
    # starts from there and needs to be near, not exact.
    good_gap, short_way = rounding**0.75, rounding**0.6
    unit = jnp.zeros(start.shape[0] + 1, start.dtype).at[-1].set(1.0)

    # Traced once each, and not wherever they are used.
    equations, jacobian = jax.jit(equations), jax.jit(jax.jacfwd(equations))

    # Bordered by the tangent, the Jacobian is regular also at a turning point, where that with
    # respect to the unknowns alone is singular.
    def bordered(point, border):
        return jnp.concatenate([jacobian(point), border[None, :]])

    def tangent_at(point, along):
        direction = jnp.linalg.solve(bordered(point, along), unit)
        size = jnp.sqrt(jnp.sum(direction * direction))
        return jnp.where(jnp.isfinite(size), direction / size, 0.0)

    def corrected(guess, border):
        def newton(_, point):
            rest = jnp.concatenate([equations(point), (border @ (point - guess))[None]])
            step = jnp.linalg.solve(bordered(point, border), rest)
            return point - jnp.where(jnp.isfinite(step), step, 0.0)

        return jax.lax.fori_loop(0, CORRECTIONS, newton, guess)

    def walk_on(walk: _Walk) -> _Walk:
        # No longer than what is left along the tangent, or the end would be overshot.
        left = length - walk.point[-1]
        ahead = left / jnp.maximum(walk.tangent[-1], LEAST_STEP)
        step = jnp.minimum(walk.step, ahead)
        guess = walk.point + step * walk.tangent
        point = corrected(guess, walk.tangent)
        tangent = tangent_at(point, walk.tangent)
        smooth = tangent @ walk.tangent > LEAST_COSINE
        closed = jnp.max(jnp.abs(equations(point))) < good_gap
        near = jnp.max(jnp.abs(point - guess)) <= jnp.abs(step)
        good = smooth & closed & near & passable(point)
        # A step that goes over the top of a turn is good in itself, yet not accepted: halved until
        # it is tiny, it ends at the turn, and so at the value where the linkage locks.
        turns = tangent[-1] <= 0
        arrived = jnp.abs(length - point[-1]) <= short_way
        accepted = good & (~turns | arrived)
        small = jnp.abs(step) <= LEAST_STEP
        status = jnp.where(
            accepted & arrived,
            REACHED,
            jnp.where(accepted | ~small, MOVING, jnp.where(good & turns, TURNED, LOST)),
        )
        grown = jnp.where(walk.growing, jnp.minimum(2 * step, LARGEST_STEP), step)
        # Near the end a step is short (or, beyond it, back) on purpose: keep the usual length.
        grown = jnp.where(ahead < walk.step, walk.step, grown)
        return _Walk(
            jnp.where(accepted, point, walk.point),
            jnp.where(accepted, tangent, walk.tangent),
            jnp.where(accepted, grown, jnp.abs(step) / 2),
            walk.growing & ~(good & turns),
            walk.steps + 1,
            status,
        )

    point = corrected(jnp.concatenate([start, jnp.zeros(1, start.dtype)]), unit)
    tangent = tangent_at(point, unit)
    usable = (jnp.max(jnp.abs(equations(point))) < good_gap) & (tangent[-1] > 0)
    walk = _Walk(
        point,
        tangent,
        jnp.asarray(FIRST_STEP, start.dtype),
        jnp.asarray(True),
        jnp.asarray(0),
        jnp.where(usable, jnp.where(length <= short_way, REACHED, MOVING), LOST),
    )
    walk = jax.lax.while_loop(
        lambda walk: (walk.status == MOVING) & (walk.steps < MAX_STEPS), walk_on, walk
    )
    part = jnp.where(length > 0, walk.point[-1] / jnp.where(length > 0, length, 1.0), 1.0)
    status = jnp.where(walk.status == MOVING, LOST, walk.status)
    # What is left of the way is short: go it along the tangent.
    slope = walk.tangent[:-1] / jnp.where(walk.tangent[-1] > 0, walk.tangent[-1], 1.0)
    last = walk.point[:-1] + (length - walk.point[-1]) * slope
    reached = status == REACHED
    return Followed(jnp.where(reached, last, walk.point[:-1]), jnp.clip(part, 0.0, 1.0), status)
