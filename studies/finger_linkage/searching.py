"""The search: many starts on few postures, the best of them again with the worst in between."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from designopt.optimising import (
    Active,
    Minimiser,
    Optima,
    Optimum,
    Parameters,
    Problem,
    active_set,
    best_starts,
    conflict,
    epigraph,
    level_starts,
)
from studies.finger_linkage.pins import Pins
from studies.finger_linkage.problem import ANGLE, grid, linkage_problem
from studies.finger_linkage.spec import FingerLinkageSpec

FLOOR = -math.pi / 2 / ANGLE
"""No transmission angle exceeds a right angle, so no scaled objective falls below this."""

UPDATES, STEPS = 15, 40


CHECK_STEP_DEG = 1.0
"""Step of the square on which a design is judged, degrees."""

WORSE = math.radians(1e-3)
"""A posture in between counts if an angle is smaller there by more than this, rad."""


@dataclass(frozen=True)
class Round:
    """One solve from several designs.

    Attributes:
        problem: over its postures, with ``least``.
        pip: PIP angles of its postures, rad.
        dip: DIP angles, rad.
        ranking_seconds: time to rank the Sobol points, where that came before.
        optima: where every design led to, in the problem's epigraph form.
    """

    problem: Problem
    pip: np.ndarray
    dip: np.ndarray
    ranking_seconds: float
    optima: Optima


@dataclass(frozen=True)
class Search:
    """What was found, and how.

    Attributes:
        pins: the design, rounded to what can be built.
        rounds: the solves; the first from Sobol points, the others from the best before.
    """

    pins: Pins
    rounds: tuple[Round, ...]

    @property
    def best(self) -> Optimum:
        """The optimum that became the design."""
        return self.rounds[-1].optima.best

    @property
    def seconds(self) -> float:
        """Run time of the search, without compiling."""
        return sum(one.ranking_seconds + one.optima.seconds for one in self.rounds)

    @property
    def compile_seconds(self) -> float:
        """Time to compile the solves."""
        return sum(one.optima.compile_seconds for one in self.rounds)

    def held_by(self) -> list[Active]:
        """The requirements that hold the optimum."""
        return active_set(epigraph(self.rounds[-1].problem, scale=ANGLE), self.best)

    def conflict(self) -> list[str]:
        """The requirements that could not be met together, with amounts; empty if all were."""
        return conflict(epigraph(self.rounds[-1].problem, scale=ANGLE), self.best)


def search(spec: FingerLinkageSpec, seed: int) -> Search:
    """The best linkage for a spec.

    Few postures decide. The starts are solved on a coarse square; then the postures in between in
    which a finalist is worse than it promised are added, and it is solved again from where it was,
    until there are none (exchange method of semi-infinite programming: R. Hettich, K. O. Kortanek,
    SIAM Review 35, 1993).

    Args:
        spec: the study's settings.
        seed: of the Sobol points.
    """
    how, body = spec.search, spec.body
    flexion = grid(body, how.step_deg)
    coarse = linkage_problem(body, spec.limits, flexion, flexion, how.allowance)
    begin = time.perf_counter()
    starts = jax.block_until_ready(
        best_starts(coarse, how.starts, seed, among=how.among, scale=ANGLE)
    )
    rounds = [
        Round(coarse, flexion, flexion, time.perf_counter() - begin, solve_from(coarse, starts))
    ]
    worst = _worst_postures(spec)
    for _ in range(how.exchanges):
        last = rounds[-1]
        finalists = sorted(last.optima.found, key=lambda one: (not one.feasible, one.objective))
        designs = [one.parameters.design for one in finalists[: how.finalists]]
        pip, dip = last.pip, last.dip
        for one, design in zip(finalists, designs, strict=False):
            more_pip, more_dip = worst(design, float(one.parameters.level))
            pip, dip = np.union1d(pip, more_pip), np.union1d(dip, more_dip)
        if len(pip) == len(last.pip) and len(dip) == len(last.dip):
            break
        problem = linkage_problem(body, spec.limits, pip, dip, how.allowance)
        again = solve_from(problem, jax.tree.map(lambda *leaves: jnp.stack(leaves), *designs))
        rounds.append(Round(problem, pip, dip, 0.0, again))
    found = rounds[-1].optima.best.parameters.design
    return Search(rounded(found, how.rounding), tuple(rounds))


def _worst_postures(spec: FingerLinkageSpec) -> Callable[[Pins, float], tuple[Any, Any]]:
    """From a design and the level it promised to the angles of postures in which it is worse."""
    flexion = grid(spec.body, CHECK_STEP_DEG)
    check = linkage_problem(spec.body, spec.limits, flexion, flexion)
    terms = jax.jit(check.terms)

    def worst(pins: Pins, level: float) -> tuple[Any, Any]:
        found = terms(pins)
        assert found.least is not None
        short = [level - np.asarray(values) - WORSE for values in found.least.values()]
        short += [-np.asarray(values) for values in found.inequalities.values()]
        pip, dip = set(), set()
        for values in short:
            if values.ndim and np.max(values) > 0 and values.shape[-1] == len(flexion):
                place = np.unravel_index(np.argmax(values), values.shape)
                dip.add(flexion[place[-1]])
                if values.ndim > 1 and values.shape[-2] == len(flexion):
                    pip.add(flexion[place[-2]])
        return sorted(pip), sorted(dip)

    return worst


def solve_from(problem: Problem, starts: Parameters) -> Optima:
    """All starts in one vectorised run: least squares inside an augmented Lagrangian."""
    count = jax.tree.leaves(starts)[0].shape[0]
    exact = epigraph(problem, scale=ANGLE)
    minimiser = Minimiser(
        exact, count, "levenberg-marquardt", floor=FLOOR, updates=UPDATES, steps=STEPS
    )
    return minimiser.solve(level_starts(problem, starts))


def rounded(pins: Pins, step: float) -> Pins:
    """The design with every coordinate a multiple of a step, mm."""
    places = max(0, math.ceil(-math.log10(step)) + 1)
    return jax.tree.map(
        lambda leaf: jnp.asarray(np.round(np.round(np.asarray(leaf) / step) * step, places)), pins
    )
