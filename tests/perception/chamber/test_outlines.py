"""Outlines of shapes whose straight and parting shares are known."""

import itertools

import cv2
import numpy as np
import pytest

from perception.chamber.outlines import Course, convex_outline, filled

SHAPE = (240, 320)
EVERYTHING, NOTHING = np.full(SHAPE, 255, np.uint8), np.zeros(SHAPE, np.uint8)


def disc(x: float, y: float, wide: float, high: float, turn: float = 0.0) -> np.ndarray:
    mask = NOTHING.copy()
    center, axes = (tuple(round(16 * one) for one in pair) for pair in ((x, y), (wide, high)))
    cv2.ellipse(mask, center, axes, turn, 0, 360, 255, -1, cv2.LINE_8, 4)
    return mask


def course_of(mask: np.ndarray) -> Course:
    return Course.of(convex_outline(mask), mask.shape)


def polygon(sides: int, radius: float, turn: float) -> np.ndarray:
    around = turn + 2 * np.pi * np.arange(sides) / sides
    corners = [160, 120] + radius * np.stack([np.cos(around), np.sin(around)], axis=-1)
    return cv2.fillConvexPoly(NOTHING.copy(), np.round(corners).astype(np.int32), 255)


def test_an_ellipse_is_not_straight():
    for radius, flat, turn in itertools.product((20.0, 60.0, 95.3), (0.6, 1.0), (0.0, 33.0)):
        assert course_of(disc(160, 120, radius, flat * radius, turn)).straightness() == 0


@pytest.mark.parametrize("sides", [3, 4])
def test_a_polygon_is_straight_but_for_chords_across_its_corners(sides):
    for radius, turn in itertools.product((40.0, 90.0), (0.0, 0.3, 0.7)):
        # Two chords are an eighth of the outline long: so much about every corner turns.
        found = course_of(polygon(sides, radius, turn)).straightness()
        assert found == pytest.approx(1 - sides / 8, abs=0.07)


def test_a_segment_of_a_disc_is_straight_along_its_chord():
    mask = disc(160, 120, 80, 80)
    mask[:, 200:] = 0
    half = np.arccos(40 / 80)
    chord, arc = 2 * 80 * np.sin(half), 80 * (2 * np.pi - 2 * half)
    found = course_of(mask).straightness()
    assert found == pytest.approx(chord / (chord + arc) - 1 / 8, abs=0.03)


def test_what_lies_at_the_border_is_not_judged():
    mask = disc(160, 0, 80, 80)
    course = course_of(mask)
    assert course.straightness() == 0
    outside = cv2.bitwise_not(mask)
    assert course.support(outside, mask, NOTHING) == 1
    assert course_of(EVERYTHING).straightness() == 1
    assert course_of(EVERYTHING).support(NOTHING, NOTHING, NOTHING) == 1


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_support_is_the_share_of_the_outline_that_parts_two_masks(share):
    mask = disc(160, 120, 80, 80)
    outside = cv2.bitwise_not(mask)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    shown = np.where(np.arctan2(y - 120, x - 160) % (2 * np.pi) < 2 * np.pi * share, 255, 0)
    shown = shown.astype(np.uint8)
    course = course_of(mask)
    seen_outside, seen_inside = cv2.bitwise_and(outside, shown), cv2.bitwise_and(mask, shown)
    for outer, inner in ((seen_outside, mask), (outside, seen_inside)):
        assert course.support(outer, inner, NOTHING) == pytest.approx(share, abs=0.02)
    # Where what is outside is not known, nothing is judged; where nothing is inside, it is.
    assert course.support(seen_outside, mask, EVERYTHING) == 1
    assert course.support(outside, seen_inside, EVERYTHING) == pytest.approx(share, abs=0.02)


def test_an_outline_goes_around_all_parts_but_specks():
    mask = cv2.max(disc(120, 120, 40, 40), disc(220, 120, 10, 10))
    mask[10, 10] = 255
    within = filled(convex_outline(mask), SHAPE)
    assert within[120, 229]
    assert within[120, 81]
    assert not within[:50].any()
    assert not len(convex_outline(NOTHING))
