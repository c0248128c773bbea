"""A local solve a few steps at a time: what a person watches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from designopt.optimize.augmented_lagrangian import (
    State,
    achievable,
    first_state,
    lagrangian,
    updated,
)
from designopt.optimize.flat import Flat, Given, Point
from designopt.optimize.problem import Parameters, Problem

FORWARD = {"autodiff_mode": "fwd"}
"""Of a handful of parameters the slope forwards compiles in half the time, and is as fast."""

INNER_STEPS = 30
"""Cap on steps between two updates of the multipliers."""


@dataclass(frozen=True)
class Iterate:
    """Where a solve is after an iteration.

    Attributes:
        parameters: inside their bounds.
        objective: of the problem there; not finite where it has no numbers.
        violation: largest violation of a constraint there, scaled.
        done: whether nothing follows.
        converged: whether it is done by itself, and not because it has reached its cap.
    """

    parameters: Parameters
    objective: float
    violation: float
    done: bool
    converged: bool


class _Progress(eqx.Module):
    """Where the solve is.

    Attributes:
        outer: after the last update of the multipliers.
        point: where BFGS is.
        search: its state.
        count: its steps since the last update.
        done: whether there is nothing more to do.
    """

    outer: State
    point: Point
    search: Any
    count: Int[Array, ""]
    done: Bool[Array, ""]


class Iteration:
    """A problem's local solve that yields every iteration, compiled once for all its starts.

    It is an augmented Lagrangian around BFGS (`augmented_lagrangian`), interrupted after every few
    steps of BFGS, which keeps what it has learnt of the curvature. The first iteration compiles
    the program that runs all of them.
    """

    def __init__(self, problem: Problem, *, tolerance: float = 1e-6, steps: int = 5) -> None:
        """Nothing is compiled yet.

        Args:
            problem: its terms must not have ``least``: see `make_epigraph` and
                `make_soft_minimum`.
            tolerance: of the inner solver (relative and absolute) and of the constraints, scaled.
            steps: steps of BFGS in an iteration.

        Raises:
            ValueError: the terms have ``least``.
        """
        self._flat = flat = Flat.of(problem)
        point = jnp.zeros(flat.units.size, flat.units.dtype)
        flat.refuse_least("iterating")
        self._begin, self._advance = _programs(flat, achievable(tolerance, point), steps)

    def run(
        self, start: Parameters, data: tuple[Any, ...] | None = None, *, updates: int = 60
    ) -> Iterator[Iterate]:
        """Solve from one start.

        Args:
            start: it need not meet the constraints, nor be inside its bounds.
            data: the problem's data, or others of the same shapes; its own by default.
            updates: cap on iterations.
        """
        flat = self._flat
        given = (flat.problem.data if data is None else data), (flat.lower, flat.upper)
        progress = self._begin(flat.clipped(flat.point(start)), given)
        for number in range(1, updates + 1):
            progress, (point, value, violation) = self._advance(progress, given)
            converged = bool(progress.done)
            done = converged or number == updates
            parameters = flat.parameters(point)
            yield Iterate(parameters, float(value), float(violation), done, converged)
            if done:
                return


def _programs(flat: Flat, tolerance: float, steps: int) -> tuple[Callable[..., Any], ...]:
    """From a start to the first progress; and from one progress to the next and what it shows."""
    merit = lagrangian(flat, "bfgs")
    tags: frozenset[object] = frozenset()

    def with_nothing(point: Point, args: Any) -> tuple[Float[Array, ""], None]:
        return merit(point, args), None

    def bfgs(outer: State) -> optx.BFGS:
        absolute: Any = tolerance / outer.penalty  # annotated float, but may be traced
        return optx.BFGS(tolerance, absolute)

    def begun(outer: State, done: Bool[Array, ""]) -> _Progress:
        value = jax.ShapeDtypeStruct((), outer.point.dtype)
        search = bfgs(outer).init(with_nothing, outer.point, None, FORWARD, value, None, tags)
        return _Progress(outer, outer.point, search, jnp.zeros((), int), done)

    def stepped(progress: _Progress, given: Given) -> _Progress:
        outer, count = progress.outer, progress.count + 1
        args = (*outer.multipliers, outer.penalty, given)
        point, search, _ = bfgs(outer).step(
            with_nothing, progress.point, args, FORWARD, progress.search, tags
        )
        lost = ~jnp.all(jnp.isfinite(point))
        if not outer.held:
            return _Progress(outer, point, search, count, search.terminate | lost)

        def multiplied() -> _Progress:
            after = updated(flat.given(given), "bfgs", outer, point, count, tolerance)
            return begun(after, (after.done & search.terminate) | lost)

        return jax.lax.cond(
            search.terminate | lost | (count >= INNER_STEPS),
            multiplied,
            lambda: _Progress(outer, point, search, count, jnp.zeros((), bool)),
        )

    @jax.jit
    def begin(start: Point, given: Given) -> _Progress:
        return begun(first_state(flat.given(given), "bfgs", start, 1), jnp.zeros((), bool))

    @jax.jit
    def advance(progress: _Progress, given: Given) -> tuple[_Progress, Any]:
        _, progress = jax.lax.while_loop(
            lambda carry: (carry[0] < steps) & ~carry[1].done,
            lambda carry: (carry[0] + 1, stepped(carry[1], given)),
            (0, progress),
        )
        point = flat.clipped(progress.point)
        terms, h, g = flat.given(given).evaluated(point)
        violation = jnp.max(jnp.concatenate([jnp.abs(h), -g]), initial=0.0)
        return progress, (point, terms.value, violation)

    return begin, advance
