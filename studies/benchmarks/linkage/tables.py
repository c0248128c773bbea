"""The study's tables."""

from __future__ import annotations

from designopt.study.results import Table
from studies.benchmarks.linkage.measuring import Measurements


def tables(found: Measurements) -> list[Table]:
    """Every table of the study but those that the report makes itself."""
    return [every_row(found), ratios(found), first_calls(found)]


def every_row(found: Measurements) -> Table:
    """All that was timed, short sweeps and float32 as well."""
    return Table(
        "all_rows",
        "Every method at every setting on every sweep",
        [
            "linkage",
            "poses",
            "dtype",
            "asked",
            "method",
            "setting",
            "error",
            "seconds",
            "seconds_low",
            "seconds_high",
            "compile_seconds",
        ],
        [
            (
                work.case.name,
                work.poses,
                work.dtype,
                "gradient" if work.gradient else "poses",
                row.method,
                row.setting,
                row.error,
                row.seconds,
                row.seconds_low,
                row.seconds_high,
                row.compile_seconds,
            )
            for work, row in found.rows
        ],
    )


def ratios(found: Measurements) -> Table:
    """Run times over those of the closed form, each pair timed in turn."""
    rows = [(case, method, "poses", *ratio) for (case, method), ratio in found.rivals.items()]
    rows += [
        (case, "closed form, value and gradient", "gradient", *ratio)
        for case, ratio in found.gradients.items()
    ]
    return Table(
        "ratios",
        "Run time over that of the closed form on the longest sweep (for the gradient: over that "
        "of the value alone), timed in turn: median and range over the rounds",
        ["linkage", "method", "asked", "ratio", "ratio_low", "ratio_high"],
        rows,
    )


def first_calls(found: Measurements) -> Table:
    """The first call of each fresh process."""
    return Table(
        "first_calls",
        "First compiled call in a fresh process: tracing, compiling and solving 361 poses",
        ["linkage", "process", "seconds"],
        [
            (name, number, seconds)
            for name, calls in found.first_calls.items()
            for number, seconds in enumerate(calls, start=1)
        ],
        {"seconds": 2},
    )
