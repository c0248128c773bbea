"""Solvers that ran once each, as rows of error against run time."""

from __future__ import annotations

from designopt import PrecisionRow, Records


def single_runs(runs: Records, panel: str, error: str) -> list[PrecisionRow]:
    """A row for each run.

    Args:
        runs: columns ``method``, ``setting``, ``seconds``, ``compile_seconds`` and the error's.
        panel: the workload.
        error: column of the error.
    """
    columns = ("method", "setting", error, "seconds", "compile_seconds")
    return [
        PrecisionRow(method, setting, panel, off, seconds, seconds, seconds, compiling)
        for method, setting, off, seconds, compiling in zip(
            *(runs[name].tolist() for name in columns), strict=True
        )
    ]
