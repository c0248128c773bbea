"""The only door to jaxopt, which is no longer maintained.

Numbers that jaxopt annotates as ``float`` may be scalar arrays, traced ones included.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

from jaxtyping import Array, Float

with warnings.catch_warnings():
    warnings.filterwarnings("ignore", message="JAXopt is no longer maintained")
    import jaxopt

Residual = Callable[[Float[Array, ""], Any], Float[Array, ""]]


def bisection(
    residual: Residual,
    bracket: tuple[Any, Any],
    args: Any,
    *,
    tolerance: Any,
    max_steps: int,
) -> Float[Array, ""]:
    """Root of a scalar residual by jaxopt's Bisection, with its implicit derivative.

    The bracket is not checked here (jaxopt raises, which a batch cannot): check the residual
    at the root.
    """
    lower, upper = bracket
    solver = jaxopt.Bisection(
        residual, lower, upper, maxiter=max_steps, tol=tolerance, check_bracket=False
    )
    return solver.run(None, args).params


def gauss_newton(
    residual: Residual,
    guess: Float[Array, ""],
    args: Any,
    *,
    tolerance: Any,
    max_steps: int,
) -> Float[Array, ""]:
    """Root of a scalar residual by jaxopt's GaussNewton, with its implicit derivative."""
    solver = jaxopt.GaussNewton(residual, maxiter=max_steps, tol=tolerance)
    return solver.run(guess, args).params
