"""Unfolded views against mirror images taken one after the other, in complex numbers."""

from __future__ import annotations

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from designopt.vectors import Vector, rotation
from optics.scene.scene import WORLD, Layout, Surface, place
from optics.visibility.boundary_codes import CUT_AFTER, CUT_BEFORE, FIRST_END, SECOND_END, label_of
from optics.visibility.boundary_codes import parts_of as split_label
from optics.visibility.unfolding import (
    Edges,
    Unfolded,
    cut,
    folds_of,
    left_of,
    padded,
    paths_of,
    unfold,
    unit,
)
from tests.optics.scenes import (
    BOTH,
    LAYOUT,
    LEFT,
    MIRRORS,
    RIGHT,
    SURFACES,
    Case,
    Images,
    item,
    left_by,
    posed_cases,
    random_cases,
    scene_of,
)

ROUNDING = 1e-13
"""Of a few mirror images, relative to the size of the scene."""

WORDS = np.array([(LEFT, BOTH), (BOTH, RIGHT), (RIGHT, LEFT), (LEFT, RIGHT)])


def arrow(number: complex) -> Vector:
    return Vector(jnp.asarray(number.real, float), jnp.asarray(number.imag, float))


def arrows(complex_numbers: list[complex]) -> Vector:
    return Vector(jnp.asarray(np.real(complex_numbers)), jnp.asarray(np.imag(complex_numbers)))


def numbers(place: Vector) -> np.ndarray:
    """Places as complex numbers."""
    return np.asarray(place.x) + 1j * np.asarray(place.y)


@jax.jit
def unfolded(cases: Case) -> tuple[Unfolded, Vector, jax.Array]:
    """All paths of `WORDS` of a batch; where their folds put all surfaces; the unit of length."""

    def one(case: Case, word: jax.Array) -> tuple[Unfolded, Vector, jax.Array]:
        placed = place(scene_of(case), case.angles)
        mirrors = [placed.corners[index] for index in word]
        folds = folds_of(mirrors, [jnp.asarray(True)] * len(mirrors))
        moved = [*(fold.place(placed.corners) for fold in folds), placed.corners]
        ends = jax.tree.map(lambda *legs: jnp.stack(legs), *moved)
        return unfold(LAYOUT, placed, word), ends, placed.size

    return jax.vmap(jax.vmap(one, (None, 0)), (0, None))(cases, jnp.asarray(WORDS))


def in_front(path: Images, places: np.ndarray, order: int) -> np.ndarray:
    """Whether places lie on the side of a mirror's line from which the view comes to it."""
    return left_by(places, path.mirrors[order]) * path.side_of(order) > 0


@pytest.fixture(scope="module")
def paths() -> list[tuple[Images, Unfolded, np.ndarray]]:
    """Many scenes and all of `WORDS`: by mirror images, from the library, and all ends folded."""
    cases = random_cases(4, 16)
    found = jax.tree.map(np.asarray, unfolded(cases))
    results = []
    for i, case in enumerate(posed_cases(cases)):
        for j, word in enumerate(WORDS):
            path, moved, size = item(found, (i, j))
            # As the placed scene: relative to the camera in the reference pose.
            origin = cases.position[i] @ [1, 1j]
            ends, camera = case.complex_ends - origin, case.complex_position - origin
            wanted = Images(ends / size, camera / size, word.tolist())
            results.append((wanted, path, numbers(moved)))
    return results


def test_folds_mirror_places_in_the_mirrors_that_follow(paths):
    for wanted, path, moved in paths:
        for leg in range(3):
            folded = wanted.behind(wanted.ends, leg)
            np.testing.assert_allclose(moved[leg], folded, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(numbers(path.source), wanted.sources[-1], atol=ROUNDING)
        # Mirrors are turned away by the side that reflects.
        for i, mirror in enumerate(wanted.word):
            assert path.turned_away[i] == (LAYOUT.sides[mirror] == -wanted.side_of(i))


def parts_of(edges: Edges, whole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where parts of segments begin and end on them, 0 … 1."""
    step = whole[..., 1] - whole[..., 0]
    at = np.real((numbers(edges.ends) - whole[..., :1]) / step[..., None])
    return at[..., 0], at[..., 1]


SAMPLES = (np.arange(199) + 0.5) / 199


def assert_parts(edges: Edges, whole: np.ndarray, front: np.ndarray) -> None:
    """The parts of folded segments that are left are those where samples lie in front."""
    start, end = (np.where(edges.active, at, 0)[..., None] for at in parts_of(edges, whole))
    np.testing.assert_array_equal((start < SAMPLES) & (end > SAMPLES), front)


def samples_of(ends: np.ndarray) -> np.ndarray:
    return ends[..., :1] + (ends[..., 1:] - ends[..., :1]) * SAMPLES


def test_blockers_are_left_where_they_stand_before_the_next_and_behind_the_last_mirror(paths):
    kept = 0
    for wanted, path, moved in paths:
        samples = samples_of(wanted.ends)
        for leg in range(3):
            front = np.ones(samples.shape, bool)
            for mirror in (leg - 1, leg):
                if 0 <= mirror < 2:
                    front &= in_front(wanted, samples, mirror)
                    front[wanted.word[mirror]] = False  # it is the end of the leg
            left = np.sign(left_by(wanted.sources[leg], wanted.ends.T))
            front[LAYOUT.one_way & (left != LAYOUT.sides)] = False
            assert_parts(item(path.blockers, leg), moved[leg], front)
            kept += front.sum()
    assert kept > 0


def test_mirrors_are_left_where_they_stand_in_front_of_each_other(paths):
    for wanted, path, moved in paths:
        for i, other in ((0, 1), (1, 0)):
            front = in_front(wanted, samples_of(wanted.mirrors[i]), other)
            assert_parts(item(path.mirrors, i), moved[i + 1][wanted.word[i]], front)


def test_labels_say_which_surface_bounds_and_whether_it_is_cut(paths):
    whole = [label_of(leg, np.arange(SURFACES), 0) for leg in range(3)]
    cuts = [[CUT_AFTER], [CUT_BEFORE, CUT_AFTER], [CUT_BEFORE]]
    for _, path, moved in paths:
        for end, (at, own) in enumerate(
            zip(parts_of(path.blockers, moved), (FIRST_END, SECOND_END), strict=True)
        ):
            kinds = path.blockers.labels[..., end] - whole
            is_cut = np.abs(at - end) > ROUNDING
            for leg in range(3):
                active = path.blockers.active[leg]
                np.testing.assert_array_equal(kinds[leg][active & ~is_cut[leg]], own)
                assert np.isin(kinds[leg][active & is_cut[leg]], cuts[leg]).all()


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
            leg, surface, _ = split_label(int(label))
            same = path.blockers.labels[leg, surface] == label
            assert same.any()
            places = numbers(path.blockers.ends)[leg, surface][same]
            np.testing.assert_allclose(places, end, atol=100 * ROUNDING)
    assert hidden > 10


def test_a_pad_hides_itself_on_earlier_legs_only(paths):
    _, path, _ = paths[0]
    everything = eqx.tree_at(lambda p: p.blockers.active, path, np.ones((3, SURFACES), bool))
    hides = np.asarray(everything.in_the_way(jnp.asarray(MIRRORS)))
    assert np.argwhere(~hides).tolist() == [[2, MIRRORS]]


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


cut_of = jax.jit(
    lambda edges, side: cut(edges, arrows([0, 0.6 + 0.8j]), side, jnp.asarray(3)),
)
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


@pytest.mark.parametrize("size", [1e-150, 1e-20, 1.0, 1e150])
def test_unit_vectors_of_all_lengths_that_can_be_squared(size):
    np.testing.assert_allclose(numbers(unit(arrow((3 - 4j) * size))), 0.6 - 0.8j, rtol=ROUNDING)


def test_the_zero_vector_has_no_direction_and_a_finite_derivative():
    def total(place: Vector) -> jax.Array:
        found = unit(place)
        return found.x + found.y

    assert numbers(unit(arrow(0))) == 0
    assert np.isfinite(numbers(jax.grad(total)(arrow(0)))).all()


def test_what_lies_on_a_line_is_left_of_it_by_nothing():
    turns = rotation(jnp.linspace(0, 6, 50))
    start, along = turns.scaled(jnp.asarray(3.0)), turns.scaled(jnp.asarray(0.7))
    on = start + along.scaled(jnp.asarray(2.5))
    np.testing.assert_array_equal(left_of(on, start, along), 0)
    off = on + along.perpendicular().scaled(jnp.asarray(1e-13))
    np.testing.assert_allclose(left_of(off, start, along), 0.49e-13, rtol=0.02)
