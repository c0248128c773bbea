"""Pictures for a browser, packed and put together again."""

import io

import numpy as np
import pytest
from PIL import Image

from designopt.explore.frames import SIDE, change, pixels_of, png
from tests.designopt.explore.hands import put_squares

TALL, WIDE = 2 * SIDE + 7, 3 * SIDE + 5  # no multiples of the squares


def picture(seed):
    rgba = np.random.default_rng(seed).integers(0, 255, (TALL, WIDE, 4), dtype=np.uint8)
    rgba[:, :, 3] = 255
    return rgba


def put_together(old, found):
    """What a browser makes of the squares, one by one."""
    new, image = old.copy(), Image.open(io.BytesIO(png(found.pixels))).convert("RGBA")
    put_squares(new, np.array(image), found.places.tolist(), found.across)
    return new


@pytest.mark.parametrize("first", [np.zeros((TALL, WIDE, 4), np.uint8), picture(2)])
def test_the_first_picture_is_sent_whole(first):
    found = change(pixels_of(picture(1)), None)
    assert found is not None
    np.testing.assert_array_equal(put_together(first, found), picture(1))


@pytest.mark.parametrize(
    ("where", "squares"),
    [
        (np.s_[3:7, 5:9], 1),
        (np.s_[:, :], 12),
        (np.s_[[2, TALL - 1], [WIDE - 1, 3]], 2),
        (np.s_[SIDE - 1 : SIDE + 1, SIDE - 1 : SIDE + 1], 4),
        (np.s_[TALL - 1, WIDE - 1], 1),
        (np.s_[0, ::SIDE], 4),
    ],
)
def test_the_squares_that_have_changed_over_the_old_give_the_new(where, squares):
    old = picture(1)
    new = old.copy()
    new[where] = picture(2)[where]
    found = change(pixels_of(new), pixels_of(old))
    assert found is not None
    assert len(found.places) == squares
    np.testing.assert_array_equal(put_together(old, found), new)


def test_where_nothing_has_changed_nothing_is_sent():
    assert change(pixels_of(picture(3)), pixels_of(picture(3))) is None
