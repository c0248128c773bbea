"""Solvers beside each other: their table, and what each reached over run time."""

from __future__ import annotations

import numpy as np

from designopt.optimize import FEASIBLE
from designopt.plot.figures import MARKERS, PALETTE, legend_below, new_figure
from designopt.study.results import Figure, Table
from studies.finger_linkage.comparing import EVOLUTION, Comparison


def figure(found: Comparison) -> Figure:
    """Least angle over run time: the yardstick's way, and where every solver ended."""
    drawing, axes = new_figure(1, 1, height=3.8)
    axis = axes[0, 0]
    evolution = found.evolution
    angles = np.where(evolution.violation <= FEASIBLE, -np.rad2deg(evolution.objective), np.nan)
    axis.plot(evolution.seconds, angles, color="0.4", label=EVOLUTION)
    others = [run for run in found.runs if run.method != EVOLUTION and run.feasible]
    for number, run in enumerate(others):
        axis.plot(
            run.seconds,
            run.least_deg,
            MARKERS[number % len(MARKERS)],
            color=PALETTE[number % len(PALETTE)],
            markersize=7,
            label=f"{run.method}, {run.setting}",
        )
    axis.set(xscale="log", xlabel="run time without compiling (s)")
    axis.set(ylabel="least transmission angle (°)")
    legend_below(drawing, most=2, fontsize=7)
    return Figure(
        "run_time",
        "Least transmission angle over run time",
        "On the search's coarse postures. A solver that met not all requirements is not drawn; the "
        "table of run times has it.",
        drawing,
    )


def table(found: Comparison) -> Table:
    """Every solver's gap and violation beside its run time."""
    rows = [
        (
            run.method,
            run.setting,
            run.least_deg,
            found.best_deg - run.least_deg,
            run.violation,
            run.seconds,
            run.compile_seconds,
        )
        for run in found.runs
    ]
    columns = [
        "method",
        "setting",
        "least_deg",
        "gap_deg",
        "violation",
        "seconds",
        "compile_seconds",
    ]
    return Table("solvers", "Gap and violation against run time", columns, rows)
