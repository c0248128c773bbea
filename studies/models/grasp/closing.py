"""Closing and opening: the motor moves slowly, and every state starts from the one before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from designopt.batching import map_blocks
from designopt.programs import QuickJit
from designopt.solution import Solution
from studies.models.grasp.conditions import Problem, Unknowns, straight
from studies.models.grasp.equilibrium import GRASP, State, solve, unknowns_of

TRIES = 60
"""Solves that one step of the motor may take."""

LEAST_STRIDE = 0.1
"""A step of the motor that fails is halved down to this part; then the finger is let creep."""

LARGEST_MOVE = 0.2
"""Farther than this, rad, no joint moves in one solve, which could have passed through the object:
the step of the motor is then halved as if it had failed."""

LANES = 12
"""Closings that are computed together; a block is filled up, so that one program serves all."""

STEPS = 121
"""Motor angles of every closing, for the same reason."""


# Traced once, though its shapes are asked for before the loop.
_solve = jax.jit(solve)


def solve_closing(problem: Problem, commands: Float[Array, " steps"]) -> Solution[State]:
    """Equilibria along a motion of the motor, each solved from the last one that was found.

    Args:
        problem: finger, load and object; its own motor angle is not looked at. The motion starts
            from the straight finger.
        commands: motor angles α in the order in which they are passed, rad.

    Returns:
        One state per motor angle; see `equilibrium.solve`. A state that is not ok does not spoil
        those after it, and means nothing itself.
    """
    # A step that fails is halved, and doubled again after each part that succeeds. Where that does
    # not help the finger leaves a state that is not stable any more: it creeps on against a drag,
    # which makes every state stable, and the drag fades (implicit Euler steps of a damped motion).
    # A loop, so that all tries share one compiled solve, and no more of them are made than some
    # closing of a batch needs.
    contrast = problem.spring.contrast
    drags = 0.1 * (contrast + 1 / contrast) * jnp.asarray([1.0, 1e-4], commands.dtype)

    def move(
        last: Unknowns, step: tuple[Float[Array, ""], Float[Array, ""]]
    ) -> tuple[Unknowns, Solution[State]]:
        before, command = step

        def attempt(state: _Attempt) -> _Attempt:
            creeping = state.drag > 0
            reach = jnp.where(creeping, 1.0, state.done + state.stride)
            there = jnp.where(reach >= 1, command, before + reach * (command - before))
            now = eqx.tree_at(
                lambda p: (p.command, p.drag, p.resting),
                problem,
                (there, state.drag, state.good.joints),
            )
            found = _solve(now, state.good)
            moved = jnp.max(jnp.abs(found.value.joints - state.good.joints))
            ok = found.ok & (moved <= LARGEST_MOVE)
            new = unknowns_of(now, found.value)
            good = jax.tree.map(lambda a, b: jnp.where(ok, a, b), new, state.good)
            stride = jnp.where(ok, 2 * state.stride, state.stride / 2)
            stuck = ~ok & (stride < LEAST_STRIDE)
            fading = jnp.where(ok, state.drag / 3, state.drag * 9)
            drag = jnp.where(creeping, fading, jnp.where(stuck, drags[0], 0.0))
            faded = creeping & (drag < drags[1])
            done = jnp.where(ok & ~creeping, reach, state.done)
            stride, drag = jnp.where(creeping | stuck, 1.0, stride), jnp.where(faded, 0.0, drag)
            return _Attempt(state.count + 1, done, stride, drag, good, found)

        nothing = jax.tree.map(jnp.zeros_like, jax.eval_shape(_solve, problem, last))
        zero, one = jnp.zeros_like(command), jnp.ones_like(command)
        done = jax.lax.while_loop(
            lambda state: (state.done < 1) & (state.count < TRIES),
            attempt,
            _Attempt(jnp.asarray(0), zero, one, zero, last, nothing),
        )
        found = done.found
        # What was found on the way, against a drag or too far off, is not the state asked for.
        result = GRASP.where((done.done >= 1) | ~found.ok, found.result, GRASP.unconverged)
        return done.good, Solution(found.value, found.margin, found.residual, result)

    before = jnp.concatenate([jnp.zeros_like(commands[:1]), commands[:-1]])
    return jax.lax.scan(move, straight(problem), (before, commands))[1]


class _Attempt(eqx.Module):
    """Tries so far, the part of the step that is done, the next one, the drag, what was found."""

    count: Int[Array, ""]
    done: Float[Array, ""]
    stride: Float[Array, ""]
    drag: Float[Array, ""]
    good: Unknowns
    found: Solution[State]


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


_close_batch = QuickJit(jax.vmap(solve_closing), name="batches of solve_closing")


def close_all(problems: Sequence[Problem], commands: np.ndarray) -> list[Path]:
    """Several closings with objects of one kind, in blocks of `LANES`.

    Args:
        problems: with the same body.
        commands: motor angles, shape (problems, `STEPS`), rad.
    """
    # Through NumPy, so that a Python number and an array make the same program.
    stacked = jax.tree.map(lambda *leaves: np.stack([*map(np.asarray, leaves)]), *problems)
    found = map_blocks(_close_batch, 1 if len(problems) == 1 else LANES, stacked, commands)
    return [_path(problem, commands[i], _item(found, i)) for i, problem in enumerate(problems)]


def _item(found: Any, index: int) -> Any:
    return jax.tree.map(lambda leaf: leaf[index], found)


def _path(problem: Problem, commands: np.ndarray, found: Solution[State]) -> Path:
    ok = np.asarray(found.ok)
    # Reading messages costs a call each, so only those of failed states are read.
    bad = np.flatnonzero(~ok)
    texts = {int(i): _item(found, int(i)).messages()[0] for i in bad}
    return Path(
        problem,
        commands,
        **vars(found.value),
        residual=np.asarray(found.residual),
        margin=np.asarray(found.margin),
        ok=ok,
        messages=tuple(texts.get(i, "") for i in range(len(ok))),
    )


def there_and_back(end: float) -> np.ndarray:
    """Motor angles from 0 to an end in 80 steps and back in 40, rad."""
    return np.concatenate([np.linspace(0, end, 81), np.linspace(end, 0, STEPS - 80)[1:]])
