"""The study's tables."""

from __future__ import annotations

from designopt.study.results import Table
from studies.benchmarks.visibility.measuring import Measurements
from studies.benchmarks.visibility.tracers import MIRRORS, RAYS, intersections_per_ray


def tables(found: Measurements) -> list[Table]:
    """Every table of the study but those that the report makes itself."""
    made = [rivals(found), gallery(found), grid(found), tracers(found)]
    return [table for table in made if table.rows]


def rivals(found: Measurements) -> Table:
    """The sigmoid that is as accurate as asked for, beside the exact intervals."""
    return Table(
        "rivals",
        "Run time over that of the exact intervals, timed in turn: median and range of the rounds",
        ["workload", "method", "setting", "error", "ratio", "ratio_low", "ratio_high"],
        [(row.panel, row.method, row.setting, row.error, *ratio) for row, ratio in found.rivals],
    )


def gallery(found: Measurements) -> Table:
    """Every scene of the gallery beside the reference's rays."""
    return Table(
        "gallery",
        "Worst deviation of a pad's coverage, and of the number of paths that see a point of it, "
        "from those by the reference's rays",
        ["scene", "method", "coverage_error", "redundancy_error"],
        found.deviations,
    )


def grid(found: Measurements) -> Table:
    """The finger over its grid of poses and over the two sweeps."""
    rows = [] if found.grid is None else found.grid.rows
    return Table(
        "finger_grid",
        "Paper B's finger over a grid of poses and over the sweeps of its joints",
        ["poses", "asked", "seconds", "seconds_low", "seconds_high", "compile_seconds"],
        [
            (
                f"{row.panel}: {row.setting}",
                row.method,
                row.seconds,
                row.seconds_low,
                row.seconds_high,
                row.compile_seconds,
            )
            for row in rows
        ],
    )


def tracers(found: Measurements) -> Table:
    """Every tracer: how fast, and how far its rays end from where they should."""
    return Table(
        "tracers",
        f"{RAYS:,} rays between {MIRRORS} mirrors; optiland and rayoptics are told their order",
        ["legs", "method", "setting", "error_mm", "seconds", "million_intersections_per_s"],
        [
            (
                legs,
                row.method,
                row.setting,
                row.error,
                row.seconds,
                RAYS * intersections_per_ray(row.method, legs) / row.seconds / 1e6,
            )
            for legs, row in found.traced
        ],
    )
