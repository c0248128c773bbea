"""Polygons around masks on drawn pads."""

import cv2
import numpy as np
import pytest

from perception.paper_route import PaperRoute
from tests.perception.drawn import BRIGHT, DARK, Eye, Pad, colored, drawn, stored

ROUTE = PaperRoute(block=201)
EYE = Eye(pinhole=True)

NEAR = 2.5
"""Outermost pixels, and a tolerance of 0.5 % of the outline, are so far from corners at most."""


def seen(*pads: Pad) -> np.ndarray:
    return colored(stored(drawn(EYE, pads), noise=1.0))


TWO = Pad((20, -20), (24, -4)), Pad((24, 4), (18, 16))


@pytest.mark.parametrize("pads", [[Pad((20, -14), (24, 12))], [Pad((30, 5), (18, 16))], TWO])
def test_sharp_corners_of_every_pad_are_found_to_a_few_pixels(pads):
    found = ROUTE.corners(seen(*pads))
    found = sorted(found, key=lambda corners: -corners[:, 1].mean())
    assert len(found) == len(pads)
    for corners, pad in zip(found, pads, strict=True):
        np.testing.assert_allclose(corners, EYE.places(pad.corners()), atol=NEAR)


def test_round_corners_are_found_inside_of_the_true_ones():
    pad = Pad((20, -14), (24, 12), radius=2.0)
    (corners,) = ROUTE.corners(seen(pad))
    true = EYE.places(pad.corners())
    inward = np.sum((corners - true) * (true.mean(axis=0) - true), axis=-1)
    assert (inward > 0).all()
    assert np.hypot(*(corners - true).T).max() > 1


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
