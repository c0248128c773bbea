"""What the benchmarks share: rows of timed methods, ratios, fresh processes, errors."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import Any

import jax
import numpy as np

from designopt.study.benchmark import BenchmarkMethod, Ratio, benchmark, one_core
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import PrecisionRow

COLUMNS = [field.name for field in fields(PrecisionRow) if field.name != "samples"]
FRESH_PROCESSES = 3


def measure(methods: Iterable[BenchmarkMethod], repeats: int, **workload: Any) -> Records:
    """A row for each method, with the workload's columns; ``row`` is its `PrecisionRow`."""
    rows = benchmark(list(methods), repeats=repeats)
    columns = {name: [getattr(row, name) for row in rows] for name in COLUMNS}
    return Records({**workload, **columns, "row": np.array(rows, object)})


def ratio(row: PrecisionRow, base: PrecisionRow) -> dict[str, float]:
    """Columns of the run time of ``row`` over that of ``base``: median and range of the rounds."""
    value, low, high = Ratio.of(row, base)
    return {"ratio": value, "ratio_low": low, "ratio_high": high}


def spans(ratios: Records, name: str) -> list[str]:
    """Each ratio with its range, after the column that names it: the evidence of a claim."""
    columns = [ratios[column] for column in (name, "ratio", "ratio_low", "ratio_high")]
    rows = zip(*columns, strict=True)
    return [f"{who}: {value:.3g} times ({low:.3g} to {high:.3g})" for who, value, low, high in rows]


def keep_closest(rows: Sequence[PrecisionRow], method: str) -> list[PrecisionRow]:
    """A method's row of least error on a workload, then all rows of the others."""
    closest = min((row for row in rows if row.method == method), key=lambda row: row.error)
    return [closest, *(row for row in rows if row.method != method)]


def gradient_error(expected: np.ndarray, weights: np.ndarray, found: Any) -> float:
    """Deviation of a gradient's worst entry over the largest expected entry.

    Args:
        expected: the entries, in the order of the gradient's leaves.
        weights: what an entry counts.
        found: the gradient, a pytree.
    """
    entries = np.concatenate([np.ravel(part) for part in jax.tree.leaves(found)]).astype(float)
    off = np.abs(entries - expected) * weights
    return float(np.max(off) / np.max(np.abs(expected) * weights))


def installed(package: str) -> bool:
    """Whether a package can be imported; the extra ``peers`` brings those of the benchmarks."""
    return importlib.util.find_spec(package) is not None


def in_fresh_processes(prepare: str, timed: str) -> list[float]:
    """Seconds of the statements ``timed``, after those of ``prepare``, in each of some processes.

    Starting Python and what ``prepare`` does is not counted, and compiled programs that were kept
    on disk are not used.
    """
    program = (
        f"import time, jax\njax.config.update('jax_enable_x64', True)\n{prepare}\n"
        f"start = time.perf_counter()\n{timed}\nprint(time.perf_counter() - start)"
    )
    command = [sys.executable, "-P", "-c", program]  # nothing from the current folder
    environment = os.environ | {"JAX_ENABLE_COMPILATION_CACHE": "false"}

    def seconds() -> float:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return float(done.stdout)

    return [seconds() for _ in range(FRESH_PROCESSES)]


def say_cores(out: Report) -> None:
    """The finding on which cores run times were taken."""
    with one_core() as pinned:
        out.say("one-core" if pinned else "any-core")


def key(words: str) -> str:
    """Words as a part of a metric's name."""
    return re.sub(r"\W+", "_", words)


def listed(parts: Sequence[str]) -> str:
    """Parts of a sentence, the last one after an ``and``."""
    return " and ".join(filter(None, (", ".join(parts[:-1]), parts[-1])))
