"""Polygons around masks on drawn pads."""

import cv2
import numpy as np
import pytest

from perception.paper_route import PaperRoute
from tests.perception.drawn import BRIGHT, DARK, Eye, Pad, colored, drawn, stored

ROUTE = PaperRoute(block=201)
EYE = Eye(pinhole=True)
PADS = {"trapezium": Pad((20, -14), (24, 12)), "slab": Pad((30, 5), (18, 16))}

NEAR = 2.5
"""Outermost pixels, and a tolerance of 0.5 % of the outline, are so far from corners at most."""


def seen(pad: Pad) -> np.ndarray:
    return colored(stored(drawn(EYE, [pad]), noise=1.0))


@pytest.mark.parametrize("name", PADS)
def test_sharp_corners_are_found_to_a_few_pixels(name):
    (corners,) = ROUTE.corners(seen(PADS[name]))
    np.testing.assert_allclose(corners, EYE.places(PADS[name].corners()), atol=NEAR)


def test_round_corners_are_found_inside_of_the_true_ones():
    pad = Pad((20, -14), (24, 12), radius=2.0)
    (corners,) = ROUTE.corners(seen(pad))
    true = EYE.places(pad.corners())
    inward = np.sum((corners - true) * (true.mean(axis=0) - true), axis=-1)
    assert (inward > 0).all()
    assert np.hypot(*(corners - true).T).max() > 1


def test_every_pad_is_found():
    pads = [Pad((20, -20), (24, -4)), Pad((24, 4), (18, 16))]
    found = ROUTE.corners(colored(stored(drawn(EYE, pads))))
    found = sorted(found, key=lambda corners: -corners[:, 1].mean())
    assert len(found) == 2
    for corners, pad in zip(found, pads, strict=True):
        np.testing.assert_allclose(corners, EYE.places(pad.corners()), atol=NEAR)


@pytest.mark.parametrize("level", [0, 90, 255])
def test_an_even_image_shows_at_most_itself(level):
    image = np.full((EYE.rows, EYE.columns, 3), level, np.uint8)
    border = [[0, 359], [0, 0], [479, 0], [479, 359]]
    for corners in ROUTE.corners(image):
        np.testing.assert_array_equal(corners, border)


def test_small_things_are_no_pads():
    gray = np.full((EYE.rows, EYE.columns), DARK, np.uint8)
    cv2.rectangle(gray, (50, 50), (56, 58), (BRIGHT,), -1)
    assert ROUTE.corners(colored(gray)) == []


def test_what_has_many_corners_has_no_four():
    gray = np.full((EYE.rows, EYE.columns), DARK, np.uint8)
    turns = np.linspace(0, 2 * np.pi, 200)
    circle = [240, 180] + 100 * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    cv2.fillPoly(gray, [circle.round().astype(np.int32)], (BRIGHT,))
    for corners in ROUTE.corners(colored(gray)):
        # What is left of a circle is a square within it.
        assert np.hypot(*(corners - [240, 180]).T) == pytest.approx(100, abs=2)
