from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.chamber import (
    Direction,
    Points,
    compute_displacements,
    estimate_bending_direction,
)
from perception.chamber.directions import Use
from tests.perception.chamber.drawn import HALF, Ellipse, Scene, points_of

NUMBERS = Direction.INITIAL, Direction.UP, Direction.DOWN, Direction.LEFT, Direction.RIGHT
"""The paper's numbers 0 to 4."""

START = np.array(
    [(140, 240), (320, 420), (500, 240), (226, 240), (320, 334), (414, 240), (320, 240)], float
)


def algorithm_1(x: list[float], y: list[float], threshold: float) -> int:
    """Literally, line by line; x and y are displacements."""
    values = [abs(value) for value in x + y]
    largest = max(values)
    if largest < threshold or largest == 0:
        return 0
    index = values.index(largest)
    if index < len(x):
        return 4 if x[index] > 0 else 3
    return 2 if y[index - len(x)] > 0 else 1


def points(moved: object = 0.0, seen: object = True) -> Points:
    return Points(START + np.asarray(moved, float), np.broadcast_to(np.asarray(seen), 7).copy())


MOVES = st.lists(
    st.tuples(*[st.integers(-4, 4) | st.floats(-90, 90, width=16)] * 2), min_size=7, max_size=7
)
SEEN = st.lists(st.booleans(), min_size=6, max_size=6)


@given(MOVES, SEEN, SEEN, st.sampled_from([0.0, 2.0, 30.0]), st.sampled_from(["blue", "all"]))
def test_against_a_literal_transcription(moves, now, before, threshold, use):
    frame, initial = points(moves, [*now, True]), points(0.0, [*before, True])
    moved = frame.xy - initial.xy
    chosen = [*(a and b for a, b in zip(now, before, strict=True)), True]
    yellow = use == "all" and all(chosen[3:6])
    in_x, in_y = ("acdfg", "beg") if yellow else ("acg", "bg")
    numbers = (["abcdefg".index(name) for name in names] for names in (in_x, in_y))
    x, y = (
        [float(moved[number, axis]) for number in own if chosen[number]]
        for axis, own in enumerate(numbers)
    )
    expected = NUMBERS[algorithm_1(x, y, threshold)]
    assert estimate_bending_direction(frame, initial, threshold=threshold, use=use) is expected


MOVED = {"RIGHT": [(3, 1), (2, -2)], "LEFT": [(-3, 1), (-2, 2)], "DOWN": [(1, 3)], "UP": [(1, -3)]}


@pytest.mark.parametrize("use", ["blue", "all", "centre"])
@pytest.mark.parametrize("name", MOVED)
def test_directions_and_ties(name: str, use: Use):
    for move in MOVED[name]:
        assert estimate_bending_direction(points(move), points(), use=use) is Direction[name]
    assert estimate_bending_direction(points(), points(), use=use) is Direction.INITIAL


def test_only_less_than_the_threshold_is_initial():
    for move, threshold, direction in (
        (2, 2.0, Direction.RIGHT),
        (2, 2.01, Direction.INITIAL),
        (1e-9, 0.0, Direction.RIGHT),
    ):
        found = estimate_bending_direction(points((move, 0)), points(), threshold=threshold)
        assert found is direction


@pytest.mark.parametrize("use", ["blue", "all", "centre"])
def test_undefined_without_a_chamber(use: Use):
    nothing = points(seen=False)
    assert estimate_bending_direction(nothing, points(), use=use) is Direction.UNDEFINED
    assert estimate_bending_direction(points((5, 0)), nothing, use=use) is Direction.UNDEFINED


def test_displacements_of_what_both_frames_show():
    seen = np.array([True, False, True, True, True, True, True])
    moved = compute_displacements(points((2, -3), seen), points())
    assert moved.tolist() == [[2, -3], [0, 0], *[[2, -3]] * 5]


def points_in(scene: Scene, seed: int) -> Points:
    return points_of(scene.image(noise=4, seed=seed))


@pytest.mark.parametrize("far", [0.8, 15, 50, 100, 140])
def test_drawn_bends(far: float):
    straight = HALF
    initial = points_in(straight, seed=1)
    for direction, x, y in zip(NUMBERS[1:], (0, 0, -far, far), (-far, far, 0, 0), strict=True):
        frame = points_in(straight.moved(x, y), seed=2)
        for use in ("blue", "all", "centre"):
            assert estimate_bending_direction(frame, initial, use=use) is direction


@pytest.mark.parametrize(
    ("x", "y", "literal", "center"),
    [
        (0, 1, Direction.UP, Direction.DOWN),
        (0, -1, Direction.UP, Direction.UP),
        (1, 0, Direction.RIGHT, Direction.RIGHT),
    ],
)
def test_a_bend_down_behind_a_nearer_wall(x: int, y: int, literal: Direction, center: Direction):
    """Where the wall hides blue's lower side its lowest point rises, and no topmost one falls."""
    straight = replace(HALF, yellow=None)
    opening = Ellipse(159.5 - 45 * x, 119.5 - 45 * y, 90, 90)
    hidden = replace(straight.moved(60 * x, 60 * y), opening=opening)
    initial, frame = points_in(straight, seed=1), points_in(hidden, seed=2)
    assert estimate_bending_direction(frame, initial) is literal
    assert estimate_bending_direction(frame, initial, use="centre") is center
