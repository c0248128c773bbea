"""Intervals against dense sampling, in fractions of a power of two: all comparisons are exact."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from optics.visibility.intervals import (
    Interval,
    common_part,
    gaps,
    measure_of_union,
    where_positive,
)

ROUNDING = 1e-15
"""Of a quotient between 0 and 1."""

CONDITIONS, SHADOWS = 4, 5
LABELS = np.arange(10, 10 + CONDITIONS)
STEP = 1 / 16
"""Of the ends of shadows and windows. The best point lies midway between two of them."""

positive = jax.jit(where_positive)


@jax.jit
def part_of(first: jax.Array, last: jax.Array) -> Interval:
    """Where linear functions are all positive."""
    labels = jnp.asarray(LABELS)
    return common_part(Interval(*where_positive(first, last), labels, labels))


gaps_of = jax.jit(gaps)

values = arrays(np.int64, CONDITIONS, elements=st.integers(-5, 5))
places = arrays(np.int64, SHADOWS, elements=st.integers(-24, 40))
lengths = arrays(np.int64, SHADOWS, elements=st.integers(1, 40))
flags = arrays(np.bool_, SHADOWS)
window_ends = st.tuples(st.integers(-24, 40), st.integers(-24, 40))


def line(first: np.ndarray, last: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Values of linear functions at places, shape (places, functions)."""
    return first + np.multiply.outer(where, last - first)


@given(values, values)
def test_where_linear_functions_are_positive(first, last):
    starts, ends = (
        np.asarray(leaf) for leaf in positive(jnp.asarray(first, float), jnp.asarray(last, float))
    )
    assert ((starts >= 0) & (ends <= 1)).all()
    # No root lies on a sample inside 0 … 1: numerators and denominators are at most 10.
    samples = (np.arange(997) + 0.5) / 997
    inside = (starts < samples[:, None]) & (samples[:, None] < ends)
    np.testing.assert_array_equal(inside, line(first, last, samples) > 0)


@given(values, values)
def test_common_part_is_where_all_are_positive(first, last):
    found = part_of(jnp.asarray(first, float), jnp.asarray(last, float))
    samples = (np.arange(997) + 0.5) / 997
    inside = (found.start < samples) & (samples < found.end)
    np.testing.assert_array_equal(inside, (line(first, last, samples) > 0).all(axis=1))


@given(values, values)
def test_labels_of_a_common_part_name_what_bounds_it(first, last):
    found = part_of(jnp.asarray(first, float), jnp.asarray(last, float))
    if found.start >= found.end:
        return
    for place, limit, label in (
        (found.start, 0, found.start_label),
        (found.end, 1, found.end_label),
    ):
        i = int(label) - LABELS[0]
        if place == limit:
            assert i == CONDITIONS - 1  # none of them sets this end
        else:
            assert abs(line(first[i], last[i], np.asarray(place))) <= 10 * ROUNDING


def test_an_end_is_exact_however_small_its_function():
    first, last = jnp.array([-1e-300, 3.0]), jnp.array([3e-300, 3.0])
    start, end = positive(first * 1e200, last * 1e200)
    np.testing.assert_allclose(start, [0.25, 0], rtol=ROUNDING)
    np.testing.assert_array_equal(end, 1)


def candidates(places, lengths, active, window) -> tuple[Interval, np.ndarray, np.ndarray]:
    """Of a window between shadows, in units of `STEP`; the labels are 10 times an index."""
    starts, ends = places * STEP, (places + lengths) * STEP
    first, last = (jnp.asarray(end * STEP) for end in window)
    index = jnp.arange(SHADOWS) + 1
    found = gaps_of(
        Interval(first, last, jnp.asarray(1), jnp.asarray(2)),
        Interval(jnp.asarray(starts), jnp.asarray(ends), 10 * index, 10 * index + 1),
        jnp.asarray(active),
    )
    return jax.tree.map(np.asarray, found), starts, ends


@given(places, lengths, flags, window_ends)
def test_gaps_are_what_no_shadow_covers(places, lengths, active, window):
    found, starts, ends = candidates(places, lengths, active, window)
    samples = (np.arange(-64, 128) + 0.5) * STEP
    column = samples[:, None]
    hidden = ((starts < column) & (column < ends))[:, active].any(axis=1)
    free = (window[0] * STEP < samples) & (samples < window[1] * STEP) & ~hidden
    times = ((found.start < column) & (column < found.end)).sum(axis=1)
    np.testing.assert_array_equal(times, free)


@given(places, lengths, flags, window_ends)
def test_labels_of_gaps_name_what_bounds_them(places, lengths, active, window):
    found, starts, ends = candidates(places, lengths, active, window)
    at_label = {1: window[0] * STEP, 2: window[1] * STEP}
    for i in np.flatnonzero(active):
        at_label |= {10 * (i + 1): starts[i], 10 * (i + 1) + 1: ends[i]}
    for i in np.flatnonzero(found.start < found.end):
        assert found.start[i] == at_label[int(found.start_label[i])]
        assert found.end[i] == at_label[int(found.end_label[i])]
        # A gap begins where a shadow ends and ends where one begins.
        assert found.start_label[i] % 10 == 1
        assert found.end_label[i] % 10 in (0, 2)


@given(places, lengths, flags, window_ends)
def test_the_longest_candidate_is_twice_the_distance_of_the_best_point(
    places, lengths, active, window
):
    found, starts, ends = candidates(places, lengths, active, window)
    samples = np.arange(-160, 320)[:, None] * STEP / 2
    outside = np.maximum(starts - samples, samples - ends)[:, active]
    inside = np.minimum(samples - window[0] * STEP, window[1] * STEP - samples)
    distance = np.concatenate([outside, inside], axis=1).min(axis=1)
    assert (found.end - found.start).max() == 2 * distance.max()


@given(places, lengths)
def test_a_union_is_as_long_as_its_samples(places, lengths):
    order = np.argsort(places, kind="stable")
    starts = np.clip(places[order] / 64, 0, 1)
    ends = np.clip((places + np.abs(lengths))[order] / 64, 0, 1)
    # Intervals of no length follow those of some.
    last = np.argsort(ends <= starts, kind="stable")
    starts, ends = starts[last], ends[last]
    samples = (np.arange(64) + 0.5)[:, None] / 64
    covered = ((starts < samples) & (samples < ends)).any(axis=1)
    assert float(measure_of_union(starts, ends)) == covered.mean()


def test_gaps_have_finite_derivatives_where_shadows_coincide():
    def longest(ends):
        shadows = Interval(ends[0], ends[1], jnp.arange(2), jnp.arange(2))
        window = Interval(jnp.array(0.0), jnp.array(1.0), jnp.array(1), jnp.array(2))
        found = gaps(window, shadows, jnp.array([True, True]))
        return jnp.max(found.end - found.start)

    slopes = jax.jit(jax.grad(longest))(jnp.array([[0.2, 0.2], [0.6, 0.6]]))
    assert np.isfinite(slopes).all()
    assert np.sum(slopes) == -1  # the gap begins where a shadow ends
