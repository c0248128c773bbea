"""Shapes of bodies against the law of cosines, and what lengths cannot be."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.io.shapes import ImpossibleShapeError, body_shape, body_steps

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


def test_without_lengths_a_body_is_as_sketched():
    shape = body_shape(SKETCH, "ABCD", {})
    for (i, a), (j, b) in itertools.combinations(enumerate("ABCD"), 2):
        assert math.dist(shape[i], shape[j]) == pytest.approx(math.dist(SKETCH[a], SKETCH[b]))
    assert shape[0].tolist() == [0, 0]
    assert shape[1, 1] == 0


def test_a_bar_has_exactly_its_length():
    assert body_shape(SKETCH, "AB", {("B", "A"): 40.1}).tolist() == [[0, 0], [40.1, 0]]


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


def test_open_distances_are_the_sketchs():
    shape = body_shape(SKETCH, "ABC", {("A", "B"): 11.0})
    assert math.dist(shape[0], shape[2]) == pytest.approx(math.dist(SKETCH["A"], SKETCH["C"]))
    assert math.dist(shape[1], shape[2]) == pytest.approx(math.dist(SKETCH["B"], SKETCH["C"]))


def test_joints_in_one_line_stay_in_it():
    shape = body_shape(SKETCH, "ABE", {("A", "B"): 30.0, ("B", "E"): 12.0})
    np.testing.assert_allclose(shape, [[0, 0], [30, 0], [18, 0]], atol=1e-14)
    beyond = {"A": (0.0, 0.0), "B": (1.0, 0.0), "C": (-2.0, 0.0)}
    shape = body_shape(beyond, "ABC", {("A", "C"): 5.0})
    np.testing.assert_allclose(shape, [[0, 0], [1, 0], [-5, 0]], atol=1e-14)


def test_joints_in_one_place_stay_together():
    sketch = SKETCH | {"Z": SKETCH["A"]}
    shape = body_shape(sketch, "ABZ", {("A", "B"): 40.0})
    assert shape[2].tolist() == [0, 0]


def test_a_frame_without_any_two_lengths_to_start_from_is_found():
    """Nine lengths of a prism: every joint has three, none has two to joints that are placed."""
    true = {name: (1.1 * x + 0.2 * y, 0.95 * y) for name, (x, y) in SKETCH.items()}
    pairs = ["AB", "BC", "CA", "DE", "EF", "FD", "AD", "BE", "CF"]
    lengths = {(a, b): math.dist(true[a], true[b]) for a, b in pairs}
    shape = dict(zip("ABCDEF", body_shape(SKETCH, "ABCDEF", lengths), strict=True))
    for pair, length in lengths.items():
        assert math.dist(shape[pair[0]], shape[pair[1]]) == pytest.approx(length, rel=1e-9)


def test_a_body_far_from_the_origin_is_the_same():
    far = {name: (x + 2.0**27, y - 2.0**27) for name, (x, y) in SKETCH.items()}
    lengths = {("A", "B"): 11.0, ("A", "C"): 7.0}
    near, away = (body_shape(sketch, "ABCD", lengths) for sketch in (SKETCH, far))
    np.testing.assert_allclose(near, away, rtol=1e-14, atol=1e-14)


def test_a_fixed_body_keeps_its_first_joint_and_direction():
    steps = body_steps(SKETCH, "ABC", {("A", "B"): 20.0, ("B", "C"): 15.0})
    assert steps["A"].tolist() == [0, 0]
    np.testing.assert_allclose(steps["B"], 20 * np.array([10, 1]) / math.hypot(10, 1))


@pytest.mark.parametrize(
    ("joints", "lengths", "words"),
    [
        ("AZ", {}, ["A and Z coincide", "no direction", "move one"]),
        ("AZ", {("A", "Z"): 3.0}, ["A-Z = 3", "coincide in the sketch", "move one"]),
        ("ABZ", {("A", "B"): 9.0, ("A", "Z"): 3.0}, ["A-Z = 3", "coincide in the sketch"]),
        (
            "ABC",
            {("A", "B"): 100.0},
            ["A-B = 100", "A-C = 7.2111 (as sketched)", "no triangle", "change one"],
        ),
        (
            "ABE",
            {("A", "B"): 10.0, ("A", "E"): 6.0, ("B", "E"): 6.0},
            ["A, B, E in one line", "make a triangle", "move E"],
        ),
        (
            "ABCD",
            lengths_of(SKETCH, "ABCD") | {("C", "D"): 12.0},
            ["C-D = 12", "contradicts", "11.1803", "leave one"],
        ),
    ],
)
def test_impossible_lengths_are_told(joints, lengths, words):
    with pytest.raises(ImpossibleShapeError) as raised:
        body_shape(SKETCH | {"Z": SKETCH["A"]}, joints, lengths)
    for word in words:
        assert word in str(raised.value)
