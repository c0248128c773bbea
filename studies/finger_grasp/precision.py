"""Error against run time: the complementarity equations beside minimisers of the same energy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from designopt.study.benchmark import BenchmarkMethod, compile_timed, find_dominating
from designopt.study.results import Claim, PrecisionRow
from studies.finger_grasp.judging import reference
from studies.finger_grasp.second_opinion import minimum
from studies.finger_grasp.second_opinion import reference as slsqp
from studies.models.grasp.closing import Path
from studies.models.grasp.conditions import Problem, Unknowns
from studies.models.grasp.equilibrium import solve
from studies.models.grasp.transfer import Joints

TOLERANCES = (1e-2, 1e-5, 1e-8, 1e-15)
PROGRAMS = (3, 6, 12, 24)
"""Quadratic programs in a row, the setting of the sequential method."""

STATES = tuple(range(4, 81, 5))
"""States of the check's closing that are solved anew, each from the one 2° of the motor before."""

OURS = "complementarity, Newton"


def contenders(path: Path) -> Iterator[BenchmarkMethod]:
    """Every method at every setting on the states of one closing.

    Args:
        path: the closing on the check's circle.
    """
    # What is undetermined, or was not found, is no reference.
    references = {state: reference(path, state) for state in STATES if path.ok[state]}
    found = {state: one for state, one in references.items() if one is not None and one.right}
    if not found:
        return
    commands = jnp.asarray(path.commands[list(found)])
    before = [state - 1 for state in found]
    near = jnp.asarray(path.joints[before])
    unit = path.problem.moment_unit
    guesses = Unknowns(
        near,
        jnp.asarray(path.motor[before]) / unit,
        jnp.asarray(path.forces[before]) * path.problem.length_unit / unit,
    )
    exact = np.array([[float(q) for q in one.joints] for one in found.values()])
    panel = f"{len(found)} states of the check's closing"
    error = partial(_worst, exact)

    def at(command: jax.Array) -> Problem:
        return eqx.tree_at(lambda p: p.command, path.problem, command)

    def ours(command: jax.Array, guess: Unknowns, tolerance: jax.Array) -> Joints:
        return solve(at(command), guess, tolerance=tolerance).value.joints

    def theirs(opinion: Any, command: jax.Array, joints: Joints, setting: jax.Array) -> Joints:
        if opinion == "jaxopt QP":
            tight = jnp.asarray(1e-12, joints.dtype)
            return minimum(at(command), joints, opinion=opinion, tolerance=tight, steps=setting)
        return minimum(at(command), joints, opinion=opinion, tolerance=setting)

    for name, function, start, settings, word in (
        (OURS, ours, guesses, TOLERANCES, "tolerance"),
        ("jaxopt QP, sequential", partial(theirs, "jaxopt QP"), near, PROGRAMS, "programs"),
        ("jaxopt LBFGSB, augmented", partial(theirs, "jaxopt box"), near, TOLERANCES, "tolerance"),
    ):
        values = [jnp.asarray(setting) for setting in settings]
        compiled, seconds = compile_timed(
            jax.vmap(function, (0, 0, None)), commands, start, values[0]
        )
        for setting, value in zip(settings, values, strict=True):
            call = partial(compiled, commands, start, value)
            yield BenchmarkMethod(name, f"{word} {setting:g}", panel, call, error, seconds)
    for tolerance in (1e-4, 1e-8, 1e-15):
        call = partial(_one_by_one, [at(command) for command in commands], near, tolerance)
        yield BenchmarkMethod("SciPy SLSQP", f"tolerance {tolerance:g}", panel, call, error)


def claim(rows: Sequence[PrecisionRow]) -> Claim:
    """What the study says of the solvers."""
    mine = min((row for row in rows if row.method == OURS), key=lambda row: row.error)
    others = [row for row in rows if row.method != OURS]
    beaten = find_dominating(mine, others)
    evidence = [f"{OURS}, {mine.setting}: {mine.seconds:.2g} s, error {mine.error:.1e} rad"]
    for method in dict.fromkeys(row.method for row in others):
        best = min((row for row in others if row.method == method), key=lambda row: row.error)
        evidence.append(
            f"{method}, at its best setting ({best.setting}): {best.seconds / mine.seconds:.3g} "
            f"times its time, error {best.error:.1e} rad"
        )
    return Claim(
        "No minimiser of the same energy, at any setting, is both faster and closer than Newton's "
        "iteration on the complementarity equations.",
        "Stops, contacts and the motor are all equations, so that one solve of five unknowns "
        "moves everything at once and the last steps double the digits; a minimiser sees the "
        "energy only, which is flat at its minimum, and iterates within its iterations.",
        evidence,
        not beaten,
    )


def _one_by_one(problems: list[Problem], near: jax.Array, tolerance: float) -> np.ndarray:
    guesses = np.asarray(near)
    return np.array(
        [slsqp(problem, guess, tolerance) for problem, guess in zip(problems, guesses, strict=True)]
    )


def _worst(exact: np.ndarray, found: Any) -> float:
    return float(np.max(np.abs(np.asarray(found) - exact)))
