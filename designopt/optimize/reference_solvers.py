"""What we compare with: SciPy's solvers on JAX derivatives, and differential evolution."""

from __future__ import annotations

import contextlib
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

from designopt.optimize.augmented_lagrangian import Trace
from designopt.optimize.flat import Flat, Given, column_slopes
from designopt.optimize.problem import Parameters, Problem
from designopt.programs import QuickJit

Reference = Literal["slsqp", "trust-constr"]


def compile_reference(
    flat: Flat, method: Reference, tolerance: float, steps: int
) -> Callable[[np.ndarray, Given], tuple[np.ndarray, Trace]]:
    """A local solve by SciPy: from a start, data and bounds to a point and its history.

    Args:
        flat: the problem.
        method: SciPy's name of the solver.
        tolerance: its own stopping tolerance.
        steps: cap on its steps.
    """
    sample = jnp.asarray(flat.units)
    _, h, g = jax.eval_shape(flat.evaluated, sample)
    equalities, inequalities = h.size, g.size

    now = flat.own

    def compiled(what: str, function: Callable[[Any, Any], Any]) -> Callable[[np.ndarray], Any]:
        program = QuickJit(function, name=flat.name(what)).compile(sample, now)

        def evaluate(x: np.ndarray) -> Any:
            # With the data of the solve that is running.
            found = program(jnp.asarray(x, sample.dtype), now)
            return jax.tree.map(lambda part: np.asarray(part, np.float64), found)

        return evaluate

    value_and_slope = compiled(
        "value and slope", jax.value_and_grad(lambda z, d: flat.given(d).terms(z).value)
    )
    levels = compiled("levels", lambda z, d: jnp.concatenate(flat.given(d).evaluated(z)[1:]))
    slopes = compiled(
        "slopes of levels",
        lambda z, d: column_slopes(lambda q: jnp.concatenate(flat.given(d).evaluated(q)[1:]), z)[1],
    )

    def part_of(function: Callable[[Any], Any], part: slice) -> Callable[[Any], Any]:
        return lambda x: function(x)[part]

    constraints: Any = ()
    if method == "slsqp":
        kinds = {"eq": slice(None, equalities), "ineq": slice(equalities, None)}
        constraints = [
            {"type": kind, "fun": part_of(levels, part), "jac": part_of(slopes, part)}
            for kind, part in kinds.items()
        ]
        options: dict[str, Any] = {"maxiter": steps, "ftol": tolerance}
    else:
        if equalities + inequalities:
            upper = np.repeat([0.0, np.inf], [equalities, inequalities])
            curvature: Any = scipy.optimize.BFGS()
            jacobian: Any = slopes  # annotated as a string by SciPy, which takes a function
            constraints = scipy.optimize.NonlinearConstraint(
                levels, 0.0, upper, jac=jacobian, hess=curvature
            )
        # Its test of the gradient leaves out the barrier, so that on its own it would end
        # far inside the bounds; steps that are too small end the search where the barrier is gone.
        least = {"xtol": tolerance, "barrier_tol": tolerance, "gtol": 1e-4 * tolerance}
        options = {"maxiter": steps, **least}

    def solve(start: np.ndarray, given: Given) -> tuple[np.ndarray, Trace]:
        nonlocal now
        now = given
        visited = [np.clip(start.astype(np.float64), *now[1])]
        known = (value_and_slope(visited[0]), levels(visited[0]), slopes(visited[0]))
        if all(np.all(np.isfinite(part)) for part in jax.tree.leaves(known)):
            visited += searched(visited[0])
        values = jnp.asarray(np.array([value_and_slope(x)[0] for x in visited]))
        violations = np.array([_violation(levels(x), equalities) for x in visited])
        trace = Trace(values, jnp.asarray(violations), jnp.arange(len(visited)))
        return visited[-1], trace

    def searched(start: np.ndarray) -> list[np.ndarray]:
        visited: list[np.ndarray] = []
        with warnings.catch_warnings():
            # Skipped quasi-Newton updates and steps clipped to the bounds are no news here; and its
            # linear algebra refuses numbers that are none, where the search has left the domain.
            warnings.simplefilter("ignore")
            with contextlib.suppress(ValueError, np.linalg.LinAlgError):
                found = scipy.optimize.minimize(
                    value_and_slope,
                    start,
                    method=method,
                    jac=True,
                    bounds=_box(*now[1]),
                    constraints=constraints,
                    callback=lambda x, *_: visited.append(np.copy(x)),
                    options=options,
                )
                visited.append(np.clip(found.x, *now[1]))
        return visited

    return solve


EQUALITY = 1e-4
"""How far from 0 differential evolution may leave an equality, scaled: it would not find a point
on it (the convention of comparisons of such methods; J. J. Liang et al. 2006, Problem Definitions
for the CEC 2006 Special Session)."""


@dataclass(frozen=True)
class Evolution:
    """How differential evolution went, one row per generation.

    Attributes:
        seconds: since it began, without compiling.
        objective: of the best member so far, in the order of its rule: it may rise when the
            violation falls.
        violation: its largest scaled violation.
        parameters: the best member of the last generation.
    """

    seconds: Float[np.ndarray, " generations"]
    objective: Float[np.ndarray, " generations"]
    violation: Float[np.ndarray, " generations"]
    parameters: Parameters


def run_differential_evolution(
    problem: Problem, *, seconds: float, seed: int, population: int = 15
) -> Evolution:
    """SciPy's differential evolution for a given time, every generation in one compiled call.

    Constraints are handled by its own rule (J. Lampinen 2002): feasible before infeasible. An
    equality counts as met to `EQUALITY`; where the problem has no numbers a member is the worst.

    Args:
        problem: with ``least`` as it is, not in epigraph form, which this method does not need;
            every bound finite.
        seconds: when to stop, after the generation that is running.
        seed: of its draws.
        population: members per parameter.

    Raises:
        ValueError: a bound is not finite.

    Example:
        >>> import jax.numpy as jnp
        >>> from designopt.optimize import Evaluation
        >>> problem = Problem(
        ...     lambda x: Evaluation(objective=jnp.sum(x**2)), -jnp.ones(2), jnp.ones(2)
        ... )
        >>> float(run_differential_evolution(problem, seconds=0.2, seed=0).objective[-1]) < 0.1
        True
    """
    flat = Flat.of(problem)
    count = max(population * flat.units.size, 5)  # SciPy's least

    def member(point: Any) -> Any:
        terms, h, g = flat.evaluated(point)
        value, levels = terms.value, jnp.concatenate([g, -jnp.abs(h)])
        levels = jnp.where(jnp.isfinite(levels), levels, -jnp.inf)
        return jnp.where(jnp.isfinite(value), value, jnp.inf), levels

    sample = jnp.zeros((count, flat.units.size), flat.units.dtype)
    _, h, g = jax.eval_shape(flat.evaluated, sample[0])
    least = np.repeat([0.0, -EQUALITY], [g.size, h.size])
    constraints: Any = ()
    if least.size:
        constraints = scipy.optimize.NonlinearConstraint(
            lambda x: evaluate(x)[1].T, least, np.full(least.size, np.inf)
        )
    generation = QuickJit(jax.vmap(member)).compile(sample)
    remembered: dict[bytes, Any] = {}

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # Constraints and objective are asked for one after the other, of the same or fewer members.
        points = np.atleast_2d(x.T)
        keys = [point.tobytes() for point in points]
        if not all(key in remembered for key in keys):
            padded = np.zeros(sample.shape, sample.dtype)
            padded[: len(points)] = points
            found = map(np.asarray, generation(jnp.asarray(padded)))
            remembered.clear()
            remembered.update(zip(keys, zip(*found, strict=True), strict=False))
        # Of no members where all of them break a constraint.
        return (
            np.array([remembered[key][0] for key in keys]),
            np.array([remembered[key][1] for key in keys]).reshape(len(keys), least.size),
        )

    seconds_so_far, objectives, violations = [], [], []
    leader: dict[bytes, Any] = {}
    begin = time.perf_counter()

    def record(intermediate_result: Any) -> bool:
        best = np.asarray(intermediate_result.x)
        key = best.tobytes()
        # Mostly a member of the generation that has just been computed, or the leader before.
        if key not in leader:
            found = remembered.get(key)
            leader.clear()
            leader[key] = found or tuple(part[0] for part in evaluate(best[:, None]))
        value, levels = leader[key]
        seconds_so_far.append(time.perf_counter() - begin)
        objectives.append(float(value))
        violations.append(max(0.0, -float(np.min(levels, initial=0.0))))
        return seconds_so_far[-1] >= seconds

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it was stopped, and how it changes its members
        found = scipy.optimize.differential_evolution(
            lambda x: evaluate(x)[0],
            _box(flat.lower, flat.upper),
            constraints=constraints,
            popsize=population,
            maxiter=10**9,
            tol=0.0,
            polish=False,
            updating="deferred",
            vectorized=True,
            callback=record,
            rng=np.random.default_rng(seed),
        )
    return Evolution(
        seconds=np.array(seconds_so_far),
        objective=np.array(objectives),
        violation=np.array(violations),
        parameters=flat.parameters(jnp.asarray(found.x, sample.dtype)),
    )


def _box(lower: Any, upper: Any) -> scipy.optimize.Bounds:
    # Annotated as numbers by SciPy, which takes arrays.
    return scipy.optimize.Bounds(lower, upper)


def _violation(levels: np.ndarray, equalities: int) -> float:
    unmet = np.concatenate([np.abs(levels[:equalities]), -levels[equalities:]])
    return max(0.0, float(np.max(unmet, initial=0.0)))
