"""What we compare with: SciPy's solvers on JAX derivatives, and differential evolution."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jaxtyping import Float

from designopt.optimising.augmented import Trace
from designopt.optimising.flat import Flat, joined
from designopt.optimising.problem import Parameters, Problem

Reference = Literal["slsqp", "trust-constr"]


def compile_reference(
    flat: Flat, method: Reference, tolerance: float, steps: int
) -> Callable[[np.ndarray], tuple[np.ndarray, Trace]]:
    """A local solve by SciPy: from a start to a point and its history, one row per step.

    Args:
        flat: the problem.
        method: SciPy's name of the solver.
        tolerance: its own stopping tolerance.
        steps: cap on its steps.
    """
    sample = jnp.asarray(np.clip(np.zeros_like(flat.units), flat.lower, flat.upper))
    equalities = jax.eval_shape(lambda z: _both(flat, z)[:2], sample)[0].size

    def compiled(function: Callable[[Any], Any]) -> Callable[[np.ndarray], Any]:
        program = jax.jit(function).lower(sample).compile()
        return lambda x: jax.tree.map(np.asarray, program(jnp.asarray(x)))

    value_and_slope = compiled(jax.value_and_grad(lambda z: flat.terms(z).value))
    levels = compiled(lambda z: jnp.concatenate(_both(flat, z)))
    slopes = compiled(jax.jacfwd(lambda z: jnp.concatenate(_both(flat, z))))
    options: dict[str, Any]
    if method == "slsqp":
        kinds = {"eq": slice(None, equalities), "ineq": slice(equalities, None)}
        constraints: Any = [
            {
                "type": kind,
                "fun": lambda x, part=part: levels(x)[part],
                "jac": lambda x, part=part: slopes(x)[part],
            }
            for kind, part in kinds.items()
            if kind == "ineq" or equalities
        ]
        options = {"options": {"maxiter": steps, "ftol": tolerance}}
    else:
        upper = np.full(levels(np.asarray(sample)).size, np.inf)
        upper[:equalities] = 0.0
        constraints = scipy.optimize.NonlinearConstraint(
            levels, 0.0, upper, jac=slopes, hess=scipy.optimize.BFGS()
        )
        options = {"options": {"maxiter": steps, "xtol": tolerance, "gtol": tolerance}}

    def solve(start: np.ndarray) -> tuple[np.ndarray, Trace]:
        visited: list[np.ndarray] = []
        with warnings.catch_warnings():
            # Skipped quasi-Newton updates and steps clipped to the bounds are no news here.
            warnings.simplefilter("ignore")
            found = scipy.optimize.minimize(
                value_and_slope,
                np.clip(start, flat.lower, flat.upper),
                method=method,
                jac=True,
                bounds=scipy.optimize.Bounds(flat.lower, flat.upper),
                constraints=constraints,
                callback=lambda x, *_: visited.append(np.copy(x)),
                **options,
            )
        visited.append(np.clip(found.x, flat.lower, flat.upper))
        values = np.array([value_and_slope(x)[0] for x in visited])
        violations = np.array([_violation(levels(x), equalities) for x in visited])
        steps_so_far = jnp.arange(1, len(visited) + 1)
        return visited[-1], Trace(jnp.asarray(values), jnp.asarray(violations), steps_so_far)

    return solve


@dataclass(frozen=True)
class Evolution:
    """How differential evolution went, one row per generation.

    Attributes:
        seconds: since it began, without compiling.
        objective: of the best member so far.
        violation: its largest scaled violation.
        parameters: the best member of the last generation.
    """

    seconds: Float[np.ndarray, " generations"]
    objective: Float[np.ndarray, " generations"]
    violation: Float[np.ndarray, " generations"]
    parameters: Parameters


def differential_evolution(
    problem: Problem, *, seconds: float, seed: int, population: int = 15
) -> Evolution:
    """SciPy's differential evolution for a given time, every generation in one compiled call.

    Constraints are handled by its own rule (J. Lampinen 2002): feasible before infeasible.

    Args:
        problem: not in epigraph form, which this method does not need; every bound finite.
        seconds: when to stop, after the generation that is running.
        seed: of its draws.
        population: members per parameter.
    """
    flat = Flat.of(problem)
    count = population * flat.units.size

    def member(point: Any) -> Any:
        h, g = _both(flat, point)
        return flat.terms(point).value, jnp.concatenate([g, -jnp.abs(h)])

    sample = jnp.zeros((count, flat.units.size))
    generation = jax.jit(jax.vmap(member)).lower(sample).compile()
    remembered: dict[bytes, Any] = {}

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # Objective and constraints are asked for one after the other, of the same or fewer members.
        points = np.atleast_2d(x.T)
        key = points.tobytes()
        if key not in remembered:
            remembered.clear()
            padded = np.zeros((count, flat.units.size))
            padded[: len(points)] = points
            values, levels = generation(jnp.asarray(padded))
            remembered[key] = np.asarray(values)[: len(points)], np.asarray(levels)[: len(points)]
        return remembered[key]

    rows: list[tuple[float, float, float]] = []
    begin = time.perf_counter()

    def record(intermediate_result: Any) -> bool:
        values, levels = evaluate(np.asarray(intermediate_result.x)[:, None])
        violation = max(0.0, -float(np.min(levels, initial=0.0)))
        rows.append((time.perf_counter() - begin, float(values[0]), violation))
        return rows[-1][0] >= seconds

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it was stopped, and how it changes its members
        found = scipy.optimize.differential_evolution(
            lambda x: evaluate(x)[0],
            scipy.optimize.Bounds(flat.lower, flat.upper),
            constraints=scipy.optimize.NonlinearConstraint(lambda x: evaluate(x)[1].T, 0.0, np.inf),
            popsize=population,
            maxiter=10**9,
            tol=0.0,
            polish=False,
            updating="deferred",
            vectorized=True,
            callback=record,
            rng=np.random.default_rng(seed),
        )
    table = np.array(rows)
    return Evolution(*table.T, flat.parameters(jnp.asarray(found.x)))


def _both(flat: Flat, point: Any) -> tuple[Any, Any]:
    terms = flat.terms(point)
    return joined(terms.equalities, point.dtype), joined(terms.inequalities, point.dtype)


def _violation(levels: np.ndarray, equalities: int) -> float:
    unmet = np.concatenate([np.abs(levels[:equalities]), -levels[equalities:]])
    return max(0.0, float(np.max(unmet, initial=0.0)))
