"""Every solver on the same problem from the same starts: gap and violation against run time.

The problem is the last stage's with `COPIES` copies only, so that every solver gets somewhere in
its time. The objective and the largest violation of what a solver proposes are computed outside of
it, by the one compiled program of the graduated search. Run times are those of the solves one after
the other, without compiling; after k starts the best of the first k counts.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jax.flatten_util import ravel_pytree

from designopt.optimize import run_differential_evolution
from designopt.optimize.augmented_lagrangian import Inner, augmented_lagrangian
from designopt.optimize.flat import Flat
from designopt.optimize.reference_solvers import compile_reference
from designopt.study.results import PrecisionRow
from studies.models.mirror_design.design import MirrorDesign
from studies.models.mirror_design.placement import Placement, bounds, scale
from studies.models.mirror_design.problem import Task, problem_of, terms_of
from studies.models.mirror_design.searching import (
    STAGES,
    lagrangian,
    measured,
    no_multipliers,
    search,
)
from studies.models.mirror_design.spec import MirrorSpec

OURS = "graduated BFGS"
UNGRADED = "BFGS, not graduated"
EVOLUTION = "differential evolution (SciPy)"
NAMES: dict[str, str] = {
    "bfgs": "BFGS, general program",
    "slsqp": "SLSQP (SciPy)",
    "trust-constr": "trust-constr (SciPy)",
    "jaxopt-lbfgsb": "L-BFGS-B (jaxopt)",
    "jaxopt-projected-gradient": "projected gradient (jaxopt)",
    "levenberg-marquardt": "Levenberg–Marquardt",
}
"""What they are called. Around those that are not SciPy's there is an augmented Lagrangian."""

CHOICES = {"none": (), "few": ("slsqp",), "all": tuple(NAMES)}
STARTS = {"few": 2, "all": 4}
"""Random starts."""

COPIES = 6
"""Copies with errors, of those that the design has seen."""

TOLERANCE, UPDATES, STEPS = 1e-4, 5, 60

POPULATION = 4
"""Members of differential evolution for each of the 11 numbers."""

SHARES = (0.25, 0.5, 1.0)
"""Of its run time, at which it is looked at."""

HELD = 0.01
"""Largest scaled violation at which the inequalities count as held: `problem.RESERVE` bears it."""

GAP, VIOLATION = "objective gap", "violation"


class Run(NamedTuple):
    """What a solver had after some time.

    Attributes:
        method: its name.
        setting: starts, or generations, so far.
        objective: of the best so far: held before not held, then by objective.
        violation: of the same.
        seconds: so far.
        compile_seconds: before that.
    """

    method: str
    setting: str
    objective: float
    violation: float
    seconds: float
    compile_seconds: float


def compared(
    design: MirrorDesign, spec: MirrorSpec, which: str, evolution: float, seed: int
) -> list[Run]:
    """All solvers on the last stage's problem.

    Args:
        design: what the graduated search found; its random starts are taken.
        spec: as it was designed with.
        which: ``"few"`` or ``"all"`` solvers.
        evolution: seconds for differential evolution.
        seed: of its draws.
    """
    starts = [trial.start for trial in design.trials[1 : 1 + STARTS[which]]]
    limits, copies = bounds(design.finger, spec), min(COPIES, design.task.copies)
    task = design.task.first(copies)

    def graduated(tasks: Sequence[Task]) -> Callable[[Placement], Placement]:
        return lambda start: search(start, limits, tasks, STAGES, copies).placement

    def value(found: Placement) -> tuple[float, float]:
        # By the program for all copies, which is there already.
        return measured(found, design.task, copies)

    runs = [
        *_in_turn(OURS, graduated(design.tasks), starts, value, 0.0),
        *_in_turn(UNGRADED, graduated([design.task] * len(STAGES)), starts, value, 0.0),
    ]
    for method in CHOICES[which]:
        begin = time.perf_counter()
        if method == "slsqp":
            solve = _slsqp(spec, design.task, copies)
        else:
            solve = _solver(method, spec, task)
        runs += _in_turn(NAMES[method], solve, starts, value, time.perf_counter() - begin)
    return runs + list(_evolution(spec, task, evolution, seed))


def _in_turn(
    name: str,
    solve: Callable[[Placement], Placement],
    starts: Sequence[Placement],
    value: Callable[[Placement], tuple[float, float]],
    compile_seconds: float,
) -> Iterator[Run]:
    best, seconds = (True, np.inf, np.inf), 0.0
    for number, start in enumerate(starts, 1):
        begin = time.perf_counter()
        found = solve(start)
        seconds += time.perf_counter() - begin
        best = min(best, _rank(*value(found)))
        yield Run(name, _starts(number), best[1], best[2], seconds, compile_seconds)


def _solver(method: str, spec: MirrorSpec, task: Task) -> Callable[[Placement], Placement]:
    """A compiled solve from a start."""
    flat = Flat.of(problem_of(spec, task))

    def from_placements(solve: Callable[[np.ndarray], Any]) -> Any:
        return lambda start: flat.parameters(jnp.asarray(solve(np.asarray(flat.point(start)))))

    if method == "trust-constr":
        one = compile_reference(flat, method, TOLERANCE, UPDATES * STEPS)
        return from_placements(lambda point: one(point, (task,))[0])
    inner: Inner = method  # type: ignore[assignment]

    def local(point: jax.Array) -> jax.Array:
        return augmented_lagrangian(
            flat, inner, point, floor=0.0, tolerance=TOLERANCE, updates=UPDATES, steps=STEPS
        )[0]

    program = jax.jit(local).lower(jnp.zeros(flat.units.size)).compile()
    return from_placements(lambda point: program(jnp.asarray(point)))


def _slsqp(spec: MirrorSpec, task: Task, copies: int) -> Callable[[Placement], Placement]:
    """SciPy's solver; all but the inequalities' slopes by the search's program, which is there."""
    flat = Flat.of(problem_of(spec, task))
    count, none = jnp.asarray(copies), no_multipliers(task)
    units, build = ravel_pytree(scale(task.finger))

    def levels_of(point: jax.Array, task: Task) -> jax.Array:
        return ravel_pytree(terms_of(build(point * units), task).inequalities)[0]

    slopes = jax.jit(jax.jacfwd(levels_of))
    slopes = slopes.lower(jnp.zeros(flat.units.size), task.first(0)).compile()
    last: list[Any] = [b"", None]

    def values(x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        if last[0] != x.tobytes():
            (_, terms), slope = lagrangian(jnp.asarray(x), task, count, jnp.asarray(0.0), none)
            levels = np.asarray(ravel_pytree(terms.inequalities)[0])
            last[:] = x.tobytes(), (float(terms.value), np.asarray(slope), levels)
        return last[1]

    def solve(start: Placement) -> Placement:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # steps that it clips to the bounds
            found = scipy.optimize.minimize(
                lambda x: values(x)[0],
                np.clip(np.asarray(flat.point(start)), flat.lower, flat.upper),
                jac=lambda x: values(x)[1],
                method="SLSQP",
                bounds=list(zip(flat.lower.tolist(), flat.upper.tolist(), strict=True)),
                constraints={
                    "type": "ineq",
                    "fun": lambda x: values(x)[2],
                    "jac": lambda x: np.asarray(slopes(jnp.asarray(x), task.first(0))),
                },
                options={"maxiter": UPDATES * STEPS, "ftol": TOLERANCE},
            )
        return flat.parameters(jnp.asarray(np.clip(found.x, flat.lower, flat.upper)))

    return solve


def _evolution(spec: MirrorSpec, task: Task, seconds: float, seed: int) -> Iterator[Run]:
    begin = time.perf_counter()
    problem = problem_of(spec, task)
    # One member after the other: all together would leave the cache, and take six times longer.
    problem = replace(problem, terms=jax.custom_batching.sequential_vmap(terms_of))
    found = run_differential_evolution(problem, seconds=seconds, seed=seed, population=POPULATION)
    compiling = max(time.perf_counter() - begin - float(found.seconds[-1]), 0.0)
    last = len(found.seconds) - 1
    shown = {int(np.searchsorted(found.seconds, part * found.seconds[-1])) for part in SHARES}
    for at in sorted({min(at, last) for at in shown}):
        yield Run(
            EVOLUTION,
            f"{at + 1} generation{'s' if at else ''}",
            float(found.objective[at]),
            float(found.violation[at]),
            float(found.seconds[at]),
            compiling,
        )


def _rank(objective: float, violation: float) -> tuple[bool, float, float]:
    return violation > HELD, objective, violation


def _starts(number: int) -> str:
    return "1 start" if number == 1 else f"{number} starts"


def best_objective(runs: Sequence[Run]) -> float:
    """Least objective of any that holds the inequalities; NaN if none does."""
    return min((run.objective for run in runs if run.violation <= HELD), default=float("nan"))


def rows(runs: Sequence[Run]) -> list[PrecisionRow]:
    """Gaps to the best of all, in pads, of what holds the inequalities; and violations."""
    best = best_objective(runs)
    found = []
    for panel in (GAP, VIOLATION):
        for run in runs:
            gap = (run.objective - best) / 100 if run.violation <= HELD else float("nan")
            error = gap if panel == GAP else run.violation
            found.append(
                PrecisionRow(
                    run.method,
                    run.setting,
                    panel,
                    error,
                    run.seconds,
                    run.seconds,
                    run.seconds,
                    run.compile_seconds,
                )
            )
    return found
