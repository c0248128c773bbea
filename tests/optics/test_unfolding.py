"""Paths over mirrors, and parts of segments on one side of a line; ties and extreme lengths.

What is seen along unfolded paths is in `test_visibility_random`, what bounds it in
`test_visibility_slopes`.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from designopt.vectors import Vector, rotation
from optics.scene.scene import WORLD, Layout, Surface, place
from optics.visibility.boundary_codes import parts_of
from optics.visibility.unfolding import Edges, Unfolded, cut, left_of, padded, paths_of, unfold
from tests.optics.scenes import BOTH, LAYOUT, LEFT, RIGHT, Case, item, random_cases, scene_of

ROUNDING = 1e-13
"""Of a few operations, relative."""


def arrows(complex_numbers: list[complex]) -> Vector:
    return Vector(jnp.asarray(np.real(complex_numbers)), jnp.asarray(np.imag(complex_numbers)))


def numbers(place: Vector) -> np.ndarray:
    """Places as complex numbers."""
    return np.asarray(place.x) + 1j * np.asarray(place.y)


def test_ends_of_mirrors_stand_where_the_table_of_all_surfaces_says():
    # Of three mirrors the middle one may be hidden by that before it and cut by that after it.
    cases = random_cases(6, 64)
    words = jnp.asarray([(LEFT, BOTH, RIGHT), (BOTH, LEFT, BOTH)])

    @jax.jit
    def path_of(case: Case, word: jax.Array) -> Unfolded:
        return unfold(LAYOUT, place(scene_of(case), case.angles), word)

    found = jax.vmap(jax.vmap(path_of, (None, 0)), (0, None))(cases, words)
    found, hidden = jax.tree.map(np.asarray, found), 0
    for i, j in np.ndindex(64, 2):
        path = item(found, (i, j))
        hidden += not path.mirrors.active[1]
        for label, end in zip(
            path.mirrors.labels.flat, numbers(path.mirrors.ends).flat, strict=True
        ):
            leg, surface, _ = parts_of(int(label))
            same = path.blockers.labels[leg, surface] == label
            assert same.any()
            places = numbers(path.blockers.ends)[leg, surface][same]
            np.testing.assert_allclose(places, end, atol=100 * ROUNDING)
    assert hidden > 10


def layout(mirrors: int, curved: tuple[int, ...] = ()) -> Layout:
    parts = tuple(Surface(f"m{i}", 0) for i in range(mirrors))
    return Layout("test", parts, curved, (), (), (), (), WORLD, 0)


def test_paths_of_straight_mirrors_never_stay_and_of_curved_ones_may():
    for mirrors, bounces in itertools.product(range(4), range(4)):
        found = paths_of(layout(mirrors), bounces)
        counts = [1] + [mirrors * (mirrors - 1) ** (i - 1) for i in range(1, bounces + 1)]
        assert [len(word) for word in found] == np.repeat(range(bounces + 1), counts).tolist()
        assert len(set(found)) == len(found)
        assert all(a != b for word in found for a, b in itertools.pairwise(word))
    found = paths_of(layout(2, (1,)), 2)
    assert found == [(), (0,), (1,), (0, 1), (1, 0), (1, 1)]
    assert padded(found)[:4].tolist() == [[-1, -1], [0, -1], [1, -1], [0, 1]]
    assert padded([()]).shape == (1, 0)


cut_of = jax.jit(lambda edges, side: cut(edges, arrows([0, 0.6 + 0.8j]), side, jnp.asarray(3)))
places = st.tuples(st.integers(-4, 4), st.integers(-4, 4))


@given(places, places, st.sampled_from([1, -1]))
def test_cut_keeps_what_lies_on_one_side(first, last, side):
    # Distances from the line through the origin along (3, 4).
    at_start, at_end = (side * (3 * y - 4 * x) for x, y in (first, last))
    ends = [complex(*first), complex(*last)]
    whole = Edges(arrows(ends), jnp.array([1, 2]), jnp.asarray(True))
    everything = cut_of(whole, jnp.asarray(0.0))
    assert everything.active
    np.testing.assert_array_equal(numbers(everything.ends), ends)
    found = cut_of(whole, jnp.asarray(float(side)))
    assert bool(found.active) == (max(at_start, at_end) > 0)
    if found.active:
        meeting = ends[0]
        if at_start != at_end:
            meeting += (ends[1] - ends[0]) * at_start / (at_start - at_end)
        wanted = [meeting if at_start < 0 else ends[0], meeting if at_end < 0 else ends[1]]
        np.testing.assert_allclose(numbers(found.ends), wanted, atol=ROUNDING)
        labels = [3 if at_start < 0 else 1, 3 if at_end < 0 else 2]
        np.testing.assert_array_equal(found.labels, labels)


def test_what_lies_on_a_line_is_left_of_it_by_nothing():
    turns = rotation(jnp.linspace(0, 6, 50))
    start, along = turns.scaled(jnp.asarray(3.0)), turns.scaled(jnp.asarray(0.7))
    on = start + along.scaled(jnp.asarray(2.5))
    np.testing.assert_array_equal(left_of(on, start, along), 0)
    off = on + along.perpendicular().scaled(jnp.asarray(1e-13))
    np.testing.assert_allclose(left_of(off, start, along), 0.49e-13, rtol=0.02)
