"""Timing: every contender by itself, and those that are set against each other in turn."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from typing import NamedTuple

import jax

from designopt.study.benchmark import Ratio, benchmark, one_core
from designopt.study.results import PrecisionRow
from designopt.study.study import Context
from studies.benchmarks.linkage.cases import CASES, GALLERY
from studies.benchmarks.linkage.contenders import (
    FLOOR,
    FSOLVE,
    MECHANISM,
    OURS,
    PYLINKAGE_FAST,
    VALUE,
    Workload,
    contenders,
)
from studies.benchmarks.linkage.spec import LinkagePrecisionSpec

SHORT_SWEEPS = (1, 360, 10_000)
"""Sweeps beside the longest one."""

RIVALS = (MECHANISM, FSOLVE, PYLINKAGE_FAST, FLOOR)
"""Methods that are timed in turn with the closed form on the longest sweep."""

FRESH_PROCESSES = 3
FIRST_CALL_POSES = 361
FIRST_CALLS = {"four-bar": "0, 360", "finger": "0, -90"}
"""Files of the gallery whose first call is timed, and the range of each of their inputs."""


class Measured(NamedTuple):
    """One row and the workload it is of."""

    work: Workload
    row: PrecisionRow


class Measurements(NamedTuple):
    """Everything that was timed.

    Attributes:
        rows: every method at every setting on every workload.
        rivals: by linkage and method, its run time over the closed form's, longest sweep.
        gradients: by linkage, the run time of value and gradient over that of the value alone.
        first_calls: by file of the gallery, seconds in each of the fresh processes.
        pinned: of each workload, whether it ran on one core.
    """

    rows: list[Measured]
    rivals: dict[tuple[str, str], Ratio]
    gradients: dict[str, Ratio]
    first_calls: dict[str, list[float]]
    pinned: list[bool]


def measure_all(spec: LinkagePrecisionSpec, context: Context) -> Measurements:
    """Time everything the spec asks for, on one core; only what is not timed uses all of them."""
    found = Measurements([], {}, {}, {}, [])
    for work in workloads(spec):
        with context.step(work.panel), jax.enable_x64(work.dtype == "float64"):
            entered = list(contenders(work, peers=spec.peers, optimistix=spec.optimistix))
            with one_core() as pinned:
                rows = benchmark(entered, repeats=spec.repeats)
            found.rows.extend(Measured(work, row) for row in rows)
            if work.dtype == "float64" and work.every:
                _compare_times(work, rows, found)
            found.pinned.append(pinned)
    if spec.first_call:
        for name in FIRST_CALLS:
            with context.step(f"First call of {name} in fresh processes"), one_core():
                found.first_calls[name] = [first_call(name) for _ in range(FRESH_PROCESSES)]
    return found


def workloads(spec: LinkagePrecisionSpec) -> list[Workload]:
    """The sweeps that a spec asks for: all lengths for the poses, the longest for the rest."""
    works = []
    for case in (case for case in CASES if spec.linkage in ("all", case.name)):
        short = [poses for poses in SHORT_SWEEPS if poses < spec.poses]
        works += [Workload(case, poses, every=False) for poses in short]
        works.append(Workload(case, spec.poses))
        if spec.gradients:
            works.append(Workload(case, spec.poses, gradient=True))
        if spec.float32:
            works.append(Workload(case, spec.poses, "float32"))
            if spec.gradients:
                works.append(Workload(case, spec.poses, "float32", gradient=True))
    return works


def first_call(name: str) -> float:
    """Seconds of the first compiled call of a gallery file's poses in a fresh process.

    Tracing, compiling and solving count; starting Python, importing and reading the file do not.
    """
    program = f"""
import time
import jax
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
from kinematics import read_linkage, solve_poses
linkage = read_linkage({str(GALLERY / (name + ".toml"))!r})
sweep = jnp.deg2rad(jnp.linspace({FIRST_CALLS[name]}, {FIRST_CALL_POSES}))
inputs = jnp.stack([sweep] * len(linkage.input_names), axis=-1)
jax.block_until_ready(inputs)
start = time.perf_counter()
jax.block_until_ready(jax.jit(solve_poses)(linkage, inputs))
print(time.perf_counter() - start)
"""
    # A program that was kept on disk would not be compiled.
    environment = os.environ | {"JAX_ENABLE_COMPILATION_CACHE": "false"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    return float(done.stdout)


def _compare_times(work: Workload, rows: Sequence[PrecisionRow], found: Measurements) -> None:
    by_method = {row.method: row for row in rows}
    if work.gradient:
        found.gradients[work.case.name] = Ratio.of(by_method[OURS], by_method[VALUE])
        return
    default = [row for row in rows if row.method == FSOLVE][1]  # SciPy's own tolerance
    for method, row in (by_method | {FSOLVE: default}).items():
        if method in RIVALS:
            found.rivals[work.case.name, method] = Ratio.of(row, by_method[OURS])
