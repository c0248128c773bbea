"""Angles that people give to a renderer: refused where they cannot be radians."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from designopt.errors import UserError

MOST = 2 * math.pi * (1 + 1e-9)
"""Every pose and direction there is lies within a turn to either side; degrees seldom do."""


def checked_numbers(
    values: object, shape: tuple[int | str, ...], *, what: str, cure: str
) -> Float[np.ndarray, "..."]:
    """Finite numbers in an array of some shape.

    Args:
        values: anything.
        shape: lengths of the axes; a name for one that may be anything.
        what: they are, for the message.
        cure: what to give, for the message.

    Raises:
        UserError: they are none, or not as many.

    Returns:
        Them, floats of the type that they had.
    """
    try:
        numbers = np.asarray(values)
    except (TypeError, ValueError):
        numbers = np.asarray(None)
    if numbers.dtype.kind not in "fiu":
        raise UserError(f"{what} are numbers, not {type(values).__name__}; {cure}")
    if numbers.dtype.kind != "f":
        numbers = numbers.astype(np.float64)
    fits = len(shape) == numbers.ndim and all(
        isinstance(one, str) or one == length
        for one, length in zip(shape, numbers.shape, strict=True)
    )
    if not fits:
        wanted = f"({', '.join(map(str, shape))})"
        raise UserError(f"{what} have the shape {wanted}, not {numbers.shape}; {cure}")
    if not np.isfinite(numbers).all():
        raise UserError(f"{what} have values that are not finite; {cure}")
    return numbers


def checked_angles(
    values: object, shape: tuple[int | str, ...], *, what: str, cure: str
) -> Float[np.ndarray, "..."]:
    """Angles in radians, at most a turn to either side.

    Args:
        values: anything.
        shape: as in `checked_numbers`.
        what: they are, for the message.
        cure: what to give, for the message.

    Raises:
        UserError: they are no finite numbers, not as many, or larger.
    """
    angles = checked_numbers(values, shape, what=what, cure=cure)
    if angles.size and np.abs(angles).max() > MOST:
        worst = angles.flat[np.abs(angles).argmax()]
        raise UserError(
            f"{what} are in radians, at most a turn to either side, and {worst:g} is more; did you "
            f"mean numpy.deg2rad({worst:g})?"
        )
    return angles
