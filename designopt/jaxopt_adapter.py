"""The only door to jaxopt, which is no longer maintained.

Numbers that jaxopt annotates as ``float`` may be scalar arrays, traced ones included.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import jax
from jaxtyping import Array, Float, Int

with warnings.catch_warnings():
    warnings.filterwarnings("ignore", message="JAXopt is no longer maintained")
    import jaxopt

Residual = Callable[[Float[Array, ""], Any], Float[Array, ""]]


def root(
    residual: Residual,
    guess: Float[Array, ""],
    args: Any,
    method: str,
    bracket: tuple[Any, Any],
    *,
    tolerance: Any,
    max_steps: int,
) -> Float[Array, ""]:
    """Root of a scalar residual by jaxopt's Bisection or GaussNewton, with its implicit derivative.

    Args:
        residual: from a number and ``args`` to a number.
        guess: where GaussNewton starts.
        args: what the residual depends on beside the number.
        method: ``"jaxopt-bisection"`` or ``"jaxopt-gauss-newton"``.
        bracket: where Bisection starts; it is not checked (jaxopt raises, which a batch cannot):
            check the residual at the root.
        tolerance: of the residual.
        max_steps: cap on iterations.
    """
    caps: Any = {"maxiter": max_steps, "tol": tolerance}
    if method == "jaxopt-bisection":
        solver = jaxopt.Bisection(residual, *bracket, check_bracket=False, **caps)
        return solver.run(None, args).params
    return jaxopt.GaussNewton(residual, **caps).run(guess, args).params


def minimize_in_box(
    objective: Callable[[Float[Array, " n"], Any], Float[Array, ""]],
    guess: Float[Array, " n"],
    bounds: tuple[Float[Array, " n"], Float[Array, " n"]],
    args: Any,
    *,
    method: str,
    tolerance: Any,
    max_steps: int,
) -> tuple[Float[Array, " n"], Int[Array, ""]]:
    """Minimum between bounds, and the number of steps, by jaxopt's LBFGSB or ProjectedGradient.

    Args:
        objective: from a vector and ``args`` to a number.
        guess: where to start, inside the bounds.
        bounds: least and greatest values; may be infinite.
        args: what the objective depends on beside the vector.
        method: ``"jaxopt-lbfgsb"`` or ``"jaxopt-projected-gradient"``.
        tolerance: of jaxopt's optimality error.
        max_steps: cap on iterations.
    """
    options: Any = {"maxiter": max_steps, "tol": tolerance, "implicit_diff": False}
    # jaxopt mixes ranks and types within itself.
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        if method == "jaxopt-lbfgsb":
            # The default line search compiles for minutes.
            solver = jaxopt.LBFGSB(objective, linesearch="backtracking", **options)
            found = solver.run(guess, bounds, args)
        else:
            box = jaxopt.projection.projection_box
            solver = jaxopt.ProjectedGradient(objective, box, **options)
            found = solver.run(guess, hyperparams_proj=bounds, args=args)
        return found.params, found.state.iter_num


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

    Convergence is not reported: check the answer.
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
