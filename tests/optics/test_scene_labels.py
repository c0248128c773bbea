"""Where names stand in a scene, against trying every place for them."""

import itertools

import numpy as np
import pytest

from optics.plot.label_layout import GAPS, PARTS, Label, _best, _box, _merit, _sampled

SCALE = 2.0
WINDOW = np.array([(-150.0, -150.0), (150.0, 150.0)])
MIRRORED = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])


def best_of_all(label, clutter, taken):
    """The first of the best places."""
    start, end = label.ends * SCALE
    assert not np.array_equal(start, end)
    boxes = []
    for across, side, gap, part in itertools.product((0, 1), (1, -1), GAPS, PARTS):
        cost = 0.1 * gap + 1.5 * abs(part - 0.5) + 2 * across + 3 * (side * label.back < 0)
        boxes.append(_box(label, SCALE, across, side, gap, part, cost))
    merits = [_merit(box, clutter, taken, WINDOW) for box in boxes]
    return boxes[int(np.argmax(merits))]


def check(label, clutter, taken):
    found = _best(label, SCALE, clutter, taken, WINDOW)
    wanted = best_of_all(label, clutter, taken)
    np.testing.assert_array_equal(found.middle, wanted.middle)
    np.testing.assert_array_equal(found.leader, wanted.leader)
    assert (found.angle, found.cost) == (wanted.angle, wanted.cost)


@pytest.mark.parametrize("back", [-1, 0, 1])
@pytest.mark.parametrize("count", [3, 30, 300])
def test_the_best_place_is_found_in_any_crowd(count, back):
    draw = np.random.default_rng([count, back + 1])
    clutter = draw.uniform(-60, 60, (count, 2))
    label = Label("a name", draw.uniform(-30, 30, (2, 2)), back, 4.0)
    check(label, clutter, int(draw.integers(0, count)))


@pytest.mark.parametrize("seed", range(4))
def test_of_places_that_are_as_good_the_first_is_taken(seed):
    """Two sides of a mirrored crowd, for a name that may stand on either."""
    draw = np.random.default_rng(seed)
    crowd = (draw.uniform(2, 60, (15, 2))[:, None] * MIRRORED).reshape(-1, 2)
    label = Label("both", np.array([(-12.0, 0.0), (12.0, 0.0)]), 0, 4.0)
    check(label, np.vstack([crowd, _sampled(label.ends * SCALE)]), 0)
