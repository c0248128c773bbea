"""How well a model agrees with data: the χ² statistic of a fit, and its tail probability."""

from __future__ import annotations

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats
from jaxtyping import Array, Bool, Float

SIGNIFICANCE = 1e-6
"""Level of the test: the probability that a model without fault is refused."""


class Misfit(eqx.Module):
    """Residuals of a fit, summarised.

    Attributes:
        chi_squared: sum of the squared residuals in standard deviations, without what the fitted
            parameters could still take up.
        degrees_of_freedom: number of residuals minus the rank of their Jacobian.
        rms: √(χ² / degrees of freedom), about 1 if all standard deviations are right; 0 where no
            degree of freedom is left.
        tail: probability that a χ² variable of these degrees of freedom is at least as large.
    """

    chi_squared: Float[Array, "*batch"]
    degrees_of_freedom: Float[Array, "*batch"]
    rms: Float[Array, "*batch"]
    tail: Float[Array, "*batch"]


def find_misfit(
    residuals: Float[Array, " data"],
    jacobian: Float[Array, "data parameters"],
    used: Bool[Array, " data"],
) -> Misfit:
    """The misfit of a model whose parameters were fitted by whatever loss.

    A robust fit does not minimise the sum of squares. So that the statistic has its χ²
    distribution all the same, what a linear step of the parameters would still take away is
    projected out (W. H. Press et al., *Numerical Recipes*, 3rd ed., §15.1; A. R. Gallant,
    *Nonlinear Statistical Models*, ch. 1). Parameters that the data do not determine use up no
    degree of freedom: these are counted by the rank of the Jacobian.

    Args:
        residuals: at the fitted parameters, independent and of standard deviation 1 if the model
            holds.
        jacobian: of the residuals.
        used: which of the residuals are data; the rest count for nothing.
    """
    left = jnp.where(used, residuals, 0.0)
    slopes = jnp.where(used[:, None], jacobian, 0.0)
    lengths = jnp.linalg.norm(slopes, axis=0, keepdims=True)
    # Parameters of unlike units are compared by columns of length one.
    columns = slopes / jnp.where(lengths > 0, lengths, 1.0)
    basis, sizes, _ = jnp.linalg.svd(columns, full_matrices=False)
    independent = sizes > max(slopes.shape) * jnp.finfo(left.dtype).eps * jnp.max(sizes)
    basis = jnp.where(independent[None, :], basis, 0.0)
    left = left - basis @ (basis.T @ left)
    squares = jnp.sum(left**2)
    free = jnp.sum(used.astype(left.dtype)) - jnp.sum(independent.astype(left.dtype))
    some = jnp.maximum(free, 1.0)
    tail = jnp.where(free > 0, jax.scipy.special.gammaincc(some / 2, squares / 2), 1.0)
    return Misfit(squares, free, jnp.where(free > 0, jnp.sqrt(squares / some), 0.0), tail)


@functools.cache
def chi_squared_limits(data: int, significance: float) -> Float[np.ndarray, " counts"]:
    """The χ² that is exceeded with a probability, for 0 to ``data`` degrees of freedom.

    Raises:
        ValueError: the probability does not lie between 0 and 1.
    """
    if not 0 < significance < 1:
        raise ValueError(f"a level of significance lies between 0 and 1, not at {significance:g}")
    limits = scipy.stats.chi2.isf(significance, np.arange(data + 1))
    limits[0] = np.inf
    limits.flags.writeable = False  # as they are computed once
    return limits
