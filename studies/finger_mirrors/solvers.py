"""Every solver on the same problem from the same starts: gap and violation against run time.

The problem is the last stage's with `COPIES` copies only, so that every solver gets somewhere in
its time. The objective and the largest violation of what a solver proposes are computed outside of
it, by the one compiled program of the graduated search. Run times are those of the solves one after
the other, without compiling; after k starts the best of the first k counts.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from designopt import Records, Report
from designopt.optimize import run_differential_evolution
from designopt.optimize.augmented_lagrangian import Inner, augmented_lagrangian
from designopt.optimize.flat import Flat
from designopt.optimize.reference_solvers import compile_reference
from studies.models.mirror_design import design as designing
from studies.models.mirror_design.design import MirrorDesign
from studies.models.mirror_design.placement import Placement, bounds
from studies.models.mirror_design.problem import Task, problem_of, terms_of
from studies.models.mirror_design.spec import FingerMirrorsSpec
from studies.models.single_runs import single_runs

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
"""Largest scaled violation at which the inequalities count as held; `problem.RESERVE` is more."""

Solve = Callable[[np.ndarray], Any]
"""From a vector of scaled numbers to the one where a solve ends."""

GAP, VIOLATION = "objective gap", "violation"


def compare(design: MirrorDesign, spec: FingerMirrorsSpec, seed: int) -> Records:
    """All solvers on the last stage's problem.

    Args:
        design: what the graduated search found; its random starts are taken.
        spec: as it was designed with, which solvers, and seconds for differential evolution.
        seed: of its draws.

    Returns:
        What each solver had after some time, the best so far (held before not held, then by
        objective): columns ``method``, ``setting`` (starts, or generations, so far),
        ``objective``, ``violation``, ``seconds`` so far and ``compile_seconds`` before that.
    """
    starts = [trial.start for trial in design.trials[1 : 1 + STARTS[spec.solvers]]]
    limits, copies = bounds(design.finger, spec), min(COPIES, design.task.copies)
    task, runs = design.task.first(copies), Records()

    def graduated(tasks: Sequence[Task]) -> Callable[[Placement], Placement]:
        return lambda start: designing.search(start, limits, tasks, copies=copies).placement

    def add(name: str, solve: Callable[[Placement], Placement], compile_seconds: float) -> None:
        best, seconds = (True, np.inf, np.inf), 0.0
        for number, start in enumerate(starts, 1):
            begin = time.perf_counter()
            placement = solve(start)
            seconds += time.perf_counter() - begin
            # By the program for all copies, which is there already.
            objective, violation = designing.measured(placement, design.task, copies)
            best = min(best, (violation > HELD, objective, violation))
            runs.add(
                method=name,
                setting=f"{number} start{'s' if number > 1 else ''}",
                objective=best[1],
                violation=best[2],
                seconds=seconds,
                compile_seconds=compile_seconds,
            )

    add(OURS, graduated(design.tasks), 0.0)
    add(UNGRADED, graduated([design.task] * len(designing.STAGES)), 0.0)
    flat = Flat.of(problem_of(spec, task))
    for method in CHOICES[spec.solvers]:
        begin = time.perf_counter()
        solve = _solver(method, flat)
        compile_seconds = time.perf_counter() - begin

        def from_placement(start: Placement, solve: Solve = solve) -> Placement:
            return flat.parameters(jnp.asarray(solve(np.asarray(flat.point(start)))))

        add(NAMES[method], from_placement, compile_seconds)
    runs.add(**_evolution(spec, task, seed))
    return runs


def _solver(method: str, flat: Flat) -> Solve:
    """A compiled solve."""
    if method in ("slsqp", "trust-constr"):
        one = compile_reference(flat, method, TOLERANCE, UPDATES * STEPS)
        return lambda point: one(point, flat.own)[0]
    inner: Inner = method  # type: ignore[assignment]

    def local(point: jax.Array) -> jax.Array:
        return augmented_lagrangian(
            flat, inner, point, floor=0.0, tolerance=TOLERANCE, updates=UPDATES, steps=STEPS
        )[0]

    program = jax.jit(local).lower(jnp.zeros(flat.units.size)).compile()
    return lambda point: program(jnp.asarray(point))


def _evolution(spec: FingerMirrorsSpec, task: Task, seed: int) -> dict[str, Any]:
    begin = time.perf_counter()
    problem = problem_of(spec, task)
    # One member after the other: all together would leave the cache, and take six times longer.
    problem = replace(problem, terms=jax.custom_batching.sequential_vmap(terms_of))
    found = run_differential_evolution(
        problem, seconds=spec.evolution_seconds, seed=seed, population=POPULATION
    )
    ends = found.seconds
    at = np.searchsorted(ends, np.array(SHARES) * ends[-1])
    shown = np.unique(np.minimum(at, len(ends) - 1))
    return {
        "method": EVOLUTION,
        "setting": [f"{i + 1} generation{'s' if i else ''}" for i in shown],
        "objective": found.objective[shown],
        "violation": found.violation[shown],
        "seconds": ends[shown],
        "compile_seconds": max(time.perf_counter() - begin - float(ends[-1]), 0.0),
    }


def add_comparison(out: Report, runs: Records) -> None:
    """Table, error against run time in pads, and whether the graduated search is ahead."""
    held = runs["violation"] <= HELD
    gap = runs["objective"] - min(runs["objective"][held].tolist(), default=math.nan)
    runs = runs | {"gap": gap, GAP: np.where(held, gap / 100, math.nan)}
    out.table("solvers", runs | {"solver": runs["method"]})
    out.precision(
        [row for panel in (GAP, VIOLATION) for row in single_runs(runs, panel, panel)],
        "gap (pads) or violation",
        "the least objective that any solver of this run found with the inequalities held to "
        f"{HELD:g}; both computed outside of the solvers",
        out.claim("graduated", *_ahead(runs)),
    )


def _ahead(runs: Records) -> tuple[list[str], bool]:
    """Whether the graduated search is ahead of differential evolution within its time."""
    own, evolution = runs.where(method=OURS), runs.where(method=EVOLUTION)
    ahead = own.where(
        (own["violation"] <= HELD)
        & (own["seconds"] <= evolution["seconds"][-1])
        & (own["objective"] < evolution["objective"][-1])
    )

    def reached(runs: Records, row: int) -> str:
        what = f"gap {runs[GAP][row]:.3g} pads"
        if runs["violation"][row] > HELD:
            what = f"violation {runs['violation'][row]:.2g}"
        return f"{what} after {runs['seconds'][row]:.0f} s"

    graduated = "never ahead within that time"
    if len(ahead):
        graduated = f"{reached(ahead, 0)} ({ahead['setting'][0]})"
    evidence = f"differential evolution: {reached(evolution, -1)}; graduated search: {graduated}"
    return [evidence], len(ahead) > 0
