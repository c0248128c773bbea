"""Intervals on a line: where linear functions are positive, and what is left between shadows."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_divide

FAR = 64.0
"""Beyond every pad coordinate and every angle."""


class Interval(eqx.Module):
    """An interval and what bounds it; empty unless ``start < end``.

    Attributes:
        start: its lower end.
        end: its upper end.
        start_label: code of what bounds it there.
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


def common_part(parts: Interval) -> Interval:
    """What several intervals along a first axis have in common; of equal ends the last one's label.

    Labels are taken to rise along that axis.
    """
    start, end = jnp.max(parts.start, axis=0), jnp.min(parts.end, axis=0)
    return Interval(
        start,
        end,
        _label_at(parts.start == start[None], parts.start_label, 0),
        _label_at(parts.end == end[None], parts.end_label, 0),
    )


def hull(
    parts: Interval, active: Bool[Array, "*batch parts"]
) -> tuple[Interval, Bool[Array, "*batch"]]:
    """The interval from the first start to the last end of those that count, along a last axis.

    And whether any counts.
    """
    start = jnp.where(active, parts.start, FAR)
    end = jnp.where(active, parts.end, -FAR)
    first, last = jnp.min(start, axis=-1), jnp.max(end, axis=-1)
    return Interval(
        first,
        last,
        _label_at(start == first[..., None], parts.start_label, -1),
        _label_at(end == last[..., None], parts.end_label, -1),
    ), jnp.any(active, axis=-1)


def gaps(
    window: Interval, shadows: Interval, active: Bool[Array, " shadows"]
) -> tuple[Float[Array, " candidates"], Float[Array, " candidates"]]:
    """What is left of a window between shadows that may overlap.

    A point x lies right of the middle of some shadows and left of the middle of the others. It is
    farthest from all shadows if it lies midway between the last end of the former and the first
    start of the latter, so the shadows, ordered by their middles, give one candidate before all of
    them and one after each: those of positive length are the gaps, and the longest candidate, even
    if its length is negative, is twice the distance of the best point from the nearest shadow.

    Args:
        window: a single interval.
        shadows: the shadows, at least one.
        active: which of them count.

    Returns:
        Starts and ends of the candidates, of which there is one more than shadows, in no particular
        order; of inactive shadows reversed and very long. What bounds gaps `bounds_of_gap` finds.
    """
    middles = _middles(shadows, active)
    after = jax.vmap(partial(_gap_after, window, shadows, active))
    found = after(jnp.arange(middles.size), middles)
    return found.start, found.end


def bounds_of_gap(
    window: Interval,
    shadows: Interval,
    active: Bool[Array, " shadows"],
    start: Float[Array, ""],
    end: Float[Array, ""],
) -> tuple[Int[Array, ""], Int[Array, ""]]:
    """Labels of what bounds one of the `gaps` of positive length.

    Start and end are the very numbers that `gaps` returns, and shadows that count have some length:
    then none beyond the gap ends where it starts, so that all can be asked alike. Candidates are
    many, and gaps few: looking up the labels of all takes longer than finding them.
    """
    before = _label_at(active & (shadows.end == start), shadows.end_label, 0)
    after = _label_at(active & (shadows.start == end), shadows.start_label, 0)
    return (
        jnp.where(start > window.start, before, window.start_label),
        jnp.where(end < window.end, after, window.end_label),
    )


def widest_gap(window: Interval, shadows: Interval, active: Bool[Array, " shadows"]) -> Interval:
    """The longest of the candidates for `gaps`, whose length may be negative."""
    start, end = gaps(window, shadows, active)
    best = jnp.argmax(end - start)
    # Found once more with its labels, of which a compiler then computes no others.
    return _gap_after(window, shadows, active, best, _middles(shadows, active)[best])


def _middles(shadows: Interval, active: Bool[Array, " shadows"]) -> Float[Array, " candidates"]:
    """Twice the middles of the shadows, −FAR of inactive ones; before them what precedes all."""
    return jnp.append(-2 * FAR, jnp.where(active, shadows.start + shadows.end, -FAR))


def _gap_after(
    window: Interval,
    shadows: Interval,
    active: Bool[Array, " shadows"],
    number: Int[Array, ""],
    middle: Float[Array, ""],
) -> Interval:
    """The candidate after one of the `_middles`, which is given besides its number.

    Looking up all of them would be slower.
    """
    middles = _middles(shadows, active)[1:]
    # All shadows against all: there are few, and without a sort no step waits for another. Ties are
    # broken by index.
    before = (middles == middle) & (jnp.arange(middles.size) < number)
    left = (middles < middle) | before
    starts = jnp.where(left & active, shadows.end, -FAR)
    ends = jnp.where(~left & active, shadows.start, FAR)
    start, end = jnp.max(starts), jnp.min(ends)
    counts = middle != -FAR
    return Interval(
        jnp.where(counts, jnp.maximum(start, window.start), FAR),
        jnp.where(counts, jnp.minimum(end, window.end), -FAR),
        jnp.where(
            start > window.start,
            _label_at(starts == start, shadows.end_label, 0),
            window.start_label,
        ),
        jnp.where(
            end < window.end, _label_at(ends == end, shadows.start_label, 0), window.end_label
        ),
    )


def _label_at(
    bounds: Bool[Array, "..."], labels: Int[Array, "..."], axis: int
) -> Int[Array, "..."]:
    """The label of what bounds; of several at one place the largest.

    A maximum is several times as fast as looking up the label by `jnp.argmax`.
    """
    return jnp.max(jnp.where(bounds, labels, jnp.iinfo(labels.dtype).min), axis=axis)


def measure_of_union(
    start: Float[Array | np.ndarray, "*batch intervals"],
    end: Float[Array | np.ndarray, "*batch intervals"],
) -> Float[Array, "*batch"]:
    """Length of what intervals within 0 … 1 cover together, if no end comes before its start.

    Intervals of some length are in the order in which they begin; those of none may follow.
    """
    # An interval counts from where all that begin before it have ended.
    order = jnp.arange(start.shape[-1])
    earlier = (order[:, None] > order[None]).reshape((1,) * (end.ndim - 1) + (-1, order.size))
    begin = jnp.maximum(start, jnp.max(jnp.where(earlier, end[..., None, :], 0.0), axis=-1))
    return jnp.sum(jnp.where(end > begin, end - begin, 0.0), axis=-1)


def union(parts: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """The union of intervals as intervals that do not meet, in order."""
    joined: list[tuple[float, float]] = []
    for start, end in sorted(parts):
        if joined and start <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], end))
        else:
            joined.append((start, end))
    return joined
