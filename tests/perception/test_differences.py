"""Difference images of made-up pads."""

import cv2
import numpy as np
import pytest

from perception.differences import LEAST, SMOOTH, References, _flattened, compare_with_reference
from perception.unwarping import PER_MM
from tests.perception.drawn import Eye, Pad, exact_view

SHAPE = (220, 240)
ALONG, ACROSS = np.mgrid[: SHAPE[0], : SHAPE[1]] / PER_MM
VIEW = exact_view(Eye(), Pad((20, -12), (22, 12)))


def picture(gain: float = 1.0, pressed: float = 0.0, falloff: float = 0.0) -> np.ndarray:
    """A pad lit in three colours, brighter by a part where something small touches it."""
    light = 100 * (1 - falloff * ALONG / ALONG.max())
    spot = np.exp(-((ALONG - 8) ** 2 + (ACROSS - 15) ** 2) / (2 * 0.5**2))
    channels = [part * gain * light * (1 + pressed * spot) for part in (1.0, 0.5, 0.8)]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


@pytest.mark.parametrize("gain", [0.7, 1.3])
@pytest.mark.parametrize("falloff", [0.0, 0.3])
def test_light_that_is_brighter_everywhere_is_no_difference(gain, falloff):
    left = compare_with_reference(picture(gain, falloff=falloff), picture(falloff=falloff))
    # What is added to a smooth part, and the rounding of the pictures to whole numbers.
    dimmest = 50 * (1 - falloff) * min(gain, 1)
    assert np.abs(left).max() < LEAST * abs(gain - 1) / dimmest + 1 / dimmest


def test_light_that_falls_off_more_is_hardly_a_difference():
    left = compare_with_reference(picture(falloff=0.3), picture())
    # At the dim end of 22 mm, half of a Gaussian of 4 mm is mirrored there; the dimmest channel is
    # divided by a little more than itself.
    mirrored = 0.3 / 22 * 4 * np.sqrt(2 / np.pi) / 0.7
    assert np.abs(left).max() < mirrored + LEAST * (1 / 35 - 1 / 50)


@pytest.mark.parametrize("gain", [0.8, 1.0, 1.2])
def test_what_is_pressed_differs_where_and_by_how_much_it_is(gain):
    pressed = compare_with_reference(picture(gain, pressed=0.5), picture())
    for channel, part in enumerate((1.0, 0.5, 0.8)):
        at = np.unravel_index(np.argmax(pressed[..., channel]), SHAPE)
        assert np.hypot(ALONG[at] - 8, ACROSS[at] - 15) < 0.2
        # Relative to its surroundings, which the spot itself makes brighter: of two Gaussians of
        # 0.5 and 4 mm, by 1/65 of it.
        light, before = gain * part * 100, part * 100
        around = light * (1 + 0.5 / 65) + LEAST
        expected = 1.5 * light / around - before / (before + LEAST)
        assert pressed[(*at, channel)] == pytest.approx(expected, abs=0.01)
    far = np.hypot(ALONG - 8, ACROSS - 15) > 10
    assert np.abs(pressed[far]).max() < 0.05


@pytest.mark.parametrize("shape", [(220, 240), (187, 241), (30, 35), (3, 2)])
def test_smooth_part_is_that_of_a_gaussian_at_full_size(shape):
    """Noise, an edge and a gradient, against the picture blurred as it is."""
    generator = np.random.default_rng(1)
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    light = 60 + 60 * (columns > shape[1] / 3) + 40 * rows / shape[0]
    noisy = light[..., None] * generator.uniform(0.9, 1.1, (*shape, 3))
    one = np.rint(noisy).astype(np.uint8)
    exact = one.astype(np.float32)
    smooth = cv2.GaussianBlur(exact, (0, 0), SMOOTH * PER_MM, borderType=cv2.BORDER_REFLECT)
    np.testing.assert_allclose(_flattened(one), exact / (smooth + LEAST), rtol=2e-3)


def test_difference_changes_sign_with_its_sides():
    one, other = picture(pressed=0.5), picture()
    there, back = compare_with_reference(one, other), compare_with_reference(other, one)
    np.testing.assert_allclose(there, -back, atol=1e-6)
    for same in (one, np.zeros_like(one)):
        np.testing.assert_array_equal(compare_with_reference(same, same), 0)


def test_like_is_compared_with_the_latest_of_its_like():
    references, others = References(), References()
    assert references.compare(VIEW, picture()) is None
    references.keep(VIEW, picture(pressed=0.5))
    references.keep(VIEW, picture())
    found = references.compare(VIEW, picture(pressed=0.5))
    np.testing.assert_array_equal(found, compare_with_reference(picture(pressed=0.5), picture()))
    for name, path in (("pad", "mirror:pad"), ("other", "direct")):
        view = exact_view(Eye(), Pad((20, -12), (22, 12)), name=name, path=path)
        assert references.compare(view, picture()) is None
    assert others.compare(VIEW, picture()) is None
