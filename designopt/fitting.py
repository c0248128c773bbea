"""Least squares with what it is worth: covariance, residuals and identifiability."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from designopt.solution import Solution


class Fit(eqx.Module):
    """Parameters fitted to data.

    Attributes:
        solution: the parameters; ``margin`` is the least singular value of the Jacobian with its
            columns scaled to length one (0: the data cannot tell two parameters apart), and
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
    residuals: Callable[[Float[Array, " parameters"], Any], Float[Array, " data"]],
    guess: Float[Array, " parameters"],
    args: Any = None,
    *,
    tolerance: float = 1e-12,
    max_steps: int = 256,
) -> Fit:
    """Fit by Optimistix' Levenberg-Marquardt; derivatives in ``args`` are implicit.

    Args:
        residuals: deviations of the model from the data, each over its standard deviation.
        guess: where to start.
        args: what the residuals depend on beside the parameters.
        tolerance: relative and absolute, on parameters and on the sum of squares.
        max_steps: cap on iterations.

    Returns:
        The fit. The covariance is (JᵀJ)⁻¹, valid for small residuals (W. H. Press et al.,
        *Numerical Recipes*, 3rd ed., §15.4).
    """
    solver = optx.LevenbergMarquardt(rtol=tolerance, atol=tolerance)
    found = optx.least_squares(residuals, solver, guess, args, max_steps=max_steps, throw=False)
    left = residuals(found.value, args)
    jacobian = jax.jacfwd(residuals)(found.value, args)
    # Scaled columns: parameters of unlike units must not spoil the inverse.
    lengths = jnp.linalg.norm(jacobian, axis=0)
    lengths = jnp.where(lengths > 0, lengths, 1.0)
    scaled = jacobian / lengths[None, :]
    _, singular_values, right = jnp.linalg.svd(scaled, full_matrices=False)
    inverse = 1 / jnp.where(singular_values > 0, singular_values, 1.0)
    half = right.T * inverse[None, :] / lengths[:, None]
    size = jnp.linalg.norm(left)
    slope = jnp.linalg.norm(scaled.T @ left) / jnp.where(size > 0, size, 1.0)
    solution = Solution(found.value, jnp.min(singular_values), slope, found.result)
    return Fit(solution, left, half @ half.T, jnp.sum(left**2))
