"""Lengths that transmit best: the least transmission angle of a whole range, maximised."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.optimising import Iteration, Problem, Terms, epigraph
from designopt.optimising.problem import Levelled
from kinematics.bench_survey import Surveyor
from kinematics.poses import solve_poses
from kinematics.transmission import solve_transmission

ALONG_ONE, ALONG_EACH = 73, 11
"""Samples of the range of one input, and of each of several."""

INSIDE = 0.02
"""How far from a limit the outermost samples stay, as a part of the range: at the limit itself no
lengths transmit anything."""

LEAST_MARGIN = 1e-3
"""Of every pose, as a part of the linkage's size."""

LEAST_SLACK = 1e-3
"""Of every triangle; see `Dimensions.slack`."""

ANGLE, MARGIN = 0.3, 0.1
"""Rad, and sizes of the linkage, that matter as much as a knob's whole range."""

GAIN = 1e-3
"""Degrees by which a step has to be better to be one."""


class Improver:
    """Improves a linkage from any start within its knobs' ranges, by programs compiled once."""

    def __init__(
        self,
        surveyor: Surveyor,
        distances: np.ndarray,
        spans: Sequence[tuple[float, float]],
        ranges: Mapping[int, tuple[float, float]],
    ) -> None:
        """Nothing is compiled yet.

        Args:
            surveyor: of the linkage; it has transmission angles.
            distances: of a design that works, mm.
            spans: of the inputs, rad or mm.
            ranges: least and greatest values of the distances that may change, by their number,
                mm.
        """
        self._surveyor, self._spans = surveyor, spans
        self._numbers = numbers = np.array(sorted(ranges))
        size = float(surveyor.shaped(distances).size())

        def computed(free: Any, cases: Any, fixed: Any) -> Any:
            values = fixed.at[numbers].set(free)
            linkage = surveyor.dimensions.linkage(surveyor.linkage, values)
            angles = solve_transmission(linkage, cases).angles
            return solve_poses(linkage, cases), angles, surveyor.dimensions.slack(values)

        def terms(free: Any, cases: Any, fixed: Any) -> Terms:
            poses, angles, slack = computed(free, cases, fixed)
            return Terms(
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
        inputs = surveyor.linkage.home.inputs
        cases = jnp.zeros((_count(spans), len(spans)), inputs.dtype)
        problem = Problem(terms, lower, upper, data=(cases, jnp.asarray(distances, float)))
        self._iteration = Iteration(epigraph(problem, scale=ANGLE))

    def steps(self, distances: np.ndarray, inputs: np.ndarray) -> Iterator[tuple[np.ndarray, str]]:
        """Distances with ever larger least transmission angles, each with what it reached.

        The range is that in which the first design works: of one input up to its limits, of
        several where on a grid there are poses. In all of it every pose stays assembled, in one
        assembly.

        Args:
            distances: where to start, mm.
            inputs: of a pose in the range, rad or mm.

        Raises:
            UserError: the linkage has no pose at the start.
        """
        data = (
            jnp.asarray(_cases(self._surveyor, distances, inputs, self._spans)),
            jnp.asarray(distances, float),
        )

        def of(free: Float[Array, " free"]) -> np.ndarray:
            changed = distances.copy()
            changed[self._numbers] = np.asarray(free)
            return changed

        start = jnp.asarray(distances[self._numbers], float)
        lowest = self._least(start, *data)[0]
        first = math.degrees(float(lowest))
        best, reached, end = start, first, ""
        solve = self._iteration.run(Levelled(start, lowest), data)
        for number, one in enumerate(solve, start=1):
            free = one.parameters.design
            angle, works = self._least(free, *data)
            found = math.degrees(float(angle))
            if bool(works) and found > reached + GAIN:
                best, reached = free, found
            said = _told(found) if bool(works) else "not all poses assemble"
            yield of(free), f"iteration {number}: {said}"
            if one.done and not one.converged:
                end = f"; not converged after {number} iterations"
        if best is start:
            said = f"no better lengths found within the knobs: {_told(first)}"
        else:
            said = f"{_told(reached)} instead of {first:.1f}°"
        yield of(best), said + end


def _told(degrees: float) -> str:
    return f"least transmission angle {degrees:.1f}°"


def _count(spans: Sequence[tuple[float, float]]) -> int:
    """Of the cases."""
    return ALONG_ONE if len(spans) == 1 else ALONG_EACH ** len(spans)


def _cases(
    surveyor: Surveyor,
    distances: np.ndarray,
    inputs: np.ndarray,
    spans: Sequence[tuple[float, float]],
) -> Float[np.ndarray, "cases inputs"]:
    """Inputs over the range in which a design works."""
    if len(spans) == 1:
        return _range(surveyor, distances, inputs, spans[0])[:, None]
    grids = [_inset(low, high, ALONG_EACH) for low, high in spans]
    every = np.array(list(itertools.product(*grids)))
    poses = jax.jit(solve_poses)(surveyor.shaped(distances), jnp.asarray(every))
    good = np.asarray(poses.ok) & (np.asarray(poses.margin) > 0)
    if not np.any(good):
        raise UserError("no pose of this design assembles: change lengths until one does")
    # As many for every design, so that one program serves them all.
    return np.where(good[:, None], every, every[np.argmax(good)])


def _range(
    surveyor: Surveyor, distances: np.ndarray, inputs: np.ndarray, span: tuple[float, float]
) -> np.ndarray:
    """Samples of the range that the pose is in, or of the first one there is."""
    survey = surveyor.survey(distances, inputs, 0, span)
    edges = [span[0], *(edge.value for edge in survey.edges), span[1]]
    starts = survey.sweep_ok[0]
    ranges = [
        pair
        for number, pair in enumerate(itertools.pairwise(edges))
        if (number % 2 == 0) == bool(starts)
    ]
    if not ranges:
        raise UserError(
            f"no {survey.swept.name} in its range gives a pose: change lengths until one does"
        )
    around = [
        (low, high) for low, high in ranges if min(low, high) <= survey.here <= max(low, high)
    ]
    low, high = (around or ranges)[0]
    if survey.edges:
        return _inset(low, high, ALONG_ONE)
    return np.linspace(low, high, ALONG_ONE)


def _inset(low: float, high: float, count: int) -> np.ndarray:
    inset = INSIDE * (high - low)
    return np.linspace(low + inset, high - inset, count)
