"""Intervals on a line: where linear functions are positive, and what is left between shadows."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_divide

FAR = 64.0
"""Beyond every pad coordinate and every angle."""


class Interval(eqx.Module):
    """An interval and what bounds it; empty unless ``start < end``.

    Attributes:
        start: its lower end.
        end: its upper end.
        start_label: a number that says what bounds it there.
        end_label: the same for its upper end.
    """

    start: Float[Array, "*batch"]
    end: Float[Array, "*batch"]
    start_label: Int[Array, "*batch"]
    end_label: Int[Array, "*batch"]


def where_positive(
    at_start: Float[Array, "*batch"], at_end: Float[Array, "*batch"]
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Part of 0 … 1 in which a linear function is positive, from its values at 0 and at 1.

    The root at_start / (at_start − at_end) is a quotient of numbers of opposite sign, so nothing
    cancels. Returns (1, 0), an empty interval, where the function is nowhere positive.
    """
    root, _ = safe_divide(at_start, at_start - at_end)
    below, above = at_start > 0, at_end > 0
    start = jnp.where(below, 0.0, jnp.where(above, root, 1.0))
    end = jnp.where(above, 1.0, jnp.where(below, root, 0.0))
    return start, end


def common_part(
    at_start: Float[Array, "conditions ..."],
    at_end: Float[Array, "conditions ..."],
    labels: Int[Array, "conditions ..."],
    whole: tuple[int, int],
) -> Interval:
    """Part of 0 … 1 in which several linear functions are all positive.

    Args:
        at_start: the functions' values at 0.
        at_end: their values at 1.
        labels: one per function, for the ends that it sets.
        whole: the labels of a start and of an end that none of them sets.
    """
    starts, ends = where_positive(at_start, at_end)
    first, last = jnp.argmax(starts, axis=0), jnp.argmin(ends, axis=0)
    start, end = jnp.max(starts, axis=0), jnp.min(ends, axis=0)
    at_first = jnp.take_along_axis(labels, first[None], axis=0)[0]
    at_last = jnp.take_along_axis(labels, last[None], axis=0)[0]
    return Interval(
        start, end, jnp.where(start > 0, at_first, whole[0]), jnp.where(end < 1, at_last, whole[1])
    )


def gaps(window: Interval, shadows: Interval, active: Bool[Array, " shadows"]) -> Interval:
    """What is left of a window between shadows that may overlap.

    A point x lies right of the middle of some shadows and left of the middle of the others. It is
    farthest from all shadows if it lies midway between the last end of the former and the first
    start of the latter, so the shadows, ordered by their middles, give one candidate after each of
    them and one before all: those of positive length are the gaps, and the longest candidate, even
    if its length is negative, is twice the distance of the best point from the nearest shadow.

    Args:
        window: a single interval.
        shadows: the shadows, at least one.
        active: which of them count.

    Returns:
        The candidates, shape (1 + shadows,), in no particular order; of inactive shadows reversed
        and very long.
    """
    middle = jnp.where(active, shadows.start + shadows.end, -FAR)
    order = jnp.arange(middle.shape[0])
    # Row i: which shadows lie left of the candidate after shadow i; ties are broken by index.
    before = (middle[None] == middle[:, None]) & (order[None] <= order[:, None])
    left = (middle[None] < middle[:, None]) | before
    left = jnp.concatenate([jnp.zeros_like(left[:1]), left])
    starts = jnp.where(left & active[None], shadows.end[None], -FAR)
    ends = jnp.where(~left & active[None], shadows.start[None], FAR)
    start, end = jnp.max(starts, axis=1), jnp.min(ends, axis=1)
    start_label = shadows.end_label[jnp.argmax(starts, axis=1)]
    end_label = shadows.start_label[jnp.argmin(ends, axis=1)]
    counts = jnp.concatenate([jnp.ones_like(active[:1]), active])
    return Interval(
        jnp.where(counts, jnp.maximum(start, window.start), FAR),
        jnp.where(counts, jnp.minimum(end, window.end), -FAR),
        jnp.where(start > window.start, start_label, window.start_label),
        jnp.where(end < window.end, end_label, window.end_label),
    )
