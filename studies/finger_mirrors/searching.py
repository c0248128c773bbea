"""The graduated search: the problem with large errors first, then with smaller ones.

With errors many times the stated ones, some copy sees something from almost every start, so the
objective has a slope where the exact problem has none; shrunk step by step they lead to the optimum
(the idea of graduated optimisation: A. Blake, A. Zisserman, *Visual Reconstruction*, 1987). Between
the stages only numbers change, so all stages, starts and bodies share one compiled program. Every
stage is a bounded quasi-Newton search (SciPy's L-BFGS-B) of the augmented Lagrangian, as in
`designopt.optimising.augmented`, whose multipliers are carried from stage to stage.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from designopt.optimising import Terms
from studies.finger_mirrors.arrangement import Arrangement, scale
from studies.finger_mirrors.problem import Look, Task, look, upkeep

Multipliers = dict[str, Float[Array, "..."]]
"""Of the inequalities, by name."""


class Stage(NamedTuple):
    """One stage.

    Attributes:
        growth: of the copies' errors, over those at the end.
        penalty: on the square of a violation; 0 leaves the inequalities out, for early ones would
            hold on to whatever glimpse is sharp.
        evaluations: cap on evaluations of the gradient.
    """

    growth: float
    penalty: float
    evaluations: int


STAGES = (
    Stage(4.0, 0.0, 50),
    Stage(2.0, 1.0, 40),
    Stage(1.0, 10.0, 40),
    Stage(1.0, 100.0, 40),
)

LINE_SEARCH = 12
"""Cap on steps of a line search: on a kink it finds no end."""

MEMORY = 20
"""Pairs that L-BFGS-B remembers: more than there are numbers."""


class Trial(NamedTuple):
    """What one start led to.

    Attributes:
        start: where it began.
        arrangement: where it ended.
        objective: there, of the last stage.
        violation: largest violation of an inequality there, scaled.
        evaluations: of the gradient, in all.
        seconds: without compiling.
    """

    start: Arrangement
    arrangement: Arrangement
    objective: float
    violation: float
    evaluations: int
    seconds: float


def search(
    start: Arrangement,
    bounds: tuple[Arrangement, Arrangement],
    tasks: Sequence[Task],
    stages: Sequence[Stage] = STAGES,
    copies: int | None = None,
) -> Trial:
    """Search from one start through all stages.

    Args:
        start: it need not be inside the bounds.
        bounds: least and greatest values.
        tasks: one per stage, all of one size.
        stages: as many as tasks.
        copies: the first so many of a task count; all of them by default.
    """
    begin = time.perf_counter()
    units, build = ravel_pytree(scale())
    units = np.asarray(units)
    low, high, point = (np.asarray(ravel_pytree(one)[0]) / units for one in (*bounds, start))
    point = np.clip(point, low, high)
    terms: Terms | None = None
    multipliers = no_multipliers(tasks[0])
    count = jnp.asarray(tasks[0].copies if copies is None else copies)
    evaluations = 0
    for task, stage in zip(tasks, stages, strict=True):
        penalty = jnp.asarray(stage.penalty)
        held = multipliers

        def asked(
            x: np.ndarray, task: Task = task, penalty: Array = penalty, held: Any = held
        ) -> tuple[float, np.ndarray]:
            (value, _), slope = lagrangian(jnp.asarray(x), task, count, penalty, held)
            return float(value), np.asarray(slope)

        done = scipy.optimize.minimize(
            asked,
            point,
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(low.tolist(), high.tolist(), strict=True)),
            options={
                "maxfun": stage.evaluations,
                "maxiter": stage.evaluations,
                "maxls": LINE_SEARCH,
                "maxcor": MEMORY,
            },
        )
        point, evaluations = done.x, evaluations + int(done.nfev)
        (_, reached), _ = lagrangian(jnp.asarray(point), task, count, penalty, held)
        terms, levels = reached, reached.inequalities
        multipliers = jax.tree.map(
            lambda m, g, penalty=penalty: jnp.maximum(m - penalty * g, 0.0),
            held,
            levels,
        )
    assert terms is not None
    return Trial(
        start,
        build(jnp.asarray(point * units)),
        float(terms.value),
        _violation(terms),
        evaluations,
        time.perf_counter() - begin,
    )


def measured(
    arrangement: Arrangement, task: Task, copies: int | None = None
) -> tuple[float, float]:
    """Objective and largest scaled violation of an arrangement, by the search's own program."""
    point = ravel_pytree(jax.tree.map(jnp.divide, arrangement, scale()))[0]
    count = jnp.asarray(task.copies if copies is None else copies)
    none = no_multipliers(task)
    (_, terms), _ = lagrangian(point, task, count, jnp.asarray(0.0), none)
    return float(terms.value), _violation(terms)


def _violation(terms: Terms) -> float:
    return max(0.0, *(float(jnp.max(-leaf)) for leaf in terms.inequalities.values()))


def no_multipliers(task: Task) -> Multipliers:
    """Zeros: nothing is known of the inequalities yet."""
    pads = len(task.finger.layout.pads)
    places = task.plain * task.angles.shape[1]
    return {"resolution": jnp.zeros((places, pads)), "clearance": jnp.zeros(2)}


@jax.jit
def lagrangian(
    point: Float[Array, " parameters"],
    task: Task,
    copies: Int[Array, ""],
    penalty: Float[Array, ""],
    multipliers: Multipliers,
) -> tuple[tuple[Float[Array, ""], Terms], Float[Array, " parameters"]]:
    """Augmented Lagrangian of `problem.terms_of`, the terms, and its slope.

    It is a sum over looks, so each look's slope is found by itself: nothing of the other looks is
    kept for it, and how many copies count is a number, not a shape.
    """
    units, build = ravel_pytree(scale())
    plain, poses = task.plain, task.angles.shape[1]
    sharp = multipliers["resolution"].reshape(plain, poses, -1)

    def of_look(
        point: Float[Array, " parameters"], number: Int[Array, ""]
    ) -> tuple[Float[Array, ""], Look]:
        seen = look(build(point * units), task, number)
        unmet = _unmet(seen.resolution, sharp[jnp.minimum(number, plain - 1)], penalty)
        with_errors = number >= plain
        value = jnp.where(with_errors, 100 / copies, 100 / plain) * seen.missing
        return value + jnp.where(with_errors, 0.0, unmet), seen._replace(missing=value)

    def of_rest(
        point: Float[Array, " parameters"],
    ) -> tuple[Float[Array, ""], tuple[Float[Array, ""], Float[Array, "2"]]]:
        price, clearance = upkeep(build(point * units), task)
        return price + _unmet(clearance, multipliers["clearance"], penalty), (price, clearance)

    def add(number: Int[Array, ""], so_far: Any) -> Any:
        total, value, levels, slope = so_far
        (part, seen), of_part = jax.value_and_grad(of_look, has_aux=True)(point, number)
        levels = levels.at[number].set(seen.resolution)
        return total + part, value + seen.missing, levels, slope + of_part

    (total, (price, clearance)), slope = jax.value_and_grad(of_rest, has_aux=True)(point)
    levels = jnp.zeros((len(task.angles), *sharp.shape[1:]))
    first = (total, price, levels, slope)
    total, value, levels, slope = jax.lax.fori_loop(0, plain + copies, add, first)
    resolution = levels[:plain].reshape(multipliers["resolution"].shape)
    inequalities = {"resolution": resolution, "clearance": clearance}
    return (total, Terms(objective=value, inequalities=inequalities)), slope


def _unmet(
    levels: Float[Array, "*all"], multipliers: Float[Array, "*all"], penalty: Float[Array, ""]
) -> Float[Array, ""]:
    squares = jnp.maximum(multipliers - penalty * levels, 0.0) ** 2 - multipliers * multipliers
    return jnp.sum(squares) / jnp.maximum(2 * penalty, 1e-9)
