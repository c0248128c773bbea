"""What a point is worth, what holds it and what conflicts there, without the solver that found it.

Violations are computed anew, and multipliers from the stationarity conditions (Karush, Kuhn and
Tucker) by non-negative least squares over the constraints that are active there; what these leave
of the objective's gradient measures how far the point is from an optimum (J. Nocedal, S. J. Wright,
*Numerical Optimization*, 2nd ed., §12.3). Of an infeasible point the same is asked about half the
sum of the squared violations, between the bounds: only at a minimum of it do requirements conflict
(E. G. Birgin, J. M. Martínez, *Practical Augmented Lagrangian Methods*, 2014, ch. 6).

A multiplier is that of f + μ·h − λ·g for equalities h = 0 and inequalities g ≥ 0.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from designopt.interpreter import Interpreter
from designopt.optimize.augmented_lagrangian import Trace
from designopt.optimize.flat import Flat, Given, Point, column_slopes
from designopt.optimize.problem import BOUND, Parameters, Problem, describe_by_index
from designopt.programs import keep_interpreter
from designopt.solution import Solution

FEASIBLE = 1e-6
"""Largest scaled violation of a point that counts as feasible."""

ACTIVE = 1e-4
"""A constraint that is no farther from its limit, scaled, is a candidate for a multiplier."""

STATIONARY = 1e-2
"""Largest part of the objective's gradient that multipliers may leave at an optimum."""


class OptimumResult(eqx.Enumeration):
    """What kind of point it is."""

    successful = ""
    not_stationary = (
        "All requirements are met, but this is no optimum: more steps, another start or another "
        "solver would go further."
    )
    infeasible = (
        "The requirements could not all be met from this start: those listed with their amounts "
        "conflict; relax one of them, or try more starts."
    )
    not_met = (
        "Requirements are not met, and need not conflict: more steps, another start or another "
        "solver would go further."
    )
    no_number = "The search left the domain in which the problem has numbers: start elsewhere."


@dataclass(frozen=True)
class Optimum:
    """What one start led to.

    Attributes:
        solution: the parameters. ``margin`` is the smallest scaled inequality or distance to a
            bound (negative: the largest violation); ``residual`` what is left of the objective's
            gradient, or at an infeasible point of the squared violations' gradient, relative to
            it.
        objective: what was minimised; infinite where the problem has no numbers.
        violations: largest scaled violation by the constraint's name; 0 where it holds.
        multipliers: by the constraint's name, in its shape, per unit of its array; of bounds, in
            their order (the lower ones, then the upper ones, finite ones only), per scaled unit.
            Without meaning unless ``solution.ok``.
        history: one row per update of the multipliers; or one of the start and one per step.
        worst: index of the element that is violated most, by the name of each constraint that
            does not hold.
    """

    solution: Solution[Parameters]
    objective: float
    violations: dict[str, float]
    multipliers: dict[str, np.ndarray]
    history: Trace
    worst: dict[str, tuple[int, ...]]

    @property
    def parameters(self) -> Parameters:
        """The parameters found."""
        return self.solution.value

    @property
    def violation(self) -> float:
        """Largest scaled violation."""
        return max(self.violations.values(), default=0.0)

    @property
    def feasible(self) -> bool:
        """Whether all requirements are met, to `FEASIBLE`."""
        return math.isfinite(self.objective) and self.violation <= FEASIBLE


def make_optimality_check(flat: Flat) -> Callable[[Point, Given, Trace], Optimum]:
    """A function that judges points of a problem, given its data and bounds.

    It is called for a few optima and would compile for a minute: NumPy computes it.

    Args:
        flat: the problem.
    """

    def values_and_slopes(point: Point, given: Given) -> tuple[Any, Any]:
        now = flat.given(given)

        def parts(point: Point) -> Any:
            terms, h, g = now.evaluated(point)
            return terms.value, h, jnp.concatenate([g, now.bounds(point)])

        return column_slopes(parts, point)

    shapes = jax.eval_shape(flat.terms, jnp.asarray(flat.units))
    equalities = {name: part.shape for name, part in sorted(shapes.equalities.items())}
    inequalities = {name: part.shape for name, part in sorted(shapes.inequalities.items())}
    inequalities[BOUND] = (sum(len(part) for part in flat.limited),)

    @functools.cache
    def traced() -> Interpreter:
        point, given = jnp.asarray(flat.units), flat.own
        return keep_interpreter(values_and_slopes, point, given, name=flat.name("optimality"))

    def check(point: Point, given: Given, history: Trace) -> Optimum:
        (value, h, g), slopes = traced()(point, given)
        if not all(np.all(np.isfinite(part)) for part in (value, h, g, *slopes)):
            place = jnp.where(jnp.isfinite(point), point, 0.0)
            solution = _solution(flat, place, -1.0, 1.0, OptimumResult.no_number)
            return Optimum(solution, math.inf, {}, {}, history, {})
        mu, lam, residual = _multipliers(value, h, g, slopes)
        unmet = _named(equalities, np.abs(h)) | _named(inequalities, np.maximum(-g, 0.0))
        violations = {name: float(np.max(part)) for name, part in unmet.items()}
        at_rest, elsewhere = OptimumResult.successful, OptimumResult.not_stationary
        if max(violations.values(), default=0.0) > FEASIBLE:
            residual = _conflict(h, g, slopes, *inequalities[BOUND])
            at_rest, elsewhere = OptimumResult.infeasible, OptimumResult.not_met
        result = at_rest if residual <= STATIONARY else elsewhere
        margin = min(float(np.min(g, initial=np.inf)), -float(np.max(np.abs(h), initial=-np.inf)))
        multipliers = _named(equalities, mu) | _named(inequalities, lam)
        worst = {
            name: tuple(int(i) for i in np.unravel_index(np.argmax(part), part.shape))
            for name, part in unmet.items()
            if violations[name] > FEASIBLE
        }
        solution = _solution(flat, point, margin, residual, result)
        return Optimum(solution, float(value), violations, multipliers, history, worst)

    return check


Slopes = tuple[
    Float[np.ndarray, " parameters"],
    Float[np.ndarray, "equalities parameters"],
    Float[np.ndarray, "inequalities parameters"],
]


def _multipliers(
    value: Float[np.ndarray, ""],
    h: Float[np.ndarray, " equalities"],
    g: Float[np.ndarray, " inequalities"],
    slopes: Slopes,
) -> tuple[np.ndarray, np.ndarray, float]:
    """μ, λ, and what they leave of the objective's gradient, relative to it."""
    gradient, of_h, of_g = slopes
    candidates = np.flatnonzero(g <= ACTIVE)
    found, left = _balanced(gradient, np.concatenate([-of_h, of_h, of_g[candidates]]))
    lam = np.zeros_like(g)
    lam[candidates] = found[2 * h.size :]
    # An optimum without constraints has no gradient to compare with. Its place is known to the
    # square root of rounding, √ε; what a curvature up to ε^(−1/4) leaves there counts as none.
    least = float(np.finfo(gradient.dtype).eps) ** (1 / 4) * (1 + abs(float(value))) / STATIONARY
    size = max(float(np.linalg.norm(gradient)), least)
    return found[: h.size] - found[h.size : 2 * h.size], lam, left / size


def _conflict(
    h: Float[np.ndarray, " equalities"],
    g: Float[np.ndarray, " inequalities"],
    slopes: Slopes,
    bounds: int,
) -> float:
    """How far half the sum of squared violations is from a minimum: 0 at one, at most 1."""
    _, of_h, of_g = slopes
    kept = g.size - bounds
    parts = np.concatenate([h[:, None] * of_h, np.minimum(g, 0.0)[:kept, None] * of_g[:kept]])
    at_bound = kept + np.flatnonzero(g[kept:] <= ACTIVE)
    _, left = _balanced(np.sum(parts, axis=0), of_g[at_bound])
    # Relative to what would be left if nothing balanced; 0 of 0 where no slope shows a way out.
    return left / max(float(np.sum(np.linalg.norm(parts, axis=1))), np.finfo(float).tiny)


def _balanced(
    gradient: Float[np.ndarray, " parameters"], rows: Float[np.ndarray, "rows parameters"]
) -> tuple[np.ndarray, float]:
    """The gradient as a sum of rows, none of them negatively: how often each, and what is left."""
    if not rows.size:
        return np.zeros(len(rows)), float(np.linalg.norm(gradient))
    from scipy.optimize import nnls  # half a second, and not every search is judged

    found, left = nnls(rows.T, gradient)
    return found, float(left)


def _named(shapes: dict[str, tuple[int, ...]], flat: np.ndarray) -> dict[str, np.ndarray]:
    """The arrays that were joined, by name; those that are empty left out."""
    sizes = [int(np.prod(shape)) for shape in shapes.values()]
    parts = np.split(flat, np.cumsum(sizes)[:-1]) if sizes else []
    named = zip(shapes.items(), parts, strict=True)
    return {name: part.reshape(shape) for (name, shape), part in named if part.size}


def _solution(
    flat: Flat, point: Point, margin: float, residual: float, result: Any
) -> Solution[Parameters]:
    inside, left = jnp.asarray(margin, point.dtype), jnp.asarray(residual, point.dtype)
    return Solution(flat.parameters(point), inside, left, result)


@dataclass(frozen=True)
class Active:
    """A requirement that holds an optimum.

    Attributes:
        name: of its array.
        index: of its element there.
        words: what it is.
        unit: of its amounts.
        price: by how much the objective would fall, to first order, if one ``unit`` less were
            asked: for an inequality or a bound by one, its λ; for an equality, at +1 instead of
            0, its μ, which may be negative. In units of the objective per ``unit``.
        share: of its multiplier in the sum of all.
    """

    name: str
    index: tuple[int, ...]
    words: str
    unit: str
    price: float
    share: float


def find_active_set(problem: Problem, optimum: Optimum, least_share: float = 0.01) -> list[Active]:
    """The requirements whose multipliers are not zero, the dearest first.

    Args:
        problem: the problem that was solved.
        optimum: what was found.
        least_share: requirements with a smaller share of all multipliers are left out.

    Example:
        >>> import jax.numpy as jnp
        >>> from designopt.optimize import Evaluation, minimize
        >>> problem = Problem(
        ...     lambda x: Evaluation(objective=(x - 2) ** 2), jnp.zeros(()), jnp.ones(())
        ... )
        >>> best = minimize(problem, jnp.array([0.5]), "slsqp").best
        >>> [active.words for active in find_active_set(problem, best)]
        ['parameter at its upper bound']
    """
    total = sum(float(np.sum(np.abs(part))) for part in optimum.multipliers.values())
    found = []
    for name, values in optimum.multipliers.items():
        for index in np.argwhere(np.abs(values) > least_share * total):
            place = tuple(int(i) for i in index)
            words, unit, scale = _described(problem, name, place)
            price = float(values[place])
            found.append(Active(name, place, words, unit, price / scale, abs(price) / total))
    return sorted(found, key=lambda one: -one.share)


def explain_conflict(problem: Problem, optimum: Optimum) -> list[str]:
    """The requirements that an infeasible point fails, each with its amount, the worst first.

    Of an array with several such elements the worst one is listed. Where the point's result is
    ``infeasible``, it is at a minimum of the squared violations: their gradients balance, so that
    near it none of these requirements can be met better without another being met worse.

    Args:
        problem: the problem that was solved.
        optimum: what was found.

    Example:
        >>> import jax.numpy as jnp
        >>> from designopt.optimize import Evaluation, minimize
        >>> problem = Problem(
        ...     lambda x: Evaluation(objective=x, inequalities={"high": x - 2}),
        ...     jnp.zeros(()),
        ...     jnp.ones(()),
        ... )
        >>> explain_conflict(problem, minimize(problem, jnp.array([0.5]), "slsqp").best)
        ['high by 1']
    """
    lines = []
    for name in sorted(optimum.worst, key=lambda name: -optimum.violations[name]):
        words, unit, scale = _described(problem, name, optimum.worst[name])
        lines.append(f"{words} by {optimum.violations[name] * scale:.3g} {unit}".rstrip())
    return lines


def explain_shortfall(problem: Problem, optimum: Optimum) -> list[str]:
    """The requirements that conflict, with what each of them is short of, the dearest first.

    Args:
        problem: the form of `make_elastic`.
        optimum: of it.

    Example:
        >>> import jax.numpy as jnp
        >>> from designopt.optimize import EpigraphVariables, Evaluation, make_elastic, minimize
        >>> problem = Problem(
        ...     lambda x: Evaluation(objective=x, inequalities={"high": x - 2, "low": 1 - x}),
        ...     jnp.zeros(()),
        ...     jnp.full((), 4.0),
        ... )
        >>> form = make_elastic(problem)
        >>> start = EpigraphVariables(jnp.ones(1), jnp.ones(1))
        >>> sorted(explain_shortfall(form, minimize(form, start, "slsqp").best))
        ['high by 0.5', 'low by 0.5']
    """
    short = float(optimum.parameters.level)
    lines = []
    for one in find_active_set(problem, optimum):
        if one.name != BOUND:
            scale = _described(problem, one.name, one.index)[2]
            lines.append(f"{one.words} by {short * scale:.3g} {one.unit}".rstrip())
    return list(dict.fromkeys(lines))


def _described(problem: Problem, name: str, place: tuple[int, ...]) -> tuple[str, str, float]:
    """Of an element of a requirement: words, unit, and the unit's amount for 1 in the array."""
    if name == BOUND:
        return Flat.of(problem).bound(*place)
    requirement = problem.requirements.get(name, describe_by_index(name))
    return requirement.words(place), requirement.unit, requirement.scale
