"""Closing and opening: the motor moves slowly, and every state starts from the one before."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.solution import Solution
from studies.finger_grasp.equilibrium import Problem, State, Unknowns, solve, straight, unknowns_of


def close(
    problem: Problem,
    commands: Float[Array, " steps"],
    start: Unknowns | None = None,
) -> Solution[State]:
    """Equilibria along a motion of the motor, each solved from the last one that was found.

    Args:
        problem: finger, load and object; its own motor angle is not looked at.
        commands: motor angles α in the order in which they are passed, rad.
        start: where the first one starts; the straight finger by default.

    Returns:
        One state per motor angle; see `equilibrium.solve`. A state that is not ok does not spoil
        those after it, and means nothing itself.
    """

    def step(
        last: Unknowns, command: Float[Array, ""]
    ) -> tuple[Unknowns, Solution[State]]:
        now = eqx.tree_at(lambda p: p.command, problem, command)
        found = solve(now, last)
        ok = found.ok
        new = jax.lax.stop_gradient(unknowns_of(now, found.value))
        return jax.tree.map(lambda a, b: jnp.where(ok, a, b), new, last), found

    first = straight(problem) if start is None else start
    return jax.lax.scan(step, jax.lax.stop_gradient(first), commands)[1]
