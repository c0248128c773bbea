"""Blobs of drawn images: what comes apart, what stays together, and whose outline stays."""

import cv2
import numpy as np
import pytest
from scipy.spatial.distance import cdist

from perception.blobs import LEAST_AREA, Blob, stable_blobs

ROWS, COLUMNS = 540, 720
DARK, BRIGHT = 12.0, 150.0
ACROSS, DOWN = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
SEAM = 3
"""A narrow seam of such an image, px."""


def seen(light: np.ndarray, *, gain: float = 1.0, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """As a camera stores it, a little blurred."""
    blurred = gain * cv2.GaussianBlur(light, (0, 0), 0.7)
    noisy = blurred + noise * np.random.default_rng(seed).standard_normal(light.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def box(top: int, bottom: int, left: int = 200, right: int = 500) -> np.ndarray:
    return (top <= DOWN) & (bottom > DOWN) & (left <= ACROSS) & (right > ACROSS)


def background() -> np.ndarray:
    return np.full((ROWS, COLUMNS), DARK)


def extent(blob: Blob) -> np.ndarray:
    """Left, top, right and bottom."""
    return np.concatenate([blob.contour.min(axis=0), blob.contour.max(axis=0) + 1])


@pytest.mark.parametrize("seam", [DARK, 0.5 * BRIGHT, 0.7 * BRIGHT])
@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_two_pads_with_a_narrow_dark_seam_come_apart(seam, noise):
    light = background()
    light[box(100, 200)] = BRIGHT
    light[box(200, 200 + SEAM)] = seam
    light[box(200 + SEAM, 320)] = BRIGHT
    blobs = sorted(stable_blobs(seen(light, noise=noise)), key=lambda blob: extent(blob)[1])
    assert len(blobs) == 2
    np.testing.assert_allclose(extent(blobs[0]), [200, 100, 500, 200], atol=2)
    np.testing.assert_allclose(extent(blobs[1]), [200, 200 + SEAM, 500, 320], atol=2)


def test_two_pads_of_unlike_brightness_come_apart():
    light = background()
    light[box(100, 200)] = BRIGHT
    light[box(200 + SEAM, 320)] = BRIGHT / 2
    assert len(stable_blobs(seen(light, noise=2.0))) == 2


@pytest.mark.parametrize("bridge", [0.2, 0.4])
def test_stray_light_between_two_pads_does_not_join_them(bridge):
    light = background()
    light[box(150, 240)] = bridge * BRIGHT
    light[box(100, 150)] = light[box(240, 290)] = BRIGHT
    blobs = sorted(stable_blobs(seen(light)), key=lambda blob: extent(blob)[1])
    assert len(blobs) == 2
    np.testing.assert_allclose(extent(blobs[0]), [200, 100, 500, 150], atol=2)
    np.testing.assert_allclose(extent(blobs[1]), [200, 240, 500, 290], atol=2)


@pytest.mark.parametrize("level", [1, 2, 3, 4])
def test_a_faint_halo_in_the_dark_is_no_part_of_a_pad(level):
    """As JPEG leaves one: even, and as wide as its blocks."""
    light = np.zeros((ROWS, COLUMNS))
    light[box(84, 216, 184, 516)] = level
    light[box(100, 200)] = BRIGHT
    (blob,) = stable_blobs(seen(light))
    np.testing.assert_allclose(extent(blob), [200, 100, 500, 200], atol=2)


@pytest.mark.parametrize("along", [True, False], ids=["along", "across"])
@pytest.mark.parametrize("low", [0.25, 0.5])
def test_a_gradient_does_not_part_a_pad(along, low):
    light, pad = background(), box(100, 300)
    share = (DOWN - 100) / 200 if along else (ACROSS - 200) / 300
    light[pad] = (BRIGHT * (low + (1 - low) * share))[pad]
    (blob,) = stable_blobs(seen(light, noise=1.0))
    np.testing.assert_allclose(extent(blob), [200, 100, 500, 300], atol=2)


def test_two_broad_highlights_are_one_pad():
    light, pad = background(), box(100, 300)
    hump = np.cos(2 * np.pi * (ACROSS - 200) / 300 * 2) * np.sin(np.pi * (DOWN - 100) / 200)
    light[pad] = (BRIGHT * (0.7 + 0.3 * hump))[pad]
    (blob,) = stable_blobs(seen(light))
    np.testing.assert_allclose(extent(blob), [200, 100, 500, 300], atol=1.5)


def test_the_outline_stays_within_a_pixel_over_exposures():
    light = background()
    light[box(100, 200)] = BRIGHT
    light[box(230, 400, 150, 450)] = 0.6 * BRIGHT
    reference = sorted(stable_blobs(seen(light)), key=lambda blob: extent(blob)[1])
    for gain in (0.5, 0.7, 1.3, 1.8):
        blobs = sorted(stable_blobs(seen(light, gain=gain)), key=lambda blob: extent(blob)[1])
        assert len(blobs) == len(reference) == 2
        for blob, other in zip(blobs, reference, strict=True):
            apart = cdist(blob.contour, other.contour)
            # Pixels' middles are on a lattice: one step, or one along a diagonal.
            assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) <= np.sqrt(2)


def test_areas_are_those_that_were_drawn():
    light = background()
    light[box(100, 200)] = light[box(300, 330, 100, 600)] = BRIGHT
    smaller, larger = sorted(blob.area for blob in stable_blobs(seen(light)))
    # Blur moves outlines, which run through middles of pixels, by less than a pixel.
    assert 499 * 29 <= smaller <= 501 * 31
    assert 299 * 99 <= larger <= 301 * 101


@pytest.mark.parametrize("gray", [0, 12, 255])
def test_an_even_image_has_no_blobs(gray):
    assert stable_blobs(np.full((ROWS, COLUMNS), gray, np.uint8)) == []


def test_noise_has_no_blobs():
    assert stable_blobs(seen(np.full((ROWS, COLUMNS), 40.0), noise=10.0)) == []


def test_specks_are_no_blobs():
    side = round(np.sqrt(LEAST_AREA * ROWS * COLUMNS))
    light = background()
    # Blur, and the look at the neighbours, make them a few pixels larger at low thresholds.
    light[box(100, 96 + side, 200, 196 + side)] = BRIGHT
    light[box(200, 202 + side, 200, 202 + side)] = BRIGHT
    (blob,) = stable_blobs(seen(light))
    assert extent(blob)[1] >= 199


@pytest.mark.parametrize("seed", range(6))
def test_no_blob_overlaps_another(seed):
    generator = np.random.default_rng(seed)
    rough = cv2.GaussianBlur(generator.standard_normal((ROWS, COLUMNS)), (0, 0), 15)
    light = 60 + 300 * rough / np.abs(rough).max()
    for _ in range(6):
        top, left = generator.integers(0, (ROWS, COLUMNS))
        light[box(top, top + 80, left, left + 150)] += generator.uniform(0, 100)
    filled = np.zeros((ROWS, COLUMNS), int)
    blobs = stable_blobs(seen(light))
    for blob in blobs:
        filled += cv2.drawContours(
            np.zeros((ROWS, COLUMNS), np.uint8), [blob.contour.astype(np.int32)], 0, (1,), -1
        )
    assert filled.max() == 1
    assert len(blobs) > 2
