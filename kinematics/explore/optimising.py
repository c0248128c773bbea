"""Lengths that transmit best: the least transmission angle of a whole range, maximised."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from designopt.optimize import Evaluation, Iteration, Problem, make_epigraph
from designopt.optimize.problem import EpigraphVariables
from kinematics.explore.survey import SweepEvaluator
from kinematics.explore.working_range import WorkingRange
from kinematics.solve.poses import solve_poses
from kinematics.solve.transmission import solve_transmission

LEAST_MARGIN = 1e-3
"""Of every pose, as a part of the linkage's size."""

LEAST_SLACK = 1e-3
"""Of every triangle; see `Dimensions.slack`."""

ANGLE, MARGIN = 0.3, 0.1
"""Rad, and sizes of the linkage, that matter as much as a knob's whole range."""

GAIN, PATIENCE = 0.02, 12
"""Degrees that all of so many iterations together have to gain for the search to go on."""

UPDATES = 60
"""Cap on iterations."""


class LocalOptimizer:
    """Improves a linkage from any start within its knobs' ranges, by programs compiled once."""

    def __init__(
        self,
        surveyor: SweepEvaluator,
        distances: np.ndarray,
        working: WorkingRange,
        ranges: Mapping[int, tuple[float, float]],
    ) -> None:
        """Nothing is compiled yet.

        Args:
            surveyor: of the linkage; it has transmission angles.
            distances: of a design that works, mm.
            working: over what it is improved.
            ranges: least and greatest values of the distances that may change, by their number,
                mm.
        """
        self._working = working
        self._numbers = numbers = np.array(sorted(ranges))
        size = float(surveyor.shaped(distances).size())

        def computed(free: Any, cases: Any, fixed: Any) -> Any:
            values = fixed.at[numbers].set(free)
            linkage = surveyor.dimensions.linkage(surveyor.linkage, values)
            angles = solve_transmission(linkage, cases).angles
            return solve_poses(linkage, cases), angles, surveyor.dimensions.slack(values)

        def terms(free: Any, cases: Any, fixed: Any) -> Evaluation:
            poses, angles, slack = computed(free, cases, fixed)
            return Evaluation(
                least={f"angle at {pin}": angle for pin, angle in angles.items()},
                inequalities={
                    "margin": (poses.margin / size - LEAST_MARGIN) / MARGIN,
                    "triangles": slack - LEAST_SLACK,
                },
            )

        def least(free: Any, cases: Any, fixed: Any) -> tuple[Array, Array]:
            poses, angles, slack = computed(free, cases, fixed)
            lowest = jnp.min(jnp.stack([jnp.min(angle) for angle in angles.values()]))
            return lowest, jnp.all(poses.ok) & jnp.all(slack > 0)

        self._least = jax.jit(least)
        lower, upper = (jnp.asarray([ranges[n][side] for n in numbers]) for side in (0, 1))
        inputs = surveyor.linkage.reference.inputs
        cases = jnp.zeros((working.count, len(inputs)), inputs.dtype)
        problem = Problem(terms, lower, upper, data=(cases, jnp.asarray(distances, float)))
        self._iteration = Iteration(make_epigraph(problem, scale=ANGLE))

    def steps(self, distances: np.ndarray, inputs: np.ndarray) -> Iterator[tuple[np.ndarray, str]]:
        """Distances with ever larger least transmission angles, each with what it reached.

        What is told is always a design's angle over the range in which that design works. A search
        keeps to the range of the design that it starts from: in all of it every pose stays
        assembled, in one assembly. Where that has widened the range, another search follows.

        Args:
            distances: where to start, mm.
            inputs: of a pose in the range, rad or mm.

        Raises:
            UserError: the linkage has no pose at the start.
        """
        cases = self._working.cases(distances, inputs)
        first = self._working.least(distances, inputs) or 0.0
        best, reached, number, why = distances, first, 0, ""
        while number < UPDATES:
            why = f"stopped after {UPDATES} iterations; press again to go on"
            data = jnp.asarray(cases), jnp.asarray(distances, float)
            start, before = jnp.asarray(best[self._numbers], float), reached
            level = self._least(start, *data)[0]
            reaches = [math.degrees(float(level))]
            solve = self._iteration.run(
                EpigraphVariables(start, level), data, updates=UPDATES - number
            )
            for one in solve:
                number += 1
                free = one.parameters.design
                angle, works = self._least(free, *data)
                changed = distances.copy()
                changed[self._numbers] = np.asarray(free)
                found = self._working.least(changed, inputs) if bool(works) else None
                if found is not None and found > reached:
                    best, reached = changed, found
                reaches.append(max(reaches[-1], math.degrees(float(angle)) if bool(works) else 0.0))
                said = "not all poses assemble" if found is None else _told(found)
                yield changed, f"iteration {number}: {said}"
                if one.converged:
                    why = "nothing near is better"
                elif len(reaches) > PATIENCE and reaches[-1] < reaches[-1 - PATIENCE] + GAIN:
                    why = f"the last {PATIENCE} iterations gained less than {GAIN:g}°"
                else:
                    continue
                break
            again = self._working.cases(best, inputs)
            if reached < before + GAIN or np.allclose(again, cases):
                break
            cases = again
        if reached < first + GAIN:
            yield distances, f"no better lengths found within the knobs: {_told(first)}; {why}"
        else:
            yield best, f"{_told(reached)} instead of {first:.1f}°; {why}"


def _told(degrees: float) -> str:
    return f"least transmission angle {degrees:.1f}°"
