"""Least squares with what it is worth: covariance, residuals and identifiability."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from designopt.roots import ROUNDING_UNITS
from designopt.solution import Solution

Parameters = Float[Array, " parameters"]
Residuals = Callable[[Parameters, Any], Float[Array, " residuals"]]
Jacobian = Callable[[Parameters, Any], Float[Array, "residuals parameters"]]

ROBUST = 3.0
"""Residuals of more deviations than this count less (pseudo-Huber loss)."""


def robust_residuals(left: Float[Array, "*data"]) -> Float[Array, "*data"]:
    """Residuals whose squares are the pseudo-Huber loss of the given ones: outliers count less.

    Source: P. Charbonnier et al., IEEE Trans. Image Process. 6 (1997) 298, with
    2 δ² (√(1 + r²/δ²) − 1) = r² · 2 / (1 + √(1 + r²/δ²)).

    Args:
        left: residuals in standard deviations.

    Example:
        >>> [round(float(one), 2) for one in robust_residuals(jnp.array([0.1, 100.0]))]
        [0.1, 24.13]
    """
    return left * jnp.sqrt(2 / (1 + jnp.sqrt(1 + (left / ROBUST) ** 2)))


def with_jacobian(function: Residuals, jacobian: Jacobian | None = None) -> Residuals:
    """The same function, whose derivative in its first argument is its Jacobian as a matrix.

    A least-squares solver carries the derivative along. As a matrix that is one array; as the trace
    of the function it is hundreds, which took four times as long to compile. It has no derivative
    in its second argument.

    Args:
        function: residuals of parameters.
        jacobian: its derivative, where most of it is 0 and known to be; by default every entry is
            computed.
    """

    @jax.custom_jvp
    def known(point: Parameters, args: Any) -> Float[Array, " residuals"]:
        return function(point, args)

    @known.defjvp
    def slope(at: tuple[Parameters, Any], towards: tuple[Parameters, Any]) -> tuple[Any, Any]:
        def twice(point: Parameters) -> tuple[Any, Any]:
            value = function(point, at[1])
            return value, value

        if jacobian is None:
            slopes, value = jax.jacfwd(twice, has_aux=True)(at[0])
        else:
            slopes, value = jacobian(*at), function(*at)
        return value, slopes @ towards[0]

    return known


def add_information(
    covariance: Float[np.ndarray, "parameters parameters"],
    information: Float[np.ndarray, "parameters parameters"],
) -> Float[np.ndarray, "parameters parameters"]:
    """The covariance of parameters on which there is more information: (C⁻¹ + N)⁻¹.

    By Woodbury's identity it is (I + C N)⁻¹ C, also of a C without an inverse: a parameter that is
    held stays so.

    Example:
        >>> add_information(np.diag([4.0, 0.0]), np.eye(2)).tolist()
        [[0.8, 0.0], [0.0, 0.0]]
    """
    return np.linalg.solve(np.eye(len(covariance)) + covariance @ information, covariance)


class Fit(eqx.Module):
    """Parameters fitted to data.

    Attributes:
        solution: the parameters; ``margin`` is the least singular value of the Jacobian with its
            columns scaled to length one (0: two parameters have the same effect on the data), and
            ``residual`` the norm of the projection of the residuals on those columns, over
            their own norm (0 at a minimum).
        residuals: what is left of each datum, in units of its standard deviation.
        covariance: of the parameters in the order given, from the data's stated deviations;
            without meaning where ``margin`` is 0.
        chi_squared: sum of squared residuals; about data minus parameters when the stated
            deviations are right.
    """

    solution: Solution[Float[Array, " parameters"]]
    residuals: Float[Array, " data"]
    covariance: Float[Array, "parameters parameters"]
    chi_squared: Float[Array, ""]


def least_squares(
    residuals: Residuals,
    guess: Float[Array, " parameters"],
    args: Any = None,
    *,
    jacobian: Jacobian | None = None,
    tolerance: float = 1e-12,
    max_steps: int = 256,
    differentiable: bool = True,
) -> Fit:
    """Fit by Optimistix' Levenberg-Marquardt; derivatives in ``args`` are implicit.

    Args:
        residuals: deviations of the model from the data, each over its standard deviation.
        guess: where to start.
        args: what the residuals depend on beside the parameters.
        jacobian: of the residuals by the parameters, where most of it is 0 and known to be; without
            ``differentiable`` only. By default every entry is computed.
        tolerance: relative and absolute, on the parameters and on the sum of squares relative to
            that of the guess; not below `ROUNDING_UNITS` units of rounding of the dtype.
        max_steps: cap on iterations.
        differentiable: whether derivatives of the fit are wanted; without, they are 0, and it
            compiles several times faster, by normal equations, which square the condition number.

    Returns:
        The fit. It is ``ok`` at a minimum and nowhere else: where the residuals have, to the cube
        root of rounding, no component along the Jacobian, or are as small as that against those of
        the guess. Where residuals are not finite, all but the parameters is 0 and ``residual`` 1.
        The covariance is (JᵀJ)⁻¹, valid for small residuals (W. H. Press et al.,
        *Numerical Recipes*, 3rd ed., §15.4).

    Example:
        >>> import jax.numpy as jnp
        >>> x, y = jnp.arange(4.0), jnp.array([1.0, 3.0, 5.0, 7.0])
        >>> fit = least_squares(lambda p, _: p[0] + p[1] * x - y, jnp.zeros(2))
        >>> [round(v, 4) for v in fit.solution.value.tolist()]
        [1.0, 2.0]
    """
    dtype = guess.dtype
    tolerance = max(tolerance, ROUNDING_UNITS * float(jnp.finfo(dtype).eps))
    # Tolerances are compared with the raw sum of squares: let it start at one half.
    start = jnp.linalg.norm(residuals(guess, args))
    unit = jax.lax.stop_gradient(jnp.where((start > 0) & jnp.isfinite(start), start, 1.0))

    def scaled_residuals(parameters: Parameters, args: Any) -> Float[Array, " data"]:
        return residuals(parameters, args) / unit

    if differentiable:
        function = scaled_residuals
        solver = optx.LevenbergMarquardt(rtol=tolerance, atol=tolerance)
    else:
        scaled_jacobian = None if jacobian is None else lambda p, args: jacobian(p, args) / unit
        function = with_jacobian(scaled_residuals, scaled_jacobian)
        # A factorisation of the tall matrix takes far longer to compile.
        normal = lx.Normal(lx.Cholesky())
        solver = optx.LevenbergMarquardt(rtol=tolerance, atol=tolerance, linear_solver=normal)
    found = optx.least_squares(
        function,
        solver,
        guess,
        args,
        max_steps=max_steps,
        # The pseudo-inverse keeps the derivative finite where parameters have the same effect.
        adjoint=optx.ImplicitAdjoint(linear_solver=lx.AutoLinearSolver(well_posed=False)),
        throw=False,
    )
    best = found.value if differentiable else jax.lax.stop_gradient(found.value)
    value = jnp.where(jnp.isfinite(best), best, jax.lax.stop_gradient(guess))
    left = residuals(value, args)
    slopes = (jacobian or jax.jacfwd(residuals))(value, args)
    known = jnp.all(jnp.isfinite(left)) & jnp.all(jnp.isfinite(slopes))
    left = jnp.where(known, left, 0.0)
    slopes = jnp.where(known, slopes, 0.0)

    # Scaled columns: parameters of unlike units must not spoil the inverse.
    lengths = jnp.linalg.norm(slopes, axis=0)
    lengths = jnp.where(lengths > 0, lengths, 1.0)
    scaled = slopes / lengths[None, :]
    # The triangle has the singular values of the tall matrix, and they take a tenth of the time.
    triangle = jnp.linalg.qr(scaled, mode="r")
    _, singular_values, right = jnp.linalg.svd(triangle, full_matrices=False)
    inverse = 1 / jnp.where(singular_values > 0, singular_values, 1.0)
    half = right.T * inverse[None, :] / lengths[:, None]

    size = jnp.linalg.norm(left)
    slope = jnp.linalg.norm(scaled.T @ left) / jnp.where(size > 0, size, 1.0)
    # What counts is the minimum, not how the iteration ended. Residuals of a perfect fit are
    # rounding, whose direction means nothing.
    loose = jnp.finfo(dtype).eps ** (1 / 3)
    at_minimum = (slope <= loose) | (size <= loose * unit)
    elsewhere = optx.RESULTS.where(
        found.result == optx.RESULTS.successful, optx.RESULTS.nonlinear_divergence, found.result
    )
    result = optx.RESULTS.where(at_minimum, optx.RESULTS.successful, elsewhere)
    result = optx.RESULTS.where(known, result, optx.RESULTS.nonfinite)
    margin = jnp.where(known, jnp.min(singular_values), 0.0)
    solution = Solution(value, margin, jnp.where(known, slope, 1.0), result)
    return Fit(solution, left, half @ half.T, jnp.sum(left**2))
