"""Intervals against dense sampling, in fractions of a power of two: all comparisons are exact."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from optics.visibility.intervals import (
    Interval,
    bounds_of_gap,
    common_part,
    gaps,
    measure_of_union,
    where_positive,
    widest_gap,
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


gaps_of, widest_gap_of = jax.jit(gaps), jax.jit(widest_gap)
bounds_of = jax.jit(jax.vmap(bounds_of_gap, (None, None, None, 0, 0)))

values = arrays(np.int64, CONDITIONS, elements=st.integers(-5, 5))
places = arrays(np.int64, SHADOWS, elements=st.integers(-24, 40))
lengths = arrays(np.int64, SHADOWS, elements=st.integers(1, 40))
flags = arrays(np.bool_, SHADOWS)
window_ends = st.tuples(st.integers(-24, 40), st.integers(-24, 40))


def line(first: np.ndarray, last: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Values of linear functions at places, shape (places, functions)."""
    return first + np.multiply.outer(where, last - first)


@given(values, values)
def test_common_part_is_where_all_are_positive(first, last):
    found = part_of(jnp.asarray(first, float), jnp.asarray(last, float))
    samples = (np.arange(997) + 0.5) / 997
    inside = (found.start < samples) & (samples < found.end)
    np.testing.assert_array_equal(inside, (line(first, last, samples) > 0).all(axis=1))


def test_an_end_is_exact_however_small_its_function():
    first, last = jnp.array([-1e-300, 3.0]), jnp.array([3e-300, 3.0])
    start, end = positive(first * 1e200, last * 1e200)
    np.testing.assert_allclose(start, [0.25, 0], rtol=ROUNDING)
    np.testing.assert_array_equal(end, 1)


def shadows_of(starts, ends, active, window):
    """A window and shadows, numbered; the window's number is the last one, −1."""
    numbers, (first, last) = jnp.arange(SHADOWS), (jnp.asarray(end * STEP) for end in window)
    shadows = Interval(jnp.asarray(starts), jnp.asarray(ends), numbers, numbers)
    return Interval(first, last, jnp.array(-1), jnp.array(-1)), shadows, jnp.asarray(active)


def free_samples(starts, ends, active, window):
    """Samples, and which of them lie in a window and in no active shadow."""
    samples = (np.arange(-64, 128) + 0.5) * STEP
    column = samples[:, None]
    hidden = ((starts < column) & (column < ends))[:, active].any(axis=1)
    return samples, (window[0] * STEP < samples) & (samples < window[1] * STEP) & ~hidden


@given(places, lengths, flags, window_ends)
def test_gaps_are_what_no_shadow_covers(places, lengths, active, window):
    starts, ends = places * STEP, (places + lengths) * STEP
    samples, free = free_samples(starts, ends, active, window)
    given = shadows_of(starts, ends, active, window)
    first, last = map(np.asarray, gaps_of(*given))
    column = samples[:, None]
    times = ((first < column) & (column < last)).sum(axis=1)
    np.testing.assert_array_equal(times, free)
    # What they start and end at has the labels.
    before, after = map(np.asarray, bounds_of(*given, first, last))
    there = first < last
    np.testing.assert_array_equal(first[there], np.append(ends, window[0] * STEP)[before[there]])
    np.testing.assert_array_equal(last[there], np.append(starts, window[1] * STEP)[after[there]])


@given(places, lengths, flags, window_ends)
def test_the_widest_gap_is_the_longest_run_of_free_samples(places, lengths, active, window):
    # A shadow of no length hides no sample, but parts what is on both sides of it.
    active = active & (lengths > 0)
    starts, ends = places * STEP, (places + lengths) * STEP
    _, free = free_samples(starts, ends, active, window)
    widest = widest_gap_of(*shadows_of(starts, ends, active, window))
    runs = "".join("01"[int(there)] for there in free).split("0")
    longest = max(map(len, runs))
    assert round(max(float(widest.end - widest.start), 0.0) / STEP) == longest
    if longest:
        # What it starts and ends at has the labels.
        assert widest.start == np.append(ends, window[0] * STEP)[widest.start_label]
        assert widest.end == np.append(starts, window[1] * STEP)[widest.end_label]


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
        first, last = gaps(window, shadows, jnp.array([True, True]))
        return jnp.max(last - first)

    slopes = jax.jit(jax.grad(longest))(jnp.array([[0.2, 0.2], [0.6, 0.6]]))
    assert np.isfinite(slopes).all()
    assert np.sum(slopes) == -1  # the gap begins where a shadow ends
