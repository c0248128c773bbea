"""A problem with a bound: number 2 of W. Hock and K. Schittkowski.

Least 100 (x₂ − x₁²)² + (1 − x₁)² with x₂ ≥ 1.5 (*Test Examples for Nonlinear Programming Codes*,
Springer 1981). The bound holds at the minimum, where 400 x₁³ − 598 x₁ − 2 = 0, so that
x₁ = 2 a cos(⅓ arccos 1/b) with a = √(598/1200) and b = 400 a³. The published start (−2, 1) leads to
another local minimum, near x₁ = −1.22; `START` lies on the side of the least one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import jax.numpy as jnp
import mpmath
import numpy as np
import optimistix as optx
import scipy.optimize
from jaxtyping import Array, Float

from designopt.optimize import Evaluation, Problem
from designopt.optimize.augmented_lagrangian import Inner, augmented_lagrangian
from designopt.optimize.flat import Flat
from designopt.study.benchmark import BenchmarkMethod, compile_methods
from designopt.study.stability import DIGITS

PANEL = "problem 2 of Hock and Schittkowski"
OURS = "augmented Lagrangian, Levenberg-Marquardt"
BOUND, START = 1.5, (1.5, 2.5)
TOLERANCES = (1e-4, 1e-8, 1e-12)
INNER: dict[str, Inner] = {
    OURS: "levenberg-marquardt",
    "jaxopt LBFGSB": "jaxopt-lbfgsb",  # those of jaxopt keep bounds themselves: one solve
    "jaxopt projected gradient": "jaxopt-projected-gradient",
}

Point = Float[Array, "2"]


def minimum() -> np.ndarray:
    """Where the least value is, rounded from many digits."""
    with mpmath.workdps(DIGITS):
        a = mpmath.sqrt(mpmath.mpf(598) / 1200)
        return np.array([float(2 * a * mpmath.cos(mpmath.acos(1 / (400 * a**3)) / 3)), BOUND])


def methods() -> Iterator[BenchmarkMethod]:
    """Every solver at every tolerance."""
    start, exact = jnp.asarray(START), minimum()
    bounds = jnp.asarray([-jnp.inf, BOUND]), jnp.full(2, jnp.inf)
    flat = Flat.of(Problem(lambda x: Evaluation(residuals=_residuals(x)), *bounds))

    def error(found: Any) -> float:
        return float(np.max(np.abs(np.asarray(found) - exact)))

    settings = {f"tolerance {value:.0e}": value for value in TOLERANCES}
    for setting, value in settings.items():  # a static number here
        for name, inner in INNER.items():
            solve = partial(_lagrangian, flat, inner, value)
            [one] = compile_methods(name, PANEL, error, solve, start)
            yield replace(one, setting=setting)
        yield BenchmarkMethod("SciPy L-BFGS-B", setting, PANEL, partial(_lbfgsb, value), error)
    arrays = {name: jnp.asarray(value) for name, value in settings.items()}
    name = "Optimistix BFGS, squared slack"
    yield from compile_methods(name, PANEL, error, _squared_slack, start, settings=arrays)


def _residuals(x: Point) -> Point:
    return jnp.stack([10 * (x[1] - x[0] ** 2), 1 - x[0]])


def _lagrangian(flat: Flat, inner: Inner, tolerance: float, start: Point) -> Point:
    caps: dict[str, Any] = {"floor": None, "tolerance": tolerance, "updates": 30, "steps": 10_000}
    return flat.parameters(augmented_lagrangian(flat, inner, flat.point(start), **caps)[0])


def _squared_slack(start: Point, tolerance: Any) -> Point:
    def inside(y: Point) -> Point:  # Optimistix' minimisers have no bounds
        return jnp.stack([y[0], BOUND + y[1] ** 2])

    found = optx.minimise(
        lambda y, _: jnp.sum(_residuals(inside(y)) ** 2) / 2,
        optx.BFGS(tolerance, tolerance),
        jnp.stack([start[0], jnp.sqrt(start[1] - BOUND)]),
        max_steps=10_000,
        throw=False,
    )
    return inside(found.value)


def _lbfgsb(tolerance: float) -> np.ndarray:
    def value_and_slope(x: np.ndarray) -> tuple[float, np.ndarray]:
        valley, one = 10 * (x[1] - x[0] ** 2), 1 - x[0]
        slope = np.array([-20 * x[0] * valley - one, 10 * valley])
        return (valley**2 + one**2) / 2, slope

    bounds, caps = [(None, None), (BOUND, None)], {"gtol": tolerance, "ftol": 0.0}
    return scipy.optimize.minimize(
        value_and_slope, START, jac=True, method="L-BFGS-B", bounds=bounds, options=caps
    ).x
