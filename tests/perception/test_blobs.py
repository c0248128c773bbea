"""Blobs of drawn images: what comes apart, what stays together, and whose outline stays."""

import cv2
import numpy as np
import pytest
from scipy.spatial.distance import cdist

from perception.blobs import LEAST_AREA, Blob, join_halves, stable_blobs
from tests.perception.drawn import BRIGHT, DARK, stored

ROWS, COLUMNS = 540, 720
ACROSS, DOWN = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
SEAM = 3
"""A narrow seam of such an image, px."""

PAD = (100, 200)
BELOW = (200 + SEAM, 320)


def box(top: int, bottom: int, left: int = 200, right: int = 500) -> np.ndarray:
    return (top <= DOWN) & (bottom > DOWN) & (left <= ACROSS) & (right > ACROSS)


def background(level: float = DARK) -> np.ndarray:
    return np.full((ROWS, COLUMNS), level)


def found(light: np.ndarray, *, gain: float = 1.0, noise: float = 0.0) -> list[Blob]:
    """From the top down, in an image that is a little blurred."""
    blobs = stable_blobs(stored(gain * cv2.GaussianBlur(light, (0, 0), 0.7), noise))
    return sorted(blobs, key=lambda blob: blob.contour[:, 1].min())


def check(blobs: list[Blob], *boxes: tuple[int, int], atol: float = 2.0) -> None:
    """Blobs are boxes from one row to another."""
    assert len(blobs) == len(boxes)
    for blob, (top, bottom) in zip(blobs, boxes, strict=True):
        extent = [*blob.contour.min(axis=0), *(blob.contour.max(axis=0) + 1)]
        np.testing.assert_allclose(extent, [200, top, 500, bottom], atol=atol)


@pytest.mark.parametrize("noise", [0.0, 2.0])
@pytest.mark.parametrize(
    ("seam", "below"), [(DARK, 1.0), (0.5 * BRIGHT, 1.0), (0.7 * BRIGHT, 1.0), (DARK, 0.5)]
)
def test_two_pads_with_a_narrow_dark_seam_come_apart(seam, below, noise):
    light = background()
    light[box(*PAD)], light[box(*BELOW)] = BRIGHT, below * BRIGHT
    light[box(200, 200 + SEAM)] = seam
    check(found(light, noise=noise), PAD, BELOW)


@pytest.mark.parametrize("bridge", [0.2, 0.4])
def test_stray_light_between_two_pads_does_not_join_them(bridge):
    light = background()
    light[box(150, 240)] = bridge * BRIGHT
    light[box(100, 150)] = light[box(240, 290)] = BRIGHT
    check(found(light), (100, 150), (240, 290))


@pytest.mark.parametrize("level", [1, 4])
def test_a_faint_halo_in_the_dark_is_no_part_of_a_pad(level):
    """As JPEG leaves one: even, and as wide as its blocks."""
    light = background(0.0)
    light[box(84, 216, 184, 516)] = level
    light[box(*PAD)] = BRIGHT
    check(found(light), PAD)


@pytest.mark.parametrize("look", ["along", "across", "humps"])
@pytest.mark.parametrize("low", [0.25, 0.5])
def test_neither_a_gradient_nor_two_broad_highlights_part_a_pad(look, low):
    light, pad = background(), box(100, 300)
    along, across = (DOWN - 100) / 200, (ACROSS - 200) / 300
    humps = 0.5 + 0.5 * np.cos(4 * np.pi * across) * np.sin(np.pi * along)
    share = {"along": along, "across": across, "humps": humps}[look]
    light[pad] = (BRIGHT * (low + (1 - low) * share))[pad]
    check(found(light, noise=1.0), (100, 300))


@pytest.mark.parametrize(("glow", "spread", "bump"), [(30, 40, 30), (40, 25, 40), (60, 25, 40)])
def test_a_pad_on_walls_that_it_lights_has_its_own_outline(glow, spread, bump):
    """Their light fades away from it, with a bump; outlines of both wander with the threshold."""
    down, across = (
        np.maximum(np.abs(DOWN - 200) - 100, 0),
        np.maximum(np.abs(ACROSS - 350) - 150, 0),
    )
    light = DARK + glow * np.exp(-np.hypot(down, across) / 40)
    light += bump * np.exp(-((DOWN - 200) ** 2 + (ACROSS - 580) ** 2) / 2 / spread**2)
    light[box(100, 300)] = BRIGHT
    pads = [blob for blob in found(light) if blob.contour[:, 0].min() < 350]
    check(pads, (100, 300))


def test_outline_and_area_stay_within_a_pixel_over_exposures():
    light = background()
    light[box(*PAD)], light[box(230, 400)] = BRIGHT, 0.6 * BRIGHT
    reference = found(light)
    check(reference, PAD, (230, 400))
    for gain in (0.5, 0.7, 1.0, 1.3, 1.8):
        blobs = found(light, gain=gain)
        assert len(blobs) == 2
        for blob, other, high in zip(blobs, reference, (100, 170), strict=True):
            apart = cdist(blob.contour, other.contour)
            # Pixels' middles are on a lattice: one step, or one along a diagonal.
            assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) <= np.sqrt(2)
            assert gain != 1 or 299 * (high - 1) <= blob.area <= 301 * (high + 1)


@pytest.mark.parametrize(("gray", "noise"), [(0.0, 0.0), (12.0, 0.0), (255.0, 0.0), (40.0, 10.0)])
def test_an_even_image_has_no_blobs(gray, noise):
    assert found(background(gray), noise=noise) == []


def test_a_pad_above_more_dim_blobs_than_are_looked_at_is_found():
    gray = np.full((1080, 1440), 10, np.uint8)
    for number in range(120):
        row, column = divmod(number, 30)
        gray[600 + 80 * row :, :][:31, 40 + 45 * column :][:, :31] = 60
    gray[60:300, 500:900] = 200
    boxes = [cv2.boundingRect(blob.contour) for blob in stable_blobs(gray)]
    largest = max(boxes, key=lambda one: one[2] * one[3])
    np.testing.assert_allclose(largest, (500, 60, 400, 240), atol=2)


def test_specks_are_no_blobs():
    side = round(np.sqrt(LEAST_AREA * ROWS * COLUMNS))
    light = background()
    # Blur, and the look at the neighbours, make them a few pixels larger at low thresholds.
    light[box(100, 96 + side, 200, 196 + side)] = BRIGHT
    light[box(200, 202 + side, 200, 202 + side)] = BRIGHT
    (blob,) = found(light)
    assert blob.contour[:, 1].min() >= 199


@pytest.mark.parametrize("seed", range(3))
def test_no_blob_overlaps_another(seed):
    generator = np.random.default_rng(seed)
    rough = cv2.GaussianBlur(generator.standard_normal((ROWS, COLUMNS)), (0, 0), 15)
    light = 60 + 300 * rough / np.abs(rough).max()
    for _ in range(6):
        top, left = generator.integers(0, (ROWS, COLUMNS))
        light[box(top, top + 80, left, left + 150)] += generator.uniform(0, 100)
    filled, blobs = np.zeros((ROWS, COLUMNS), int), found(light)
    for blob in blobs:
        mask = np.zeros((ROWS, COLUMNS), np.uint8)
        filled += cv2.drawContours(mask, [blob.contour.astype(np.int32)], 0, (1,), -1)
    assert filled.max() == 1
    assert len(blobs) > 2


def test_halves_of_a_pad_whose_middle_is_dark_are_joined_and_pads_below_are_not():
    light = background()
    light[box(100, 200, 200, 300)] = light[box(105, 200, 400, 500)] = BRIGHT
    light[box(230, 330, 200, 300)] = light[box(230, 330, 400, 500)] = BRIGHT
    light[box(260, 300, 330, 370)] = BRIGHT  # something between them
    blobs = sorted(join_halves(found(light)), key=lambda blob: blob.area)
    spans = [np.ptp(blob.contour[:, 0]) for blob in blobs]
    assert len(blobs) == 4
    np.testing.assert_allclose(spans, [40, 100, 100, 300], atol=3)
