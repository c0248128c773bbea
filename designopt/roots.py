"""Scalar root finding: every iterative method behind one call and one answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, ArrayLike, Float

from designopt.numerics import as_float
from designopt.solution import Solution

RootMethod = Literal[
    "newton",
    "chord",
    "bisection",
    "dogleg",
    "levenberg-marquardt",
    "jaxopt-bisection",
    "jaxopt-gauss-newton",
]

_OPTIMISTIX = {
    "newton": optx.Newton,
    "chord": optx.Chord,
    "bisection": optx.Bisection,
    "dogleg": optx.Dogleg,
    "levenberg-marquardt": optx.LevenbergMarquardt,
}


ROUNDING_UNITS = 8
"""Least tolerance in units of rounding: a residual of a few operations is known no better."""


def find_root(
    residual: Callable[[Float[Array, ""], Any], Float[Array, ""]],
    guess: Float[Array, ""],
    args: Any = None,
    *,
    method: RootMethod = "newton",
    bracket: tuple[ArrayLike, ArrayLike] | None = None,
    tolerance: ArrayLike = 1e-12,
    max_steps: int = 64,
) -> Solution[Float[Array, ""]]:
    """A root of ``residual(y, args)``, differentiable in ``args`` by the implicit function theorem.

    Args:
        residual: scalar equation, scaled to order one.
        guess: where to start; bisection starts from its bracket instead.
        args: what the residual depends on beside the unknown.
        method: which iteration. Those named jaxopt-… run in jaxopt, the others in Optimistix.
        bracket: two values at which the residual has opposite signs; the bisections need it.
        tolerance: absolute and relative; may be traced, so that one program serves several. One
            below `ROUNDING_UNITS` units of rounding of the dtype is raised to that.
        max_steps: cap on iterations.

    Returns:
        The root. ``margin`` is the magnitude of the residual's slope there (0 at a double root).
        An element that did not converge has Optimistix's code; nothing raises in a batch.

    Raises:
        ValueError: a bisection without a bracket.
    """
    # Below rounding nothing converges, and a whole batch would run to its last step for it.
    floor = ROUNDING_UNITS * jnp.finfo(guess.dtype).eps
    tolerance = jnp.maximum(as_float(tolerance).astype(guess.dtype), floor)
    if bracket is not None:
        bracket = (as_float(bracket[0]).astype(guess.dtype), as_float(bracket[1]).astype(guess.dtype))
    elif method in ("bisection", "jaxopt-bisection"):
        raise ValueError(f"{method} needs a bracket: pass bracket=(lower, upper)")

    if method in _OPTIMISTIX:
        found = optx.root_find(
            residual,
            _OPTIMISTIX[method](rtol=tolerance, atol=tolerance),
            guess,
            args,
            options={"lower": bracket[0], "upper": bracket[1]} if method == "bisection" else None,
            max_steps=max_steps,
            # The pseudo-inverse keeps the derivative finite (zero) where the slope vanishes.
            adjoint=optx.ImplicitAdjoint(linear_solver=lx.AutoLinearSolver(well_posed=False)),
            throw=False,
        )
        root, result = found.value, found.result
    else:
        # Imported on first use: jaxopt takes half a second, and few solves ask for it.
        from designopt import jaxopt_adapter

        if method == "jaxopt-bisection":
            root = jaxopt_adapter.bisection(
                residual, bracket, args, tolerance=tolerance, max_steps=max_steps
            )
        else:
            root = jaxopt_adapter.gauss_newton(
                residual, guess, args, tolerance=tolerance, max_steps=max_steps
            )
        result = None
    root = jnp.where(jnp.isfinite(root), root, jax.lax.stop_gradient(guess))
    value, slope = jax.value_and_grad(residual)(root, args)
    if result is None:
        result = optx.RESULTS.where(
            jnp.abs(value) <= tolerance,
            optx.RESULTS.successful,
            optx.RESULTS.nonlinear_max_steps_reached,
        )
    return Solution(root, jnp.abs(slope), jnp.abs(value), result)
