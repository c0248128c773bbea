"""Arithmetic that stays finite, in value and in slope, where the plain operation does not.

And two steps to a root: halvings without derivatives, and a last one that carries them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

TO_ROUNDING = 60
"""Halvings of an interval, to rounding in double precision."""


def safe_divide(
    numerator: Float[Array, "..."], denominator: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Bool[Array, "..."]]:
    """Quotient and whether it can be represented; 0 with zero slope where it cannot.

    A quotient counts as representable only if neither it nor a derivative of it overflows, so
    ``denominator`` must exceed about 1e-154 (float64) or 1e-19 (float32). A derivative may still
    vanish below the range.

    Args:
        numerator: any finite array.
        denominator: any array that broadcasts with it; infinity gives 0.

    Returns:
        The quotient and a mask of the same shape.

    Example:
        >>> import jax.numpy as jnp
        >>> quotient, ok = safe_divide(jnp.array([1.0, 1.0]), jnp.array([2.0, 0.0]))
        >>> quotient.tolist(), ok.tolist()
        ([0.5, 0.0], [True, False])
    """
    limits = jnp.finfo(denominator.dtype)
    square = denominator * denominator
    # Not |numerator| / max: compiled as a product with a reciprocal that is flushed to zero.
    valid = (square > limits.tiny) & (jnp.abs(numerator) < limits.max * square)
    # Both branches of a `where` are differentiated, so the unused one must be finite as well.
    quotient = jnp.where(valid, numerator, 0.0) / jnp.where(valid, denominator, 1.0)
    return quotient, valid


def safe_sqrt(value: Float[Array, "..."]) -> Float[Array, "..."]:
    """Square root, and 0 with zero slope where the argument is not positive.

    Example:
        >>> import jax, jax.numpy as jnp
        >>> float(safe_sqrt(jnp.array(9.0))), float(jax.grad(safe_sqrt)(jnp.zeros(())))
        (3.0, 0.0)
    """
    positive = value > 0
    # XLA may compute an argument twice, rounded in two ways, so that the two masks differ where it
    # nearly vanishes: what the inner one puts in must have a root near 0, and finite slopes.
    filled = jnp.where(positive, value, jnp.finfo(value.dtype).tiny ** 0.5)
    return jnp.where(positive, jnp.sqrt(filled), 0.0)


def safe_arctan2(y: Float[Array, "..."], x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Angle of (x, y) in radians, and 0 with zero slope where it is undefined, at the origin.

    Points nearer to it than about 1e-154 (float64) or 1e-19 (float32) count as the origin: their
    angle's slope does not fit the dtype.

    Example:
        >>> import jax, jax.numpy as jnp
        >>> one, zero = jnp.ones(()), jnp.zeros(())
        >>> round(float(safe_arctan2(one, one)), 4), float(jax.grad(safe_arctan2)(zero, zero))
        (0.7854, 0.0)
    """
    defined = x * x + y * y > jnp.finfo(x.dtype).tiny
    return jnp.arctan2(jnp.where(defined, y, 0.0), jnp.where(defined, x, 1.0))


def safe_quadratic_roots(
    c2: Float[Array, "..."], c1: Float[Array, "..."], c0: Float[Array, "..."]
) -> tuple[Float[Array, "... 2"], Bool[Array, "... 2"], Float[Array, "..."]]:
    """Both roots of c2 x² + c1 x + c0, without cancellation and down to c2 = 0.

    Source: W. H. Press et al., *Numerical Recipes*, 3rd ed., §5.6: with
    q = −(c1 + sgn(c1) √(c1² − 4 c2 c0)) / 2 the roots are c0 / q and q / c2.

    Returns:
        Roots (the one that survives c2 → 0 first), which of them exist, and the discriminant
        scaled to lie between −1 and 1 (negative where both roots are complex). At a double root,
        where the discriminant is 0, the roots' slopes are infinite; they come out finite there
        and mean nothing.

    Example:
        >>> import jax.numpy as jnp
        >>> roots, real, _ = safe_quadratic_roots(*map(jnp.asarray, (1.0, -3.0, 2.0)))
        >>> sorted(round(root, 4) for root in roots.tolist()), real.tolist()
        ([1.0, 2.0], [True, True])
    """
    # The roots do not depend on a common factor, so neither does their derivative.
    scale = jax.lax.stop_gradient(jnp.maximum(jnp.maximum(jnp.abs(c2), jnp.abs(c1)), jnp.abs(c0)))
    scale = jnp.where(scale > 0, scale, 1.0)
    c2, c1, c0 = c2 / scale, c1 / scale, c0 / scale
    squared, product = c1 * c1, 4 * c2 * c0
    discriminant, _ = safe_divide(squared - product, squared + jnp.abs(product))
    q = -(c1 + jnp.where(c1 < 0, -1.0, 1.0) * safe_sqrt(squared - product)) / 2
    first, first_exists = safe_divide(c0, q)
    second, second_exists = safe_divide(q, c2)
    real = squared >= product
    # c0 = 0 = q happens only at a double root in 0, where the second quotient is the root.
    exist = jnp.stack([real & first_exists, real & second_exists], axis=-1)
    return jnp.stack([first, second], axis=-1), exist, discriminant


def bisect(
    holds: Callable[[Array], Array],
    inside: Float[Array, "..."],
    outside: Float[Array, "..."],
    halvings: int = TO_ROUNDING,
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Last values at which a condition holds and first ones at which it does not, between two.

    Example:
        >>> import jax.numpy as jnp
        >>> last, _ = bisect(lambda x: x**2 < 2, jnp.array(0.0), jnp.array(2.0))
        >>> round(float(last), 6)
        1.414214
    """

    def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        middle = (ends[0] + ends[1]) / 2
        within = holds(middle)
        return jnp.where(within, middle, ends[0]), jnp.where(within, ends[1], middle)

    return jax.lax.fori_loop(0, halvings, halve, (inside, outside))


def refine_root(
    residual: Callable[[Any, Array], Float[Array, ""]], given: Any, root: Float[Array, ""]
) -> Float[Array, ""]:
    """A root of ``residual(given, root)`` after one more step of Newton's method.

    The step carries the derivatives with respect to what is given, by the theorem of implicit
    functions; there is none where the residual has no slope.

    Example:
        >>> import jax, jax.numpy as jnp
        >>> slope = jax.grad(lambda a: refine_root(lambda a, x: x**2 - a, a, jnp.array(1.414214)))
        >>> round(float(slope(2.0)), 4)  # 1 / (2 √2)
        0.3536
    """
    still, root = jax.lax.stop_gradient((given, root))
    slope = jax.jvp(lambda at: residual(still, at), (root,), (jnp.ones_like(root),))[1]
    return root - safe_divide(residual(given, root), slope)[0]


def optional_float(value: ArrayLike | None) -> Float[Array, "..."] | None:
    """As `as_float`, and nothing of nothing.

    Example:
        >>> optional_float(None) is None, float(optional_float(2))
        (True, 2.0)
    """
    return None if value is None else as_float(value)


def as_float(value: ArrayLike) -> Float[Array, "..."]:
    """An array of a float type: floats keep theirs, Python numbers and integers get the default.

    Example:
        >>> float(as_float(1)), as_float(1).dtype.kind
        (1.0, 'f')
    """
    if isinstance(value, (int, float, np.ndarray)):
        # Each operation of JAX's outside of a program is one that is compiled, as is `asarray`.
        numbers = np.asarray(value)
        is_float = isinstance(value, np.ndarray) and jnp.issubdtype(numbers.dtype, jnp.floating)
        return jax.device_put(numbers if is_float else numbers.astype(jnp.result_type(float)))
    array = jnp.asarray(value)
    if not jnp.issubdtype(array.dtype, jnp.floating):
        return array.astype(jnp.result_type(float))
    return array
