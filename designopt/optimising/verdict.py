"""What a point is worth, found without the solver that proposed it.

Violations are computed anew, and multipliers from the stationarity conditions (Karush, Kuhn and
Tucker) by non-negative least squares over the constraints that are active there; what these leave
of the objective's gradient says how far the point is from an optimum (J. Nocedal, S. J. Wright,
*Numerical Optimization*, 2nd ed., §12.3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls

from designopt.optimising.augmented import Trace
from designopt.optimising.flat import Flat, Point, joined
from designopt.optimising.problem import Parameters
from designopt.solution import Solution

FEASIBLE = 1e-6
"""Largest scaled violation of a point that counts as feasible."""

ACTIVE = 1e-4
"""A constraint that is no farther from its limit, scaled, is a candidate for a multiplier."""

STATIONARY = 1e-2
"""Largest part of the objective's gradient that multipliers may leave at an optimum."""

BOUND = "bounds"
"""Name of the bounds among violations and multipliers."""


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
    no_number = "The search left the domain in which the problem has numbers: start elsewhere."


@dataclass(frozen=True)
class Optimum:
    """What one start led to.

    Attributes:
        solution: the parameters. ``margin`` is the smallest scaled inequality or distance to a
            bound (negative: the largest violation), ``residual`` what is left of the objective's
            gradient, relative to it.
        objective: what was minimised.
        violations: largest scaled violation by the constraint's name; 0 where it holds.
        multipliers: by the constraint's name, in its shape; of bounds, in their order.
        history: one row per update of the multipliers, or per step.
    """

    solution: Solution[Parameters]
    objective: float
    violations: dict[str, float]
    multipliers: dict[str, np.ndarray]
    history: Trace

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
        return np.isfinite(self.objective) and self.violation <= FEASIBLE


def judge(flat: Flat) -> Callable[[Point, Trace], Optimum]:
    """A function that judges points of a problem; it compiles once.

    Args:
        flat: the problem.
    """

    def parts(point: Point) -> Any:
        terms = flat.terms(point)
        h, g = (joined(part, point.dtype) for part in (terms.equalities, terms.inequalities))
        return terms.value, h, jnp.concatenate([g, flat.bounds(point)])

    @jax.jit
    def values_and_slopes(point: Point) -> tuple[Any, Any]:
        return parts(point), jax.jacfwd(parts)(point)

    shapes = jax.eval_shape(flat.terms, jnp.zeros(flat.units.size, flat.units.dtype))
    equalities = {name: part.shape for name, part in sorted(shapes.equalities.items())}
    inequalities = {name: part.shape for name, part in sorted(shapes.inequalities.items())}
    inequalities[BOUND] = (sum(len(part) for part in flat.limited),)

    def verdict(point: Point, history: Trace) -> Optimum:
        (value, h, g), slopes = jax.tree.map(np.asarray, values_and_slopes(point))
        numbers = (value, h, g, *slopes)
        if not all(np.all(np.isfinite(part)) for part in numbers):
            return _without_numbers(flat, point, history)
        mu, lam, residual = _multipliers(h, g, slopes)
        violations = {n: float(np.max(np.abs(v))) for n, v in _named(equalities, h)}
        violations |= {
            n: max(0.0, -float(np.min(v, initial=0))) for n, v in _named(inequalities, g)
        }
        margin = min(float(np.min(g, initial=np.inf)), -float(np.max(np.abs(h), initial=-np.inf)))
        result = OptimumResult.successful
        if residual > STATIONARY:
            result = OptimumResult.not_stationary
        if max(violations.values(), default=0.0) > FEASIBLE:
            result = OptimumResult.infeasible
        multipliers = dict(_named(equalities, mu)) | dict(_named(inequalities, lam))
        solution = Solution(
            flat.parameters(point), jnp.asarray(margin), jnp.asarray(residual), result
        )
        return Optimum(solution, float(value), violations, multipliers, history)

    return verdict


def _multipliers(
    h: Float[np.ndarray, " equalities"],
    g: Float[np.ndarray, " inequalities"],
    slopes: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, float]:
    gradient, of_h, of_g = slopes
    candidates = np.flatnonzero(g <= ACTIVE)
    columns = np.concatenate([-of_h, of_h, of_g[candidates]]).T
    lam, mu = np.zeros_like(g), np.zeros_like(h)
    if columns.size:
        found, left = nnls(columns, gradient)
        mu = found[: h.size] - found[h.size : 2 * h.size]
        lam[candidates] = found[2 * h.size :]
    else:
        left = float(np.linalg.norm(gradient))
    size = float(np.linalg.norm(gradient))
    return mu, lam, left / max(size, FEASIBLE)


def _named(shapes: dict[str, tuple[int, ...]], flat: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """The arrays that were joined, by name; those that are empty left out."""
    sizes = [int(np.prod(shape)) for shape in shapes.values()]
    parts = np.split(flat, np.cumsum(sizes)[:-1]) if sizes else []
    return [
        (name, part.reshape(shape))
        for (name, shape), part in zip(shapes.items(), parts, strict=True)
        if part.size
    ]


def _without_numbers(flat: Flat, point: Point, history: Trace) -> Optimum:
    solution = Solution(
        flat.parameters(jnp.where(jnp.isfinite(point), point, 0.0)),
        jnp.asarray(-1.0),
        jnp.asarray(1.0),
        OptimumResult.no_number,
    )
    return Optimum(solution, float("inf"), {}, {}, history)
