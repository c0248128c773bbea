"""Exposure against rounding by hand, the normal distribution and its moments."""

import io

import numpy as np
import pytest
from PIL import Image
from scipy.stats import norm

from optics.rendering import Effects, encode_picture
from optics.rendering.exposure import READ_NOISE, exposed

STEP = 1 / 255


def even(light: float, shape: tuple[int, int] = (200, 240)) -> np.ndarray:
    return np.full((*shape, 3), light, np.float32)


def ramps() -> np.ndarray:
    """Smooth light of three different colours."""
    x, y = np.meshgrid(np.linspace(0, 1, 96), np.linspace(0, 1, 64))
    return np.stack([x, 0.3 + 0.4 * y, 0.8 - 0.5 * x * y], axis=-1).astype(np.float32)


def picture(light: np.ndarray, seed: int = 0, **effects: float) -> np.ndarray:
    """What is stored, as numbers that may be subtracted; the light may be overwritten."""
    pixels = exposed(light.copy(), Effects(**effects), np.random.default_rng(seed))
    assert pixels.dtype == np.uint8
    return pixels.astype(float)


def test_without_effects_light_is_rounded_to_8_bits():
    light = np.random.default_rng(0).uniform(-0.2, 1.3, (50, 60, 3)).astype(np.float32)
    wanted = 255 * np.clip(light.astype(float), 0, 1)
    pixels = picture(light)
    assert np.abs(pixels - wanted).max() < 0.5 + 1e-4
    assert pixels.min() == 0
    assert pixels.max() == 255
    np.testing.assert_array_equal(picture(light, gain=1.7), picture(np.float32(1.7) * light))


@pytest.mark.parametrize("light", [0.3, 0.6])
def test_noise_grows_with_the_square_root_of_light(light):
    pixels = picture(even(light), noise=0.02)
    assert pixels.mean() / 255 == pytest.approx(light, abs=0.001)
    # Rounding adds a twelfth of a step squared; 144,000 samples tell 0.2 % of the deviation.
    wanted = np.hypot(0.02 * np.sqrt(light + READ_NOISE**2), STEP / np.sqrt(12))
    assert pixels.std() / 255 == pytest.approx(wanted, rel=0.01)


def test_a_fifth_of_the_noise_is_there_without_light():
    pixels = picture(even(0.0), noise=0.2)
    # What is below 0 is stored as 0: the mean of the other half of a normal distribution.
    wanted = 0.2 * 0.2 / np.sqrt(2 * np.pi)
    assert pixels.mean() / 255 == pytest.approx(wanted, rel=0.02)


def test_noise_of_neighbours_and_channels_is_independent():
    noise = picture(even(0.5), noise=0.05) - 127.5
    variance = np.mean(noise**2)
    for one, other in (
        (noise[1:], noise[:-1]),
        (noise[:, 1:], noise[:, :-1]),
        (noise[..., 0], noise[..., 1]),
        (noise[..., 1], noise[..., 2]),
    ):
        assert abs(np.mean(one * other)) < 0.02 * variance


def test_a_picture_is_that_of_its_seed():
    effects = {"gain": 1.2, "blur": 0.8, "noise": 0.02, "jpeg": 8.0}
    one, same, other = (picture(ramps(), seed, **effects) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


@pytest.mark.parametrize("axis", [0, 1])
def test_blur_makes_an_edge_a_normal_distribution(axis):
    light = np.zeros((60, 60, 3), np.float32)
    np.moveaxis(light, axis, 0)[30:] = 1
    pixels = np.moveaxis(picture(light, blur=1.5), axis, 0) / 255
    # The edge is half a pixel before the middle of the 30th.
    wanted = norm.cdf((np.arange(60) - 29.5) / 1.5)
    np.testing.assert_allclose(
        pixels, np.broadcast_to(wanted[:, None, None], pixels.shape), atol=2 * STEP
    )


def test_noise_is_not_blurred():
    sharp, blurred = picture(even(0.5), noise=0.02), picture(even(0.5), blur=2.0, noise=0.02)
    assert blurred.std() == pytest.approx(sharp.std(), rel=0.02)


def test_compression_changes_little_and_keeps_the_colours():
    stored = picture(ramps())
    losses = [np.abs(picture(ramps(), jpeg=jpeg) - stored).mean() for jpeg in (1.0, 8.0, 60.0)]
    assert 0 < losses[0] < losses[1] < losses[2]
    assert losses[1] < 2
    red = even(0.0, (32, 32))
    red[..., 0] = 0.8
    np.testing.assert_allclose(picture(red, jpeg=8.0), picture(red), atol=4)


def test_files_of_pictures_are_what_another_library_reads():
    pixels = picture(ramps()).astype(np.uint8)
    with Image.open(io.BytesIO(encode_picture(pixels))) as file:
        assert file.format == "PNG"
        np.testing.assert_array_equal(np.asarray(file), pixels)
    for quality in (60, 95):
        again = io.BytesIO()
        Image.fromarray(pixels).save(again, "JPEG", quality=quality)
        with (
            Image.open(io.BytesIO(encode_picture(pixels, quality))) as file,
            Image.open(again) as other,
        ):
            assert file.format == "JPEG"
            assert vars(file)["quantization"] == vars(other)["quantization"]
            np.testing.assert_allclose(np.asarray(file).astype(int), np.asarray(other), atol=2)


def test_a_response_codes_light_by_its_power():
    light = ramps()
    wanted = 255 * light.astype(float) ** (1 / 2.2)
    assert np.abs(picture(light, gamma=2.2) - wanted).max() < 0.5 + 1e-3


def test_flare_is_a_veil_and_a_ghost_at_the_opposite_place():
    light = np.zeros((300, 400, 3), np.float32)
    light[60:140, 50:150] = 3.0
    clear, flared = picture(light), picture(light, flare=0.1)
    ghost = np.flip(light, (0, 1)) > 0
    # A quarter of a tenth of three times full scale.
    assert flared[ghost].min() >= 0.25 * 0.1 * 3 * 255 - 1
    veil = flared[(light == 0) & ~ghost]
    assert (clear[light == 0] == 0).all()
    assert 0 < veil.max() < flared[ghost].min()
    assert flared[100, 100, 0] > flared[280, 380, 0]
