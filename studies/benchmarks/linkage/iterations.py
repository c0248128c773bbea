"""The closed form, Newton's method and Optimistix's root finders, each for a batch of poses.

Each function returns the places of the joints asked for, mm, and what else it finds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Float

from designopt.batching import map_in_chunks
from kinematics import Linkage, solve_poses
from studies.benchmarks.linkage.cases import crank_tip, gaps, place, size_of, sizes_of, start_of
from studies.oracles.linkages import Case, Dyad, Point, Sizes

MAX_STEPS = 32
"""Cap on the iterations of one solve; none of the study's needs ten."""

ROUNDING_UNITS = 8
"""Least tolerance in units of rounding; a smaller one is raised to it."""

BLOCK = 8192
"""Poses that are iterated together, so that they stay in the cache; then the next ones follow."""

Joints = list[Point]
Pair = tuple[Float[Array, " poses"], Float[Array, " poses"]]


def closed_form(
    case: Case, of: Sequence[str], linkage: Linkage, angles: Float[Array, " poses"]
) -> tuple[Joints, Any]:
    """The library's own call: moving joints; which poses are ok, and their margins."""
    solved = solve_poses(linkage, angles[:, None], of=of)
    places = [solved.value.joints[name] for name in of]
    return [(place.x, place.y) for place in places], (solved.ok, solved.margin)


def newton(
    adaptive: bool,
    case: Case,
    of: Sequence[str],
    linkage: Linkage,
    angles: Float[Array, " poses"],
    setting: Array,
) -> tuple[Joints, None]:
    """Moving joints by Newton's method, loop after loop, each with its 2 × 2 matrix written out.

    Differentiable in ``linkage`` by the implicit function theorem: one more step is taken, of
    whose parts only the gap has a derivative.

    Args:
        adaptive: whether to stop when no pose of the block has a larger gap than the setting, or
            after so many steps.
        case: which linkage.
        of: the joints asked for.
        linkage: its dimensions; its sketch is the start of every pose.
        angles: of the crank, rad.
        setting: tolerance in units of the size, or number of steps.
    """
    unit, guesses = jax.lax.stop_gradient(
        (size_of(sizes_of(linkage)), start_of(case, sizes_of(linkage)))
    )

    def going(state: tuple[Pair, Array, Array]) -> Array:
        _, gap, steps = state
        if not adaptive:
            return steps < setting
        enough = jnp.maximum(setting, ROUNDING_UNITS * jnp.finfo(setting.dtype).eps)
        return (gap > enough) & (steps < MAX_STEPS)

    def solve(dyad: Dyad, sizes: Sizes, joints: dict[str, Point], start: Pair) -> Pair:
        def step(state: tuple[Pair, Array, Array]) -> tuple[Pair, Array, Array]:
            pair, worst, steps = state
            gap = place(jnp, dyad, sizes, dict(joints), *pair)
            if adaptive:
                worst = jnp.max(jnp.maximum(*map(jnp.abs, gap))) / unit
            return _corrected(dyad, sizes, joints, gap, pair), worst, steps + 1

        infinite = jnp.full_like(unit, jnp.inf)
        return jax.lax.while_loop(going, step, (start, infinite, jnp.asarray(0)))[0]

    def block(angles: Float[Array, " block"]) -> Joints:
        sizes = sizes_of(linkage)
        joints = crank_tip(jnp, case, sizes, angles)
        for number, dyad in enumerate(case.dyads):
            first, second = guesses[2 * number : 2 * number + 2]
            start = jnp.full_like(angles, first), jnp.full_like(angles, second)
            known = jax.lax.stop_gradient((sizes, dict(joints)))
            pair = jax.lax.stop_gradient(solve(dyad, *known, start))
            gap = place(jnp, dyad, sizes, dict(joints), *pair)
            change = jax.tree.map(lambda part: part - jax.lax.stop_gradient(part), gap)
            place(jnp, dyad, sizes, joints, *_corrected(dyad, *known, change, pair))
        return [joints[name] for name in of]

    whole = len(angles) <= BLOCK
    return map_in_chunks(block if whole else jax.checkpoint(block), angles, BLOCK), None


def _corrected(dyad: Dyad, sizes: Sizes, joints: dict[str, Point], gap: Point, pair: Pair) -> Pair:
    """The unknowns that close a loop's gap to first order, by Cramer's rule."""

    def by(*change: float) -> Point:
        moves = tuple(jnp.full_like(part, at) for part, at in zip(pair, change, strict=True))
        return jax.jvp(lambda *at: place(jnp, dyad, sizes, dict(joints), *at), pair, moves)[1]

    (a, b), (c, d) = by(1.0, 0.0), by(0.0, 1.0)
    determinant = a * d - b * c
    first, second = gap[0] * d - gap[1] * c, a * gap[1] - b * gap[0]
    return pair[0] - first / determinant, pair[1] - second / determinant


def find_roots(
    solver: Callable[[Any, Any], Any],
    case: Case,
    of: Sequence[str],
    linkage: Linkage,
    angles: Float[Array, " poses"],
    tolerance: Float[Array, ""],
) -> tuple[Joints, None]:
    """Moving joints by a solver of Optimistix on all loops of a pose at once.

    The other arguments are those of `newton`. Optimistix mixes float types in Levenberg-Marquardt
    and Dogleg when 64-bit floats are on, so float32 asks for `jax.enable_x64` to be off.
    """
    unit = jax.lax.stop_gradient(size_of(sizes_of(linkage)))
    one = jnp.ones_like(unit)
    # A slide is an unknown in units of the size, as all that is compared with a tolerance.
    scale = jnp.stack([one if dyad.arm or not i else unit for dyad in case.dyads for i in (0, 1)])
    sketch = start_of(case, sizes_of(linkage))
    home = jnp.stack([jnp.asarray(value, angles.dtype) for value in sketch]) / scale

    def residual(unknowns: Float[Array, " unknowns"], args: Any) -> Float[Array, " unknowns"]:
        linkage, angle, scale, unit = args
        return jnp.stack(gaps(jnp, case, sizes_of(linkage), angle, unknowns * scale)[1]) / unit

    enough = jnp.maximum(tolerance, ROUNDING_UNITS * jnp.finfo(angles.dtype).eps)
    adjoint = optx.ImplicitAdjoint(linear_solver=lx.AutoLinearSolver(well_posed=True))
    root = partial(optx.root_find, max_steps=MAX_STEPS, adjoint=adjoint, throw=False)

    def solve(angle: Float[Array, ""]) -> Joints:
        args = linkage, angle, scale, unit
        found = root(residual, solver(enough, enough), home, args).value
        joints, _ = gaps(jnp, case, sizes_of(linkage), angle, found * scale)
        return [joints[name] for name in of]

    return jax.vmap(solve)(angles), None
