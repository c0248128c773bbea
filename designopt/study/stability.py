"""Stiff and extreme cases, judged against arithmetic in 50 digits.

Errors are measured on the scale of what can be expected: with y(x) the exact answer for the
floating-point inputs as they are, the error of a value is

    |ŷ − y| / S,   S = |y| + Σ_j |x_j ∂y/∂x_j|,

the condition-scaled forward error (N. J. Higham, *Accuracy and Stability of Numerical
Algorithms*, 2nd ed., §1.6): a method that does no worse than rounding its inputs stays at a few
units of rounding, however ill-conditioned the case. An entry of the gradient is judged by what
its error would do to y, |x_i| |ĝ_i − ∂y/∂x_i| / S, and by |ĝ_i / (∂y/∂x_i) − 1| where x_i = 0.
Exact gradients are central differences in the same 50 digits: they use no automatic
differentiation.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import mpmath
import numpy as np
from jaxtyping import Array, Float

from designopt.solution import Solution
from designopt.study.results import StabilityRow

DIGITS = 50
VALUE_TOLERANCE = 64.0
"""Units of rounding that a value's condition-scaled error may reach before the case has failed."""
GRADIENT_TOLERANCE = 1024.0
"""The same for a gradient's entries, which pass through more operations."""

Inputs = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Family:
    """Cases that are extreme in one respect.

    Attributes:
        case: what is extreme in them.
        inputs: one array of shape (cases,) per input, by name.
        solve: from one case's inputs, as keywords, to a solution with a scalar value.
        exact: the same value from the same keywords as mpmath numbers.
        exact_margin: positive where the case has an answer, from the same keywords.
    """

    case: str
    inputs: Inputs
    solve: Callable[..., Solution[Any]]
    exact: Callable[..., Any]
    exact_margin: Callable[..., Any]


def assess(family: Family, dtypes: Sequence[str]) -> list[StabilityRow]:
    """Solve a family in each dtype, with gradients with respect to every input, and judge it.

    An error is no failure up to `VALUE_TOLERANCE` units of rounding, for a gradient's entries
    `GRADIENT_TOLERANCE`.

    Example:
        >>> import equinox as eqx
        >>> import jax.numpy as jnp
        >>> class Result(eqx.Enumeration):
        ...     successful = ""
        >>> def root(x):
        ...     return Solution(jnp.sqrt(x), x, jnp.zeros_like(x), Result.successful)
        >>> family = Family(
        ...     "near zero", {"x": np.array([1e-4, 1.0])}, root, mpmath.sqrt, lambda x: x
        ... )
        >>> [row.dtype for row in assess(family, ["float32"])]
        ['float32']
    """
    cases = np.stack([np.asarray(column) for column in family.inputs.values()], axis=1)
    solve = _gradient_and_solution(family.solve, tuple(family.inputs))
    rows = []
    for dtype in dtypes:
        inputs = cases.astype(dtype)
        with jax.enable_x64(dtype == "float64"):
            gradients, solved = solve(inputs)
            answers = jax.device_get((gradients, solved.value, solved.margin, solved.residual))
            ok = np.asarray(solved.ok)
        rows.append(_judge(family, dtype, inputs, ok, answers))
    return rows


@functools.cache  # families of the same function and size share one program
def _gradient_and_solution(
    solve: Callable[..., Solution[Any]], names: tuple[str, ...]
) -> Callable[[Any], tuple[Any, Solution[Any]]]:
    def value_and_solution(case: Float[Array, " inputs"]) -> tuple[Float[Array, ""], Solution[Any]]:
        solution = solve(**dict(zip(names, case, strict=True)))
        return solution.value, solution

    return jax.jit(jax.vmap(jax.grad(value_and_solution, has_aux=True)))


def _judge(
    family: Family, dtype: str, inputs: np.ndarray, ok: np.ndarray, answers: Sequence[np.ndarray]
) -> StabilityRow:
    """The row of a family; the answers are gradients, values, margins and residuals."""
    rounding = float(np.finfo(dtype).eps)
    failures = infeasible = 0
    errors = [(0.0, 0.0, 0.0)]
    for case, found, gradient, value in zip(inputs, ok, *answers[:2], strict=True):
        with mpmath.workdps(DIGITS):
            exact = {
                name: mpmath.mpf(float(x)) for name, x in zip(family.inputs, case, strict=True)
            }
            feasible = bool(family.exact_margin(**exact) > 0)
            infeasible += not feasible
            if not (feasible and found):
                failures += feasible != bool(found)
                continue
            errors.append(_errors(family, exact, float(value), gradient))
        error, gradient_error, _ = errors[-1]
        failures += (
            error > VALUE_TOLERANCE * rounding or gradient_error > GRADIENT_TOLERANCE * rounding
        )
    non_finite = sum(int(np.sum(~np.isfinite(part))) for part in answers)
    worst, worst_gradient, worst_relative = map(max, zip(*errors, strict=True))
    return StabilityRow(
        case=family.case,
        dtype=dtype,
        cases=len(inputs),
        infeasible=infeasible,
        failures=failures,
        worst_error=worst,
        worst_gradient_error=worst_gradient,
        worst_gradient_relative_error=worst_relative,
        non_finite=non_finite,
    )


def _errors(
    family: Family, case: Mapping[str, Any], value: float, gradient: np.ndarray
) -> tuple[float, float, float]:
    point = list(case.values())

    def exact(*point: Any) -> Any:
        return family.exact(**dict(zip(case, point, strict=True)))

    y = exact(*point)
    slopes = [
        mpmath.diff(exact, point, n=tuple(int(i == j) for j in range(len(point))))
        for i in range(len(point))
    ]
    size = abs(y) + sum(abs(x * slope) for x, slope in zip(point, slopes, strict=True))
    found = [_number(entry) for entry in gradient.tolist()]
    gradient_error = max(
        _ratio(abs(entry - slope), size / abs(x) if x else abs(slope))
        for entry, slope, x in zip(found, slopes, point, strict=True)
    )
    relative_error = max(
        _ratio(abs(entry - slope), abs(slope)) for entry, slope in zip(found, slopes, strict=True)
    )
    return _ratio(abs(_number(value) - y), size), gradient_error, relative_error


def _number(value: float) -> Any:
    # NaN is as wrong as infinity, and unlike it can be compared.
    return mpmath.mpf(value) if np.isfinite(value) else mpmath.inf


def _ratio(error: Any, size: Any) -> float:
    # What stays zero whatever the inputs do must come out as zero.
    if error == 0:
        return 0.0
    return float(error / size) if size else float("inf")
