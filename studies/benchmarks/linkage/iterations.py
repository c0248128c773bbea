"""Newton's method and Optimistix's root finders on the loop equations, for a batch of poses."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Float, Int

from kinematics import Linkage
from studies.benchmarks.linkage.cases import (
    Case,
    Dyad,
    Point,
    Sizes,
    crank_tip,
    gaps,
    place,
    size_of,
    sizes_of,
    start_of,
)

MAX_STEPS = 32
"""Cap on the iterations of one solve; none of the study's needs ten."""

ROUNDING_UNITS = 8
"""Least tolerance in units of rounding; a smaller one is raised to it."""

BLOCK = 8192
"""Poses that are iterated together, so that they stay in the cache; then the next ones follow."""

OPTIMISTIX = {
    "Optimistix Newton": optx.Newton,
    "Optimistix Chord": optx.Chord,
    "Optimistix Dogleg": optx.Dogleg,
    "Optimistix Levenberg-Marquardt": optx.LevenbergMarquardt,
}

Joints = list[Point]
Pair = tuple[Float[Array, " poses"], Float[Array, " poses"]]
Advance = Callable[[Callable[[Pair], tuple[Pair, Float[Array, ""]]], Pair], Pair]


def fixed_steps(steps: Int[Array, ""]) -> Advance:
    """So many Newton steps for every pose, whatever is left over."""

    def advance(step: Callable[[Pair], tuple[Pair, Float[Array, ""]]], start: Pair) -> Pair:
        return jax.lax.fori_loop(0, steps, lambda _, pair: step(pair)[0], start)

    return advance


def until(tolerance: Float[Array, ""]) -> Advance:
    """Newton steps until no pose of the block has a larger gap, in units of the size."""

    def advance(step: Callable[[Pair], tuple[Pair, Float[Array, ""]]], start: Pair) -> Pair:
        least = ROUNDING_UNITS * jnp.finfo(tolerance.dtype).eps
        enough = jnp.maximum(tolerance, least)

        def going(state: tuple[Pair, Float[Array, ""], Int[Array, ""]]) -> Any:
            _, gap, steps = state
            return (gap > enough) & (steps < MAX_STEPS)

        def once(state: tuple[Pair, Float[Array, ""], Int[Array, ""]]) -> Any:
            pair, gap = step(state[0])
            return pair, gap, state[2] + 1

        first, gap = step(start)
        return jax.lax.while_loop(going, once, (first, gap, jnp.asarray(1)))[0]

    return advance


def newton(
    case: Case,
    method: Callable[[Any], Advance],
    linkage: Linkage,
    angles: Float[Array, " poses"],
    setting: Array,
) -> Joints:
    """Moving joints by Newton's method, loop after loop, each with its 2 × 2 matrix written out.

    Differentiable in ``linkage`` by the implicit function theorem: one more step is taken, of
    whose parts only the gap has a derivative.

    Args:
        case: which linkage.
        method: `fixed_steps` or `until`.
        linkage: its dimensions; its sketch is the start of every pose.
        angles: of the crank, rad.
        setting: what ``method`` is called with.
    """
    unit = jax.lax.stop_gradient(size_of(linkage))
    guesses = jax.lax.stop_gradient(start_of(case, sizes_of(linkage)))

    def block(angles: Float[Array, " block"]) -> Joints:
        sizes = sizes_of(linkage)
        joints = crank_tip(jnp, case, sizes, angles)
        for number, dyad in enumerate(case.dyads):
            first, second = (jnp.full_like(angles, at) for at in guesses[2 * number :][:2])
            known = jax.lax.stop_gradient((sizes, dict(joints)))
            step = partial(_newton_step, dyad, *known, unit)
            found = method(setting)(step, (first, second))
            found = _implicit_step(dyad, sizes, joints, *jax.lax.stop_gradient(found))
            place(jnp, dyad, sizes, joints, *found)
        return [joints[name] for name in case.joints]

    return in_blocks(block, angles)


def solve_by_optimistix(
    case: Case,
    method: str,
    linkage: Linkage,
    angles: Float[Array, " poses"],
    tolerance: Float[Array, ""],
) -> Joints:
    """Moving joints by one of `OPTIMISTIX` on all loops of a pose at once.

    The arguments are those of `newton`. Optimistix mixes float types in Levenberg-Marquardt and
    Dogleg when 64-bit floats are on, so float32 asks for `jax.enable_x64` to be off.
    """
    unit = jax.lax.stop_gradient(size_of(linkage))
    one = jnp.ones_like(unit)
    # A slide is an unknown in units of the size, as all that is compared with a tolerance.
    scale = jnp.stack([one if dyad.arm or not i else unit for dyad in case.dyads for i in (0, 1)])
    sketch = start_of(case, sizes_of(linkage))
    home = jnp.stack([jnp.asarray(value, angles.dtype) for value in sketch]) / scale

    def residual(unknowns: Float[Array, " unknowns"], args: Any) -> Float[Array, " unknowns"]:
        linkage, angle, scale, unit = args
        values = unknowns * scale
        return jnp.stack(gaps(jnp, case, sizes_of(linkage), angle, values)[1]) / unit

    least = ROUNDING_UNITS * jnp.finfo(angles.dtype).eps
    enough: Any = jnp.maximum(tolerance, least)  # annotated float, takes a traced array
    solver = OPTIMISTIX[method](enough, enough)

    def solve(angle: Float[Array, ""]) -> Joints:
        found = optx.root_find(
            residual,
            solver,
            home,
            (linkage, angle, scale, unit),
            max_steps=MAX_STEPS,
            adjoint=optx.ImplicitAdjoint(linear_solver=lx.AutoLinearSolver(well_posed=True)),
            throw=False,
        ).value
        joints, _ = gaps(jnp, case, sizes_of(linkage), angle, found * scale)
        return [joints[name] for name in case.joints]

    return jax.vmap(solve)(angles)


def in_blocks(
    solve: Callable[[Float[Array, " block"]], Joints], angles: Float[Array, " poses"]
) -> Joints:
    """``solve`` on blocks of equal size one after the other, where the sweep divides into such."""
    poses = angles.shape[0]
    block = next((size for size in range(BLOCK, BLOCK // 4, -1) if poses % size == 0), poses)
    if block == poses:
        return solve(angles)
    found = jax.lax.map(jax.checkpoint(solve), angles.reshape(-1, block))
    return jax.tree.map(lambda part: part.reshape(-1), found)


def _newton_step(
    dyad: Dyad, sizes: Sizes, joints: dict[str, Point], unit: Any, pair: Pair
) -> tuple[Pair, Float[Array, ""]]:
    """The next pair of unknowns, and the largest gap of the present one."""
    x, y = place(jnp, dyad, sizes, dict(joints), *pair)
    worst = jnp.max(jnp.maximum(jnp.abs(x), jnp.abs(y))) / unit
    return _corrected(dyad, sizes, (x, y), *pair), worst


def _implicit_step(
    dyad: Dyad,
    sizes: Sizes,
    joints: dict[str, Point],
    first: Float[Array, " poses"],
    second: Float[Array, " poses"],
) -> Pair:
    """The same unknowns with the derivatives that the loop's equations imply."""
    gap = place(jnp, dyad, sizes, dict(joints), first, second)
    change = tuple(part - jax.lax.stop_gradient(part) for part in gap)
    return _corrected(dyad, jax.lax.stop_gradient(sizes), change, first, second)


def _corrected(
    dyad: Dyad, sizes: Sizes, gap: Point, first: Float[Array, " poses"], second: Any
) -> Pair:
    length = sizes.lengths[dyad.link]
    by_first = -length * jnp.sin(first), length * jnp.cos(first)
    if dyad.arm is None:
        angle = sizes.lines[0][2]
        by_second = -jnp.cos(angle), -jnp.sin(angle)
    else:
        arm = sizes.lengths[dyad.arm]
        by_second = arm * jnp.sin(second), -arm * jnp.cos(second)
    # Cramer's rule.
    determinant = by_first[0] * by_second[1] - by_first[1] * by_second[0]
    return (
        first - (gap[0] * by_second[1] - gap[1] * by_second[0]) / determinant,
        second - (by_first[0] * gap[1] - by_first[1] * gap[0]) / determinant,
    )
