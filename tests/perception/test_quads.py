"""Sides and corners of drawn pads against where an exact camera images them."""

import functools

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.detection import detect_quads
from perception.lens import Lens
from perception.paper_route import PaperRoute
from perception.quads import LEAST_CONTRAST, Quad, first_corners, fit_quad, ordered
from perception.quality import Quality
from tests.perception.drawn import BRIGHT, DARK, Eye, Pad, defocused, drawn, rays_of, stored

NEAR = 0.3
"""A corner is found to so many pixels, in the light of a good finger."""

WIDE, PINHOLE = Eye(), Eye(pinhole=True)
PADS = {
    "before": Pad((20, -14), (22, 12)),
    "below": Pad((12, -30), (20, -18)),
    "above": Pad((30, 5), (18, 26)),
    "near": Pad((15, -10), (19, 16), beside=3),
    "far": Pad((40, -8), (40, 12)),
}
FLAT = Pad((10, -22), (33, -62))
"""Its far end is seen at 1.9° from its plane."""

MIRRORED, UPSIDE_DOWN = [3, 2, 1, 0], [1, 0, 3, 2]
"""What a corner is called in an image that is turned over."""


@functools.cache
def light_of(pad: Pad, blur: float = 0.7) -> np.ndarray:
    return cv2.GaussianBlur(drawn(WIDE, [pad]), (0, 0), blur)


@functools.cache
def wide() -> Lens:
    return WIDE.lens()


def only(gray: np.ndarray, lens: Lens) -> Quad:
    (quad,) = detect_quads(gray, lens)
    return quad


def contour_of(light: np.ndarray) -> np.ndarray:
    """Outermost pixels of a pad that is alone in an image without noise."""
    mask = (light > (DARK + BRIGHT) / 2).astype(np.uint8)
    (contour,) = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    return contour.reshape(-1, 2)


@pytest.mark.parametrize("name", PADS)
def test_corners_are_where_the_pad_is_imaged(name):
    pad = PADS[name]
    quad = only(stored(light_of(pad), noise=2.0), wide())
    assert quad.quality is Quality.COMPLETE
    np.testing.assert_allclose(quad.corners, WIDE.places(pad.corners()), atol=NEAR)
    # A pixel is 8 mrad here, and slopes change faster than section angles.
    np.testing.assert_allclose(quad.rays, rays_of(pad.corners()), atol=NEAR * 0.02)


def test_corners_of_a_straight_trapezium_through_a_pinhole():
    corners = np.array([[150.3, 261.7], [181.8, 95.2], [322.4, 95.2], [340.1, 261.7]])
    fine = 16
    # Filled polygons take in the pixels that their sides meet, half of a fine one too much.
    middle = corners.mean(axis=0)
    inner = corners - np.sign(corners - middle) / (2 * fine)
    large = np.full((360 * fine, 480 * fine), DARK, np.uint8)
    points = np.rint(((inner + 0.5) * fine - 0.5) * 16).astype(np.int32)
    cv2.fillPoly(large, [points], (BRIGHT,), shift=4)
    gray = cv2.resize(large, (480, 360), interpolation=cv2.INTER_AREA)
    quad = only(gray, PINHOLE.lens())
    np.testing.assert_allclose(quad.corners, corners, atol=NEAR)


def test_corners_go_from_bottom_left_clockwise():
    left, top, right, bottom = 0, 1, 2, 3
    columns, rows = only(stored(light_of(PADS["before"])), wide()).corners.T
    assert max(columns[[left, top]]) < min(columns[[right, bottom]])
    assert min(rows[[left, bottom]]) > max(rows[[top, right]])


@pytest.mark.parametrize("radius", [1.0, 2.0])
def test_round_corners_do_not_move_them(radius):
    pad = Pad((20, -14), (22, 12), radius=radius)
    gray = stored(light_of(pad))
    true = WIDE.places(pad.corners())
    np.testing.assert_allclose(only(gray, wide()).corners, true, atol=NEAR)
    # They do move those of a polygon around the contour.
    (polygon,) = PaperRoute(threshold=80, block=301).corners(np.repeat(gray[..., None], 3, -1))
    assert np.hypot(*(polygon - true).T).max() > 1


def test_something_dark_at_a_side_does_not_move_its_line():
    pad = PADS["before"]
    light = light_of(pad).copy()
    columns, rows = WIDE.places(pad.corners()).T.round().astype(int)
    # It takes a fifth of the left side.
    top, bottom = rows[1], rows[0]
    part = (bottom - top) // 5
    light[top + 2 * part : top + 3 * part, columns[0] - 5 : columns[0] + 15] = DARK
    # The other four fifths wander by a twentieth of a pixel.
    true = only(stored(light_of(pad)), wide()).corners
    np.testing.assert_allclose(only(stored(light), wide()).corners, true, atol=NEAR / 2)


@pytest.mark.parametrize(
    ("step", "seen"), [(LEAST_CONTRAST - 2, False), (LEAST_CONTRAST + 5, True)]
)
def test_a_low_step_of_brightness_is_too_little_contrast(step, seen):
    pad = PADS["before"]
    light = drawn(WIDE, [pad], [lambda places: np.full(len(places), DARK + step)])
    quad = fit_quad(stored(light).astype(np.float32), wide(), contour_of(light_of(pad)))
    assert quad is not None
    assert quad.quality is (Quality.COMPLETE if seen else Quality.LOW_CONTRAST)
    assert quad.contrast == pytest.approx(step, abs=1)


def test_one_side_without_a_step_is_too_little_contrast():
    pad = PADS["before"]
    light = drawn(WIDE, [pad])
    left = WIDE.places(pad.corners())[:, 0].min()
    light[:, : int(left) + 20] = BRIGHT
    quad = fit_quad(stored(light).astype(np.float32), wide(), contour_of(light_of(pad)))
    assert quad is not None
    assert quad.quality is Quality.LOW_CONTRAST
    assert quad.contrast == pytest.approx(0, abs=1)
    # Where the side is nobody knows, and the covariance says so.
    assert np.sqrt(quad.covariance[0, 0, 0]) > 50


def test_a_side_that_is_hardly_found_is_not_complete():
    pad = PADS["before"]
    light = drawn(WIDE, [pad])
    columns, rows = WIDE.places(pad.corners()).T.round().astype(int)
    # Light hides all but a tenth of the left side.
    top, bottom, high = rows[1], rows[0], (rows[0] - rows[1]) // 10
    hidden = np.s_[top - 20 : bottom + 20, : columns.min() + 20]
    shown = np.s_[top + 4 * high : top + 5 * high, : columns.min() + 20]
    edge = light[shown].copy()
    light[hidden] = BRIGHT
    light[shown] = edge
    quad = fit_quad(stored(light).astype(np.float32), wide(), contour_of(light_of(pad)))
    assert quad is not None
    assert np.sqrt(quad.covariance[0, 0, 0]) > 50
    assert quad.quality is not Quality.COMPLETE


@pytest.mark.parametrize("name", ["before", "below", "near", "flat"])
@pytest.mark.parametrize("radius", [1, 2, 4, 6, 8, 10, 12])
def test_no_view_is_complete_that_is_too_blurred_for_its_corners(name, radius):
    pad = PADS.get(name, FLAT)
    quads = detect_quads(stored(defocused(drawn(WIDE, [pad]), radius), noise=1.0), wide())
    complete = [quad for quad in quads if quad.quality is Quality.COMPLETE]
    for quad in complete:
        off = quad.corners - WIDE.places(pad.corners())
        covariance = quad.covariance + 0.25**2 * np.eye(2)
        assert np.hypot(*off.T).max() < 5
        assert np.einsum("ci,cij,cj->c", off, np.linalg.inv(covariance), off).max() < 3**2
    if pad is not FLAT:
        # A blur that a line's reach can see across costs no view.
        assert bool(complete) == (radius < 7)
    if not complete:
        assert {Quality.BLURRED, Quality.LOW_CONTRAST} >= {quad.quality for quad in quads}


@pytest.mark.parametrize(
    "pad",
    [Pad((6, -40), (18, -20)), Pad((30, 20), (6, 40)), Pad((12, -10), (12, 10), beside=15)],
    ids=["bottom", "top", "right"],
)
def test_a_view_at_the_border_is_clipped(pad):
    eye = Eye(columns=280)
    assert only(stored(drawn(eye, [pad])), eye.lens()).quality is Quality.CLIPPED


@pytest.mark.parametrize("name", PADS)
@pytest.mark.parametrize("gain", [0.7, 1.3])
def test_exposure_does_not_move_corners(name, gain):
    light = light_of(PADS[name])
    reference = only(stored(light), wide())
    np.testing.assert_allclose(
        only(stored(gain * light), wide()).corners, reference.corners, atol=0.1
    )


@pytest.mark.parametrize("name", PADS)
def test_an_image_turned_over_has_its_corners_turned_over(name):
    gray = stored(light_of(PADS[name]), noise=2.0)
    columns, rows = only(gray, wide()).corners.T
    left_right = only(np.ascontiguousarray(gray[:, ::-1]), wide()).corners
    mirrored = np.stack([479 - columns, rows], axis=-1)[MIRRORED]
    np.testing.assert_allclose(left_right, mirrored, atol=0.05)
    upside_down = only(np.ascontiguousarray(gray[::-1]), wide()).corners
    turned = np.stack([columns, 359 - rows], axis=-1)[UPSIDE_DOWN]
    np.testing.assert_allclose(upside_down, turned, atol=0.05)


@pytest.mark.parametrize("name", ["below", pytest.param("before", marks=pytest.mark.nightly)])
def test_the_covariance_is_the_scatter_of_repeats(name):
    errors, predicted = [], []
    for number in range(34):
        # Where pixels are against the sides is a part of the error: the pad is moved.
        generator = np.random.default_rng(number)
        pad = PADS[name]
        forward, up, beside = generator.uniform(-0.3, 0.3, 3)
        pad = Pad(
            (pad.first[0] + forward, pad.first[1] + up),
            (pad.second[0] + forward, pad.second[1] + up),
            beside=beside,
        )
        light = cv2.GaussianBlur(drawn(WIDE, [pad]), (0, 0), 0.7)
        contour = contour_of(light)
        for seed in range(3):
            gray = stored(light, noise=5.0, seed=100 * number + seed).astype(np.float32)
            quad = fit_quad(gray, wide(), contour)
            assert quad is not None
            errors.append(quad.corners - WIDE.places(pad.corners()))
            predicted.append(quad.covariance[:, [0, 1], [0, 1]])
    scatter, expected = np.mean(np.square(errors), axis=0), np.mean(predicted, axis=0)
    # Of variances. How alike neighbouring edges err is estimated from few of them.
    np.testing.assert_array_less(expected / scatter, 2.5)
    np.testing.assert_array_less(scatter / expected, 2.5)


def test_more_noise_is_more_scatter_and_a_larger_covariance():
    light = light_of(PADS["before"])
    contour = contour_of(light)
    calm, noisy = (
        fit_quad(stored(light, noise).astype(np.float32), wide(), contour) for noise in (2.0, 10.0)
    )
    assert calm is not None
    assert noisy is not None
    assert noisy.scatter > 2 * calm.scatter
    assert np.linalg.det(noisy.covariance).min() > 4 * np.linalg.det(calm.covariance).max()


@pytest.mark.parametrize("direction", [(1, 0), (0, 1), (0, 0)])
def test_what_has_no_area_has_no_four_sides(direction):
    line = np.linspace(0, 1, 50)[:, None] * np.array(direction)
    assert first_corners(np.concatenate([line, line[::-1]])) is None


spots = st.floats(-2.0, 2.0)


@given(spots, spots, st.floats(0.3, 2), st.floats(0.3, 2), spots, st.floats(0.05, 2))
def test_first_corners_of_a_trapezium_are_its_own(left, shift, low_width, high_width, low, height):
    corners = np.array(
        [
            [left, low],
            [left + shift, low + height],
            [left + shift + high_width, low + height],
            [left + low_width, low],
        ]
    )
    share = np.linspace(0, 1, 50, endpoint=False)[:, None]
    sides = [corners[i] + share * (corners[(i + 1) % 4] - corners[i]) for i in range(4)]
    found = first_corners(np.concatenate(sides))
    assert found is not None
    # Lines are fitted in single precision, of points at up to six heights from the middle.
    np.testing.assert_allclose(found, corners, atol=1e-4 * (1 + height))


@given(st.permutations(range(4)))
def test_corners_in_any_order_are_put_in_the_same_order(order):
    corners = np.array([[-1.0, -1.0], [-2.0, 3.0], [4.0, 2.5], [3.0, -1.5]])
    np.testing.assert_array_equal(ordered(corners[list(order)]), corners)
