"""Masks against their definitions written out in NumPy and SciPy."""

import cv2
import numpy as np
import pytest
import scipy.ndimage

from perception.masks import (
    adaptive_mask,
    brightness,
    cleaned,
    combined_mask,
    global_mask,
    lamp_mask,
    seam_mask,
    without_lamps,
)

RANDOM = np.random.default_rng(0).integers(0, 256, (40, 60), np.uint8)
SEAM, SHARE = 9, 0.8


def two_pads(gap: int, dark: int = 40) -> np.ndarray:
    """A pad over another one, and between them a seam from row 60 on."""
    gray = np.zeros((120, 160), np.uint8)
    gray[20 : 100 + gap, 40:120] = 180
    gray[60 : 60 + gap, 40:120] = dark
    return gray


def test_brightness_is_the_brightest_channel():
    image = np.random.default_rng(1).integers(0, 256, (20, 30, 3), np.uint8)
    np.testing.assert_array_equal(brightness(cv2.split(image)), image.max(axis=-1))


@pytest.mark.parametrize("threshold", [0, 99, 99.5, 254])
def test_the_global_mask_is_what_is_brighter(threshold):
    np.testing.assert_array_equal(global_mask(RANDOM, threshold), 255 * (threshold < RANDOM))


@pytest.mark.parametrize(("block", "share"), [(5, 0.8), (21, 1.1)])
def test_the_adaptive_mask_compares_with_the_mean_around(block, share):
    mean = scipy.ndimage.uniform_filter(RANDOM.astype(float), block, mode="nearest")
    expected = 255 * (share * mean < RANDOM)
    # The mean, and the share of it, are rounded to whole numbers.
    sure = np.abs(RANDOM - share * mean) > 1.1
    np.testing.assert_array_equal(adaptive_mask(RANDOM, block, share)[sure], expected[sure])
    assert sure.mean() > 0.95


@pytest.mark.parametrize("gap", [2, 4, 7])
def test_a_narrow_dark_gap_across_the_section_is_a_seam(gap):
    seam = seam_mask(two_pads(gap), SEAM, SHARE)
    assert seam[60 : 60 + gap, 40:120].all()
    assert not seam[:60].any()
    assert not seam[60 + gap :].any()


def test_seams_are_drawn_longer_at_both_ends():
    gray = two_pads(4)
    gray[:, 40:60] = 180
    columns = np.flatnonzero(seam_mask(gray, SEAM, SHARE)[61])
    # By half the square that they are drawn with, which is a pixel off its middle.
    assert abs(columns.min() - (60 - 3 * SEAM // 2)) <= 1
    assert abs(columns.max() - (119 + 3 * SEAM // 2)) <= 1


SHORT = two_pads(0)
SHORT[60:63, 70 : 70 + 2 * SEAM - 1] = 20
NO_SEAM = {"wide": two_pads(12), "shallow": two_pads(4, 160), "upright": two_pads(4).T.copy()}
NO_SEAM |= {"none": two_pads(0), "shorter than two widths": SHORT}


@pytest.mark.parametrize("gray", NO_SEAM.values(), ids=NO_SEAM)
def test_what_is_wide_or_shallow_or_upright_or_short_is_no_seam(gray):
    assert not seam_mask(gray, SEAM, SHARE).any()


def test_the_combined_mask_is_both():
    both = global_mask(RANDOM, 90) & adaptive_mask(RANDOM, 9, 0.9)
    np.testing.assert_array_equal(combined_mask(RANDOM, 90, 9, 0.9), both)


def test_cleaning_takes_specks_and_fills_holes_and_leaves_the_rest():
    pad = np.zeros((60, 80), np.uint8)
    pad[10:50, 20:60] = 255
    spoilt = pad.copy()
    spoilt[5, 5] = spoilt[30:33, 70] = 255
    spoilt[20:22, 30:33] = spoilt[40, 40] = 0
    np.testing.assert_array_equal(cleaned(spoilt, 5), pad)
    np.testing.assert_array_equal(cleaned(pad, 5), pad)


def lamps(pad: float = 170.0, lamp: float = 255.0) -> tuple[np.ndarray, np.ndarray]:
    """A pad between a lamp that touches it and one that does not; and where the lamps are."""
    gray, where = np.full((540, 720), 10.0), np.zeros((540, 720), bool)
    gray[150:350, 200:500] = pad * np.linspace(0.5, 1.0, 300)
    where[150:350, 500:512] = where[150:350, 175:190] = True
    gray[where] = lamp
    return gray.astype(np.uint8), where


def test_lamps_are_clipped_strips_that_end_steeply():
    gray, where = lamps()
    np.testing.assert_array_equal(lamp_mask(gray, gray) > 0, where)
    dark = without_lamps(gray, lamp_mask(gray, gray), 2)
    assert dark[where].max() <= 10
    assert (dark[:, 202:496] == gray[:, 202:496]).all()
    assert not lamp_mask(gray // 2, gray // 2).any()


def test_a_lamp_beside_a_pad_that_it_clips_shows_in_the_other_colors():
    gray, where = lamps(pad=255.0)
    other = np.where(where, 255, gray // 4).astype(np.uint8)
    image = np.stack([gray, other, other], axis=-1)
    np.testing.assert_array_equal(lamp_mask(image, gray) > 0, where)


def test_an_overexposed_pad_or_edge_of_one_is_no_lamp():
    gray = np.full((540, 720), 10.0)
    gray[150:350, 200:500] = 255
    edge = gray.copy()
    # As a lamp beside it lights it, the outermost 15 px clipped.
    distance = 500.0 - np.arange(200, 500)
    edge[150:350, 200:500] = np.minimum(255, 255 * (75 / (60 + distance)) ** 2)
    for one in (gray, edge):
        assert not lamp_mask(one.astype(np.uint8), one.astype(np.uint8)).any()


@pytest.mark.parametrize("color", range(3))
def test_lamps_across_the_section_have_one_color(color):
    image, where = np.full((540, 720, 3), 10, np.uint8), np.zeros((540, 720), bool)
    where[300:316, 150:500] = True
    image[where] = 80
    image[where, color] = 255
    np.testing.assert_array_equal(lamp_mask(image, image.max(axis=-1)) > 0, where)
    # A pad that is seen flatly, lit evenly by two lamps, and by one that shines from its end.
    even, falling = image.copy(), image.copy()
    even[where, (color + 1) % 3] = 255
    falling[300:316, 150:500, color] = np.minimum(255, np.linspace(500, 40, 350))
    for pad in (even, falling):
        assert not lamp_mask(pad, pad.max(axis=-1)).any()


def test_a_lamp_that_leans_is_one():
    rows, columns = np.mgrid[:540, :720]
    off = columns - 2.0 * rows
    gray = np.select([off > 0, off > -20], [120.0, 262.0], 10.0)
    gray[(rows < 200) | (rows > 300)] = 10
    # So blurred that along a row light falls over more than `RIM`.
    blurred = np.minimum(cv2.GaussianBlur(gray, (0, 0), 1.2), 255).astype(np.uint8)
    there = lamp_mask(blurred, blurred) > 0
    inner = (off > -13) & (off < -9) & (rows > 205) & (rows < 295)
    assert there[inner].all()
    assert not there[(off > 10) | (off < -30)].any()
