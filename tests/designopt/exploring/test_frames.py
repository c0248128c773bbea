"""Pictures for a browser, packed and put together again."""

import io

import numpy as np
import pytest
from PIL import Image

from designopt.exploring.frames import change, pixels_of, png


def picture(seed):
    rgba = np.random.default_rng(seed).integers(0, 255, (30, 40, 4), dtype=np.uint8)
    rgba[:, :, 3] = 255
    return rgba


def opened(data):
    return Image.open(io.BytesIO(data))


def test_a_picture_is_packed_without_loss():
    rgba = picture(0)
    np.testing.assert_array_equal(np.array(opened(png(pixels_of(rgba)))), rgba)


@pytest.mark.parametrize("where", [np.s_[3:7, 5:9], np.s_[:, :], np.s_[[2, 29], [39, 3]]])
def test_what_has_changed_over_the_old_gives_the_new(where):
    old = picture(1)
    new = old.copy()
    new[where] = picture(2)[where]
    part = change(pixels_of(new), pixels_of(old))
    assert part is not None
    patch = opened(png(part.pixels))
    over = Image.fromarray(old)
    over.alpha_composite(patch, (part.left, part.top))
    np.testing.assert_array_equal(np.array(over), new)
    rows, columns = np.nonzero((new != old).any(axis=2))
    assert patch.size == (int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1)
    there = np.s_[part.top : part.top + patch.height, part.left : part.left + patch.width]
    assert not np.array(patch)[(new == old).all(axis=2)[there]].any()


def test_where_nothing_has_changed_nothing_is_sent():
    assert change(pixels_of(picture(3)), pixels_of(picture(3))) is None
