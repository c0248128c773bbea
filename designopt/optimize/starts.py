"""Where to start: points of a Sobol sequence between the bounds."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from designopt.batching import map_in_chunks
from designopt.optimize.augmented_lagrangian import FIRST_PENALTY
from designopt.optimize.problem import Evaluation, Parameters, Problem
from designopt.programs import QuickJit

BLOCK = 256
"""Points looked at in one go, so that what lies between stays in the cache."""


def draw_sobol_starts(problem: Problem, count: int, seed: int) -> Parameters:
    """Scrambled Sobol points in the box of the bounds.

    Args:
        problem: its bounds must all be finite.
        count: how many; best a power of two.
        seed: of the scrambling.

    Returns:
        Parameters with the starts along a new first axis of every array.

    Raises:
        ValueError: a bound is not finite.

    Example:
        >>> import jax.numpy as jnp
        >>> from designopt.optimize import Evaluation, Problem
        >>> problem = Problem(lambda x: Evaluation(objective=x[0]), jnp.zeros(2), jnp.ones(2))
        >>> draw_sobol_starts(problem, 4, seed=0).shape
        (4, 2)
    """
    lower, unravel = ravel_pytree(problem.lower)
    upper, _ = ravel_pytree(problem.upper)
    if not bool(jnp.all(jnp.isfinite(lower) & jnp.isfinite(upper))):
        raise ValueError("draw_sobol_starts: every parameter needs a finite lower and upper bound")
    from scipy.stats import qmc  # takes a second, and not every search has many starts

    sampler = qmc.Sobol(lower.size, rng=np.random.default_rng(seed))
    power = max(count - 1, 0).bit_length()
    points = jnp.asarray(sampler.random_base2(power)[:count], lower.dtype)
    return jax.vmap(lambda point: unravel(lower + point * (upper - lower)))(points)


@dataclass(frozen=True)
class Starts:
    """The most promising of many points.

    Attributes:
        parameters: the starts along the first axis of every array, the most promising one first.
        seconds: run time of the look at all points, without compiling.
        compile_seconds: time to compile it.
    """

    parameters: Parameters
    seconds: float
    compile_seconds: float


def select_starts(
    problem: Problem, count: int, seed: int, *, among: int = 4096, scale: float = 1.0
) -> Starts:
    """The most promising of many Sobol points: those of least objective plus squared violations.

    Most points of a box are far from any feasible design; local solves from there are wasted.

    Args:
        problem: its bounds must all be finite.
        count: how many to return.
        seed: of the scrambling.
        among: how many points to look at, if that is more than are returned.
        scale: change of the objective that matters about as much as 1 in a constraint.

    Raises:
        ValueError: a bound is not finite.

    Example:
        >>> import jax.numpy as jnp
        >>> from designopt.optimize import Evaluation, Problem
        >>> problem = Problem(
        ...     lambda x: Evaluation(objective=(x - 0.3) ** 2), jnp.zeros(()), jnp.ones(())
        ... )
        >>> round(float(select_starts(problem, 1, seed=0, among=256).parameters[0]), 1)
        0.3
    """
    points = draw_sobol_starts(problem, max(among, count), seed)
    begin = time.perf_counter()
    choose = partial(_best, evaluate=problem.terms, count=count, scale=scale)
    name = f"best {count} {scale} of {problem.name}" if problem.name else ""
    program = QuickJit(choose, name=name).compile(points, problem.data)
    compiled = time.perf_counter()
    starts = jax.block_until_ready(program(points, problem.data))
    return Starts(starts, time.perf_counter() - compiled, compiled - begin)


def _best(
    points: Parameters,
    data: tuple[Any, ...],
    evaluate: Callable[..., Evaluation],
    count: int,
    scale: float,
) -> Parameters:
    def merit(parameters: Parameters) -> Float[Array, ""]:
        terms = evaluate(parameters, *data)
        short = (jnp.minimum(part, 0.0) for part in terms.inequalities.values())
        unmet = sum((jnp.sum(part**2) for part in (*short, *terms.equalities.values())), 0.0)
        value = terms.value / scale + FIRST_PENALTY / 2 * unmet
        return jnp.where(jnp.isfinite(value), value, jnp.inf)

    chosen = jnp.argsort(map_in_chunks(jax.vmap(merit), points, BLOCK))[:count]
    return jax.tree.map(lambda leaf: leaf[chosen], points)
