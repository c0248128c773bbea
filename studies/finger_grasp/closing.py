"""Closing and opening: the motor moves slowly, and every state starts from the one before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.solution import Solution
from studies.finger_grasp.equilibrium import (
    Problem,
    State,
    Unknowns,
    solve,
    straight,
    unknowns_of,
)

LANES = 12
"""Closings that are computed together; a block is filled up, so that one program serves all."""

STEPS = 121
"""Motor angles of every closing, for the same reason."""


def close(problem: Problem, commands: Float[Array, " steps"]) -> Solution[State]:
    """Equilibria along a motion of the motor, each solved from the last one that was found.

    Args:
        problem: finger, load and object; its own motor angle is not looked at. The motion starts
            from the straight finger.
        commands: motor angles α in the order in which they are passed, rad.

    Returns:
        One state per motor angle; see `equilibrium.solve`. A state that is not ok does not spoil
        those after it, and means nothing itself.
    """

    def step(last: Unknowns, command: Float[Array, ""]) -> tuple[Unknowns, Solution[State]]:
        now = eqx.tree_at(lambda p: p.command, problem, command)
        found = solve(now, last)
        ok = found.ok
        new = jax.lax.stop_gradient(unknowns_of(now, found.value))
        return jax.tree.map(lambda a, b: jnp.where(ok, a, b), new, last), found

    return jax.lax.scan(step, jax.lax.stop_gradient(straight(problem)), commands)[1]


@dataclass(frozen=True)
class Path:
    """One closing, as plain arrays with one row per motor angle; those of `equilibrium.State`.

    Attributes:
        problem: of what.
        commands: motor angles, rad.
        ok: which states are equilibria; the others mean nothing.
        messages: what the matter is, one text per state, empty where it is ok.
    """

    problem: Problem
    commands: np.ndarray
    joints: np.ndarray
    motor: np.ndarray
    forces: np.ndarray
    gaps: np.ndarray
    along: np.ndarray
    stops: np.ndarray
    residual: np.ndarray
    margin: np.ndarray
    ok: np.ndarray
    messages: tuple[str, ...]

    @property
    def per_pad(self) -> int:
        """Contacts on one pad."""
        return 0 if self.problem.thing is None else self.problem.thing.count

    def push(self, pad: int) -> np.ndarray:
        """Force on the intermediate (0) or the distal pad (1), N."""
        return self.forces[:, pad * self.per_pad : (pad + 1) * self.per_pad].sum(axis=1)


_close_batch = jax.jit(jax.vmap(close))


def close_all(problems: Sequence[Problem], commands: np.ndarray) -> list[Path]:
    """Several closings with objects of one kind, in blocks of `LANES`.

    Args:
        problems: with the same body.
        commands: motor angles, shape (problems, `STEPS`), rad.
    """
    paths = []
    for start in range(0, len(problems), LANES):
        block, moves = list(problems[start : start + LANES]), commands[start : start + LANES]
        count = len(block)
        fill = 1 if len(problems) == 1 else LANES
        block += [block[-1]] * (fill - count)
        moves = np.concatenate([moves, np.repeat(moves[-1:], fill - count, axis=0)])
        stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *block)
        found = _close_batch(stacked, jnp.asarray(moves))
        paths += [_path(problems[start + i], moves[i], _item(found, i)) for i in range(count)]
    return paths


def _item(found: Any, index: int) -> Any:
    return jax.tree.map(lambda leaf: leaf[index], found)


def _path(problem: Problem, commands: np.ndarray, found: Solution[State]) -> Path:
    state = jax.tree.map(np.asarray, found.value)
    ok = np.asarray(found.ok)
    # Reading messages costs a call each, so only those are read that say something.
    bad = np.flatnonzero(~ok)
    texts = {int(i): _item(found, int(i)).messages()[0] for i in bad}
    return Path(
        problem,
        commands,
        state.joints,
        state.motor,
        state.forces,
        state.gaps,
        state.along,
        state.stops,
        np.asarray(found.residual),
        np.asarray(found.margin),
        ok,
        tuple(texts.get(i, "") for i in range(len(ok))),
    )


def there_and_back(end: float) -> np.ndarray:
    """Motor angles from 0 to an end in 80 steps and back in 40, rad."""
    return np.concatenate([np.linspace(0, end, 81), np.linspace(end, 0, STEPS - 80)[1:]])
