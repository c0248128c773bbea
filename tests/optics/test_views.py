"""Pieces of pads taken together against dense sampling; paths and ends of views in words."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from optics.visibility import boundary_codes as codes
from optics.visibility.boundary_codes import label_of
from optics.visibility.views import Pieces, describe_end, name_paths, path_name
from tests.optics.scenes import BOTH, LAYOUT, LEFT, MIRRORS, PADS, RIGHT, WORDS, made_pieces

ROOM, PATHS = 5, 3
GRAIN = 1 / 32
"""Pieces begin and end at multiples of this, so that all sums are exact."""

SAMPLES = (np.arange(32) + 0.5) * GRAIN
"""As many points as grains: counting them measures exactly."""


def pieces_of(start: np.ndarray, end: np.ndarray, path: np.ndarray) -> Pieces:
    """Pieces in the order in which they begin, absent ones last, of any batch of pads."""
    present = end > start
    order = np.argsort(np.where(present, start, 2), axis=-1, kind="stable")
    present, start, end, path = (
        np.take_along_axis(leaf, order, axis=-1) for leaf in (present, start, end, path)
    )
    start, end, path = (np.where(present, leaf, 0) for leaf in (start, end, path))
    return made_pieces(start, end, path)


summary = jax.jit(
    lambda pieces: (
        pieces.coverage(),
        pieces.redundancy(),
        jnp.stack([pieces.seen(path) for path in range(PATHS)], axis=-1),
        pieces.paths_seeing(jnp.asarray(SAMPLES)),
    )
)

ends = st.lists(st.integers(0, 32), min_size=ROOM, max_size=ROOM)
paths = st.lists(st.integers(0, PATHS - 1), min_size=ROOM, max_size=ROOM)


@given(ends, ends, paths)
def test_pieces_together_are_what_samples_say(first, last, path):
    start, end = GRAIN * np.array([first]), GRAIN * np.array([last])
    coverage, redundancy, seen, times = summary(pieces_of(start, end, np.array([path])))
    inside = (start.T < SAMPLES) & (end.T > SAMPLES)
    np.testing.assert_array_equal(times, [inside.sum(axis=0)])
    assert coverage == inside.any(axis=0).mean()
    assert redundancy == inside.mean(axis=1).sum()
    for i in range(PATHS):
        assert seen[0, i] == inside[np.array(path) == i].mean(axis=1).sum()


def test_paths_are_named_after_their_mirrors():
    assert path_name(LAYOUT, ()) == "direct"
    assert path_name(LAYOUT, [BOTH]) == "mirror:both"
    assert path_name(LAYOUT, (RIGHT, LEFT)) == "mirror:right+left"
    assert name_paths(LAYOUT) == [path_name(LAYOUT, word) for word in WORDS]
    assert name_paths(LAYOUT, 1) == ["direct", "mirror:left", "mirror:both", "mirror:right"]


def test_ends_of_views_in_words():
    for label, words in (
        (codes.FIRST_PAD_END, "end of the pad"),
        (codes.SECOND_PAD_END, "end of the pad"),
        (codes.LEFT_LIMIT, "limit of the field of view"),
        (codes.RIGHT_LIMIT, "limit of the field of view"),
        (codes.LOW_GRAZING, "least grazing angle"),
        (codes.HIGH_GRAZING, "least grazing angle"),
        (codes.FOLD, "fold of the image"),
    ):
        assert describe_end(LAYOUT, label) == words
    named = {0: "mirror 'left'", MIRRORS + 1: "pad 'both'", MIRRORS + PADS + 2: "blocker 'lid'"}
    for kind, words in (
        (codes.FIRST_END, "its end 'from'"),
        (codes.SECOND_END, "its end 'to'"),
        (codes.CROSSING, "where another surface meets it"),
        (codes.CUT_BEFORE, "where it meets the line of a mirror"),
        (codes.CUT_AFTER, "where it meets the line of a mirror"),
        (codes.HORIZON, "where it turns away from the ray"),
    ):
        for leg, (surface, name) in itertools.product((0, 2), named.items()):
            assert describe_end(LAYOUT, label_of(leg, surface, kind)) == f"{name}: {words}"
