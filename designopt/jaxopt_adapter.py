"""The only door to jaxopt, which is no longer maintained.

Numbers that jaxopt annotates as ``float`` may be scalar arrays, traced ones included.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import jax
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


def box_minimum(
    function: Callable[[Float[Array, " n"], Any], Float[Array, ""]],
    guess: Float[Array, " n"],
    bounds: tuple[Float[Array, " n"], Float[Array, " n"]],
    args: Any,
    *,
    tolerance: Any,
    max_steps: int,
) -> Float[Array, " n"]:
    """Minimum of ``function(x, args)`` between bounds by jaxopt's LBFGSB.

    Nothing says whether it converged: check the answer.
    """
    # jaxopt mixes ranks and types within itself.
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        solver = jaxopt.LBFGSB(
            function,
            maxiter=max_steps,
            tol=tolerance,
            linesearch="backtracking",
            implicit_diff=False,
        )
        return solver.run(guess, bounds, args).params


def quadratic_program(
    hessian: Float[Array, "n n"],
    slope: Float[Array, " n"],
    rows: Float[Array, "m n"],
    bounds: tuple[Float[Array, " m"], Float[Array, " m"]],
    *,
    tolerance: Any,
    max_steps: int,
) -> Float[Array, " n"]:
    """Minimum of ½ xᵀ hessian x + slopeᵀ x with bounds on ``rows @ x``, by jaxopt's BoxOSQP.

    Nothing says whether it converged: check the answer.
    """
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        solver = jaxopt.BoxOSQP(
            maxiter=max_steps,
            tol=tolerance,
            check_primal_dual_infeasability=False,
            implicit_diff=False,
        )
        found = solver.run(params_obj=(hessian, slope), params_eq=rows, params_ineq=bounds)
        return found.params.primal[0]
