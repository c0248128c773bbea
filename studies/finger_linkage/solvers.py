"""Every solver on the coarse problem of the search, and differential evolution as the yardstick."""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from designopt.optimize import (
    FEASIBLE,
    Evolution,
    Method,
    Optima,
    make_epigraph_starts,
    run_differential_evolution,
)
from designopt.plot.figures import MARKERS, PALETTE, new_figure
from designopt.study.records import Records
from designopt.study.report import Report
from studies.models.linkage_design.problem import grid
from studies.models.linkage_design.searching import Search, least_angles_deg, minimizer, over
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


class Comparison(NamedTuple):
    """Every solver on the problem of the search's first round.

    Attributes:
        runs: columns ``method``, ``setting``, ``least_deg``, ``violation``, ``seconds`` without
            compiling and ``compile_seconds``; the study's own solve first.
        evolution: how differential evolution went.
    """

    runs: Records
    evolution: Evolution

    @property
    def feasible(self) -> Bool[np.ndarray, " runs"]:
        """Which runs meet the requirements."""
        return (self.runs["violation"] <= FEASIBLE) & np.isfinite(self.runs["least_deg"])

    @property
    def gap_deg(self) -> Float[np.ndarray, " runs"]:
        """By how much each least angle is below the best of a run that meets the requirements."""
        least = self.runs["least_deg"]
        return max(least[self.feasible].tolist(), default=math.nan) - least

    @property
    def own(self) -> tuple[float, float]:
        """Least angle (degrees) and run time (s) of the study's solve; NaN if it is infeasible."""
        found = self.runs["least_deg"][0], self.runs["seconds"][0]
        return found if self.feasible[0] else (np.nan, np.nan)

    @property
    def near(self) -> float | None:
        """Seconds after which evolution is within `NEAR_DEG` of it; ``None`` if never."""
        angles = -np.rad2deg(self.evolution.objective)
        near = (angles >= self.runs["least_deg"][0] - NEAR_DEG) & _met(self.evolution)
        return float(self.evolution.seconds[np.argmax(near)]) if near.any() else None


def _met(evolution: Evolution) -> Bool[np.ndarray, " generations"]:
    return evolution.violation <= FEASIBLE


def evolution_at(evolution: Evolution, seconds: float) -> float:
    """Least angle that differential evolution has reached by then, degrees; 0 if none."""
    done = (evolution.seconds <= seconds) & _met(evolution)
    return float(np.max(-np.rad2deg(evolution.objective[done]), initial=0.0))


def compare(spec: FingerLinkageSpec, found: Search, seed: int) -> Comparison:
    """All solvers on the problem of the search's first round, from its starts."""
    flexion = grid(found.finger.body, spec.search.step_deg)
    problem = over(found.finger, spec, flexion, flexion)
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
    others: list[tuple[Method, int]] = [
        (m, n) for m, (_, counts) in METHODS.items() for n in counts
    ]
    for method, count in others:
        if count <= spec.search.starts and (method, count) != ("bfgs", spec.search.starts):
            own = jax.tree.map(lambda leaf, n=count: leaf[:n], every)
            add(method, count, minimizer(problem, count, method).solve(own))
    evolution = run_differential_evolution(problem, seconds=spec.evolution_seconds, seed=seed)
    for share in SHARES:
        until = share * spec.evolution_seconds
        least = evolution_at(evolution, until * (1 + 1e-9) if share < 1 else np.inf)
        runs.add(
            method=EVOLUTION,
            setting=f"{until:.3g} s",
            least_deg=least,
            violation=0.0 if least else 1.0,
            seconds=until,
            compile_seconds=0.0,
        )
    return Comparison(runs, evolution)


def add_comparison(out: Report, compared: Comparison) -> None:
    """Its metrics, table, figure and claim."""
    runs, evolution, near = compared.runs, compared.evolution, compared.near
    (least, seconds), end = compared.own, float(evolution.seconds[-1])
    then = evolution_at(evolution, runs["seconds"][0])
    bound = "" if near is not None else ", which it did not reach: an upper bound"
    out.values(near_deg=NEAR_DEG, bound=bound)
    over_evolution = seconds / (end if near is None else near)
    out.metrics(ahead_of_evolution_deg=least - then, time_over_evolution=over_evolution)
    errors = np.where(compared.feasible, np.maximum(compared.gap_deg, 1e-6), np.nan)
    shown = runs | {"gap_deg": compared.gap_deg, "error": errors}
    out.table("solvers", shown)
    out.figure("run_time", draw_run_times(compared), most=2)
    reached = f"did not come within {NEAR_DEG:g}° of that in {end:.1f} s"
    if near is not None:
        reached = f"came within {NEAR_DEG:g}° of that after {near:.2f} s"
    evidence = (
        f"{runs['least_deg'][0]:.2f}° after {runs['seconds'][0]:.2f} s ({runs['setting'][0]}, "
        "ranking of the Sobol points included, compiling not); differential evolution "
        f"{reached}; at {runs['seconds'][0]:.2f} s it was at {then:.2f}°."
    )
    holds = bool(then <= least and (near is None or seconds <= near / 5))
    out.precision(
        single_runs(shown, PANEL, "error"),
        "gap to the best (°)",
        "the largest least angle that any solver reached with all requirements met, each judged "
        "outside of its solver (gaps below 1e-6 count as that)",
        out.claim("derivatives", [evidence], holds),
    )


def draw_run_times(compared: Comparison) -> Figure:
    """Least angle over run time: the yardstick's way, and where every solver ended."""
    drawing, [[axis]] = new_figure(1, 1, height=3.8)
    evolution, runs = compared.evolution, compared.runs.where(compared.feasible)
    angles = np.where(_met(evolution), -np.rad2deg(evolution.objective), np.nan)
    axis.plot(evolution.seconds, angles, color="0.4", label=EVOLUTION)
    others = runs.where(runs["method"] != EVOLUTION)
    for number, (name, own) in enumerate(others.group("method", "setting").items()):
        style = {"marker": MARKERS[number % len(MARKERS)], "color": PALETTE[number % len(PALETTE)]}
        axis.plot(own["seconds"], own["least_deg"], linestyle="", markersize=7,
                  label=", ".join(name), **style)  # fmt: skip
    axis.set(xscale="log", xlabel="run time without compiling (s)")
    axis.set(ylabel="least transmission angle (°)")
    return drawing
