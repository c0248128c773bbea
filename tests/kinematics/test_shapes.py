"""Shapes of bodies against the law of cosines."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.io.shapes import ImpossibleShapeError, body_shape

PLACES = [(0.0, 0.0), (10.0, 1.0), (4.0, 6.0), (6.0, -5.0), (5.0, 0.5), (12.0, 4.0)]
SKETCH = dict(zip("ABCDEF", PLACES, strict=True))


def lengths_of(sketch, joints, factor=1.0):
    return {
        pair: factor * math.dist(sketch[pair[0]], sketch[pair[1]])
        for pair in itertools.combinations(joints, 2)
    }


def side(shape, a, b, c):
    (ax, ay), (bx, by), (cx, cy) = shape[a], shape[b], shape[c]
    return np.sign((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


@given(st.floats(0.75, 1.3), st.floats(0.75, 1.3), st.floats(0.75, 1.3), st.sampled_from([1, -1]))
def test_a_triangle_obeys_the_law_of_cosines_on_the_sketched_side(p, q, r, mirrored):
    sketch = {name: (x, mirrored * y) for name, (x, y) in SKETCH.items()}
    drawn = lengths_of(sketch, "ABC")
    a, b, c = drawn["B", "C"] * p, drawn["A", "C"] * q, drawn["A", "B"] * r
    cosine = (b * b + c * c - a * a) / (2 * b * c)
    given_lengths = {("A", "B"): c, ("A", "C"): b, ("C", "B"): a}
    if abs(cosine) > 1:
        with pytest.raises(ImpossibleShapeError, match="make no triangle"):
            body_shape(sketch, "ABC", given_lengths)
        return
    sine = mirrored * math.sqrt(1 - cosine * cosine)
    wanted = [[0, 0], [c, 0], [b * cosine, b * sine]]
    np.testing.assert_allclose(body_shape(sketch, "ABC", given_lengths), wanted, atol=1e-6)


@pytest.mark.parametrize("order", ["ABCD", "DBAC", "CADB"])
@pytest.mark.parametrize("left_out", [("A", "B"), ("C", "D")])
def test_any_order_and_any_sufficient_lengths_give_the_same_body(order, left_out):
    """Lengths of another body, a fifth larger and slightly skewed; brute force knows its shape."""
    true = {name: (1.2 * x + 0.1 * y, 1.15 * y) for name, (x, y) in SKETCH.items()}
    lengths = lengths_of(true, "ABCD")
    missing = lengths.pop(left_out)
    shape = dict(zip(order, body_shape(SKETCH, order, lengths), strict=True))
    for pair, length in lengths.items():
        assert math.dist(shape[pair[0]], shape[pair[1]]) == pytest.approx(length, rel=1e-9)
    assert math.dist(shape[left_out[0]], shape[left_out[1]]) == pytest.approx(missing, rel=1e-6)
    assert side(shape, "A", "B", "C") == 1
    assert side(shape, "A", "B", "D") == -1


def test_joints_in_one_line_stay_in_it():
    shape = body_shape(SKETCH, "ABE", {("A", "B"): 30.0, ("B", "E"): 12.0})
    np.testing.assert_allclose(shape, [[0, 0], [30, 0], [18, 0]], atol=1e-14)
    beyond = {"A": (0.0, 0.0), "B": (1.0, 0.0), "C": (-2.0, 0.0)}
    shape = body_shape(beyond, "ABC", {("A", "C"): 5.0})
    np.testing.assert_allclose(shape, [[0, 0], [1, 0], [-5, 0]], atol=1e-14)


def test_a_frame_without_any_two_lengths_to_start_from_is_found():
    """Nine lengths of a prism: every joint has three, none has two to joints that are placed."""
    true = {name: (1.1 * x + 0.2 * y, 0.95 * y) for name, (x, y) in SKETCH.items()}
    pairs = ["AB", "BC", "CA", "DE", "EF", "FD", "AD", "BE", "CF"]
    lengths = {(a, b): math.dist(true[a], true[b]) for a, b in pairs}
    shape = dict(zip("ABCDEF", body_shape(SKETCH, "ABCDEF", lengths), strict=True))
    for pair, length in lengths.items():
        assert math.dist(shape[pair[0]], shape[pair[1]]) == pytest.approx(length, rel=1e-9)
