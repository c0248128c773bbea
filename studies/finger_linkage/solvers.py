"""Every solver on the coarse problem of the search, and differential evolution as the yardstick."""

from __future__ import annotations

import math

import jax
import numpy as np

from designopt.compilation_cache import forget_programs_if_many
from designopt.optimize import (
    FEASIBLE,
    Evolution,
    Method,
    Optima,
    make_epigraph_starts,
    run_differential_evolution,
)
from designopt.study.plots import lines
from designopt.study.records import Records
from designopt.study.report import Report
from studies.models.linkage_design.searching import Search, exact, least_angles_deg, minimizer
from studies.models.linkage_design.spec import FingerLinkageSpec
from studies.models.single_runs import single_runs

METHODS: dict[Method, tuple[str, tuple[int, ...]]] = {
    "bfgs": ("Optimistix BFGS", (1,)),
    "levenberg-marquardt": ("Optimistix LM", (1, 8)),
    "slsqp": ("SciPy SLSQP", (1, 8)),
    "trust-constr": ("SciPy trust-constr", (1,)),
    "jaxopt-lbfgsb": ("jaxopt L-BFGS-B", (1,)),
    "jaxopt-projected-gradient": ("jaxopt projected gradient", (1,)),
}
"""What they are called, and from how many starts they run beside the study's own solve. Around
those of Optimistix and jaxopt there is an augmented Lagrangian."""

EVOLUTION = "SciPy differential evolution"
SHARES = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1)
"""Of its run time, at which it is compared."""

PANEL = "least transmission angle over the coarse square"

NEAR_DEG = 0.2
"""How near to the study's optimum the yardstick is asked to come, degrees."""


def evolution_at(evolution: Evolution, seconds: float) -> float:
    """Least angle that differential evolution has reached by then, degrees; 0 if none."""
    done = (evolution.seconds <= seconds) & (evolution.violation <= FEASIBLE)
    return float(np.max(-np.rad2deg(evolution.objective[done]), initial=0.0))


def compare(spec: FingerLinkageSpec, found: Search, seed: int) -> tuple[Records, Evolution]:
    """All solvers on the problem of the search's first round, from its starts.

    Returns:
        Columns ``method``, ``setting``, ``least_deg``, ``violation``, ``seconds`` without compiling
        and ``compile_seconds``, the study's own solve first; and how differential evolution went.
    """
    problem = found.rounds[0].problem
    starts, runs = found.starts, Records()
    every = make_epigraph_starts(problem, starts.parameters)

    def add(method: Method, count: int, optima: Optima) -> None:
        runs.add(
            method=METHODS[method][0],
            setting=f"{count} start{'s' if count > 1 else ''}",
            least_deg=least_angles_deg(problem, [optima.best])[0],
            violation=optima.best.violation,
            seconds=optima.seconds + starts.seconds,
            compile_seconds=optima.compile_seconds + starts.compile_seconds,
        )

    add("bfgs", spec.search.starts, found.rounds[0].optima)
    for method, (_, counts) in METHODS.items():
        forget_programs_if_many()
        for count in counts:
            if count <= spec.search.starts and (method, count) != ("bfgs", spec.search.starts):
                own = jax.tree.map(lambda leaf, n=count: leaf[:n], every)
                add(method, count, minimizer(problem, count, method).solve(own, exact(problem)))
    evolution = run_differential_evolution(problem, seconds=spec.evolution_seconds, seed=seed)
    ends = spec.evolution_seconds * np.array(SHARES)
    least = np.array([evolution_at(evolution, end) for end in [*ends[:-1], np.inf]])
    runs.add(
        method=EVOLUTION,
        setting=[f"{end:.3g} s" for end in ends],
        least_deg=least,
        violation=np.where(least > 0, 0.0, 1.0),
        seconds=ends,
        compile_seconds=0.0,
    )
    return runs, evolution


def add_comparison(out: Report, runs: Records, evolution: Evolution) -> None:
    """Metrics, table, figure and claim of what `compare` gives."""
    least, seconds = runs["least_deg"][0], runs["seconds"][0]
    feasible = (runs["violation"] <= FEASIBLE) & np.isfinite(runs["least_deg"])
    gap_deg = max(runs["least_deg"][feasible].tolist(), default=math.nan) - runs["least_deg"]
    then = evolution_at(evolution, seconds)
    close = -np.rad2deg(evolution.objective) >= least - NEAR_DEG
    near = evolution.seconds[close & (evolution.violation <= FEASIBLE)].tolist()
    end = float(evolution.seconds[-1])
    over_evolution = seconds / (near[0] if near else end)
    bound = "" if near else ", which it did not reach: an upper bound"
    out.values(near_deg=NEAR_DEG, bound=bound)
    out.metrics(
        ahead_of_evolution_deg=least - then if feasible[0] else math.nan,
        time_over_evolution=over_evolution if feasible[0] else math.nan,
    )
    errors = np.where(feasible, np.maximum(gap_deg, 1e-6), np.nan)
    shown = runs | {"gap_deg": gap_deg, "error": errors}
    out.table("solvers", shown)
    names = {"seconds": "run time without compiling (s)", "least_deg": "least angle (°)"}
    drawn = shown.where(feasible)
    drawing = lines(drawn, "seconds", "least_deg", by="method", log="x", names=names, height=3.8)
    out.figure("run_time", drawing, most=2)
    reached = f"did not come within {NEAR_DEG:g}° of that in {end:.1f} s"
    if near:
        reached = f"came within {NEAR_DEG:g}° of that after {near[0]:.2f} s"
    evidence = (
        f"{least:.2f}° after {seconds:.2f} s ({runs['setting'][0]}, "
        "ranking of the Sobol points included, compiling not); differential evolution "
        f"{reached}; at {seconds:.2f} s it was at {then:.2f}°."
    )
    holds = bool(feasible[0] and then <= least and (not near or seconds <= near[0] / 5))
    out.precision(
        single_runs(shown, PANEL, "error"),
        "gap to the best (°)",
        "the largest least angle that any solver reached with all requirements met, each judged "
        "outside of its solver (gaps below 1e-6 count as that)",
        out.claim("derivatives", [evidence], holds),
    )
