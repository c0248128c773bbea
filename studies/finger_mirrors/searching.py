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
from jaxtyping import Array, Float

from designopt.optimising import Terms
from studies.finger_mirrors.arrangement import Arrangement, scale
from studies.finger_mirrors.problem import Task, terms_of


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
    Stage(4.0, 0.0, 70),
    Stage(2.0, 1.0, 50),
    Stage(1.0, 10.0, 50),
    Stage(1.0, 100.0, 50),
    Stage(1.0, 300.0, 50),
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
) -> Trial:
    """Search from one start through all stages.

    Args:
        start: it need not be inside the bounds.
        bounds: least and greatest values.
        tasks: one per stage, all of one size.
        stages: as many as tasks.
    """
    begin = time.perf_counter()
    units, build = ravel_pytree(scale())
    units = np.asarray(units)
    low, high, point = (np.asarray(ravel_pytree(one)[0]) / units for one in (*bounds, start))
    point = np.clip(point, low, high)
    multipliers: Any = None
    terms: Terms | None = None
    evaluations = 0
    for task, stage in zip(tasks, stages, strict=True):
        penalty = jnp.asarray(stage.penalty)
        if multipliers is None:
            shapes = jax.eval_shape(terms_of, build(jnp.asarray(units)), task).inequalities
            multipliers = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
        held = multipliers

        def asked(
            x: np.ndarray, task: Task = task, penalty: Array = penalty, held: Any = held
        ) -> tuple[float, np.ndarray]:
            (value, _), slope = _lagrangian(jnp.asarray(x), task, penalty, held)
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
        (_, reached), _ = _lagrangian(jnp.asarray(point), task, penalty, held)
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


def measured(arrangement: Arrangement, task: Task) -> tuple[float, float]:
    """Objective and largest scaled violation of an arrangement, by the search's own program."""
    point = ravel_pytree(jax.tree.map(jnp.divide, arrangement, scale()))[0]
    shapes = jax.eval_shape(terms_of, arrangement, task).inequalities
    none = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    (_, terms), _ = _lagrangian(point, task, jnp.asarray(0.0), none)
    return float(terms.value), _violation(terms)


def _violation(terms: Terms) -> float:
    return max(0.0, *(float(jnp.max(-leaf)) for leaf in terms.inequalities.values()))


@jax.jit
def _lagrangian(
    point: Float[Array, " parameters"], task: Task, penalty: Float[Array, ""], multipliers: Any
) -> tuple[tuple[Float[Array, ""], Terms], Float[Array, " parameters"]]:
    """Augmented Lagrangian, the terms, and its slope."""
    units, build = ravel_pytree(scale())

    def value(point: Float[Array, " parameters"]) -> tuple[Float[Array, ""], Terms]:
        terms = terms_of(build(point * units), task)
        unmet = 0.0
        for name, levels in terms.inequalities.items():
            m = multipliers[name]
            squares = jnp.maximum(m - penalty * levels, 0.0) ** 2 - m * m
            unmet = unmet + jnp.sum(squares) / jnp.maximum(2 * penalty, 1e-9)
        return terms.value + unmet, terms

    return jax.value_and_grad(value, has_aux=True)(point)
