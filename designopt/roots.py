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

Residual = Callable[[Float[Array, ""], Any], Float[Array, ""]]

ROUNDING_UNITS = 8
"""Least tolerance in units of rounding: a residual of a few operations is known no better."""


def find_root(
    residual: Residual,
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
        guess: where to start; a bisection starts from its bracket instead.
        args: what the residual depends on beside the unknown.
        method: which iteration. Those named jaxopt-… run in jaxopt, the others in Optimistix.
        bracket: two values at which the residual has opposite signs; the bisections need it.
        tolerance: absolute and relative; may be traced, so that one program serves several. One
            below `ROUNDING_UNITS` units of rounding of the dtype is raised to that, or a whole
            batch would run to its last step for nothing.
        max_steps: cap on iterations.

    Returns:
        The root. ``margin`` is the magnitude of the residual's slope there (0 at a double root).
        An element that did not converge has Optimistix's code; nothing raises in a batch. Where
        the residual itself is not finite (outside its domain), margin is 0 and residual 1; the
        derivative of such an element is the residual's own affair.

    Raises:
        ValueError: a bisection without a bracket, or a method that mixes float types.

    Example:
        >>> import jax, jax.numpy as jnp
        >>> found = find_root(lambda y, a: y**2 - a, jnp.array(1.0), jnp.array(2.0))
        >>> bool(found.ok), round(float(found.value), 6)
        (True, 1.414214)
        >>> slope = jax.grad(lambda a: find_root(lambda y, a: y**2 - a, jnp.array(1.0), a).value)(
        ...     2.0
        ... )
        >>> round(float(slope), 4)  # 1 / (2 √2)
        0.3536
    """
    dtype = guess.dtype
    floor = ROUNDING_UNITS * jnp.finfo(dtype).eps
    tolerance = jnp.maximum(as_float(tolerance).astype(dtype), floor)
    if "bisection" in method:
        if bracket is None:
            raise ValueError(f"{method} needs a bracket: pass bracket=(lower, upper)")
        lower, upper = (as_float(end).astype(dtype) for end in bracket)
        guess = (lower + upper) / 2
    else:
        lower = upper = guess  # not used by these methods
    if method.startswith("jaxopt"):
        # Imported on first use: jaxopt takes half a second, and few solves need it.
        from designopt import jaxopt_adapter

        caps = {"tolerance": tolerance, "max_steps": max_steps}
        root = jaxopt_adapter.root(residual, guess, args, method, (lower, upper), **caps)
        converged = jnp.abs(residual(root, args)) <= tolerance
        result = optx.RESULTS.where(
            converged, optx.RESULTS.successful, optx.RESULTS.nonlinear_max_steps_reached
        )
    else:
        found = _optimistix(residual, guess, args, method, (lower, upper), tolerance, max_steps)
        root, result = found.value, found.result
    root = jnp.where(jnp.isfinite(root), root, jax.lax.stop_gradient(guess))
    value, slope = jax.value_and_grad(residual)(root, args)
    known = jnp.isfinite(value) & jnp.isfinite(slope)
    return Solution(
        root,
        margin=jnp.where(known, jnp.abs(slope), 0.0),
        residual=jnp.where(known, jnp.abs(value), 1.0),
        result=optx.RESULTS.where(known, result, optx.RESULTS.nonfinite),
    )


def check_default_float(method: str, guess: Array) -> None:
    """Refuse a start in another float type than JAX's default.

    Raises:
        ValueError: the method would mix the two.
    """
    if guess.dtype != jnp.result_type(float):
        raise ValueError(
            f"{method} computes in JAX's default float type: "
            "call it with that, or under jax.enable_x64(False) for float32"
        )


def _optimistix(
    residual: Residual,
    guess: Float[Array, ""],
    args: Any,
    method: str,
    bracket: tuple[Float[Array, ""], Float[Array, ""]],
    tolerance: Any,  # annotated float by the libraries, which take a traced array all the same
    max_steps: int,
) -> optx.Solution:
    equation, options = residual, None
    match method:
        case "newton":
            solver = optx.Newton(tolerance, tolerance)
        case "chord":
            solver = optx.Chord(tolerance, tolerance)
        case "bisection":
            # Its own look for the signs raises where they agree, and one case would end a batch;
            # with a residual that rises from the lower end it fails to converge instead.
            lower, upper = bracket
            rises = residual(lower, args) < residual(upper, args)
            sign = jnp.where(rises, jnp.ones_like(guess), -jnp.ones_like(guess))
            options = {"lower": lower, "upper": upper}

            def rising(y: Float[Array, ""], args: Any) -> Float[Array, ""]:
                return sign * residual(y, args)

            equation = rising
            solver = optx.Bisection(tolerance, tolerance, flip=False)
        case _:
            check_default_float(method, guess)
            kind = {"dogleg": optx.Dogleg, "levenberg-marquardt": optx.LevenbergMarquardt}[method]
            solver = kind(tolerance, tolerance)
    return optx.root_find(
        equation,
        solver,
        guess,
        args,
        options=options,
        max_steps=max_steps,
        # The pseudo-inverse keeps the derivative finite (zero) where the slope vanishes.
        adjoint=optx.ImplicitAdjoint(linear_solver=lx.AutoLinearSolver(well_posed=False)),
        throw=False,
    )
