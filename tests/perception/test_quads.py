"""Sides and corners of drawn pads against where an exact camera images them."""

import dataclasses
import functools

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.detection import detect_quads
from perception.lens import Lens
from perception.quads import (
    LEAST_CONTRAST,
    Quad,
    first_corners,
    fit_quad,
    fit_quads,
    follow_quads,
    ordered,
)
from perception.quality import Quality
from tests.perception.drawn import BRIGHT, DARK, Eye, Pad, defocused, drawn, rays_of, stored

NEAR = 0.3
"""A corner is found to so many pixels, in the light of a good finger."""

WIDE = Eye()
LENS = WIDE.lens()
PADS = {
    "before": Pad((20, -14), (22, 12)),
    "below": Pad((12, -30), (20, -18)),
    "above": Pad((30, 5), (18, 26)),
    "near": Pad((15, -10), (19, 16), beside=3),
    "far": Pad((40, -8), (40, 12)),
    "a little round": Pad((20, -14), (22, 12), radius=1.0),
    "round": Pad((20, -14), (22, 12), radius=2.0),
}
FLAT = Pad((10, -22), (33, -62))
"""Its far end is seen at 1.9° from its plane."""


@functools.cache
def light_of(pad: Pad, blur: float = 0.7) -> np.ndarray:
    return cv2.GaussianBlur(drawn(WIDE, [pad]), (0, 0), blur)


def only(gray: np.ndarray, lens: Lens) -> Quad:
    (quad,) = detect_quads(gray, lens)
    return quad


def contour_of(light: np.ndarray) -> np.ndarray:
    """Outermost pixels of a pad that is alone in an image without noise."""
    mask = (light > (DARK + BRIGHT) / 2).astype(np.uint8)
    (contour,) = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    return contour.reshape(-1, 2)


@pytest.mark.parametrize("name", PADS)
def test_corners_are_where_the_sharp_pad_is_imaged_at_every_exposure(name):
    pad = PADS[name]
    calm, quad, dim = (
        only(stored(gain * light_of(pad), noise), LENS)
        for gain, noise in ((1.0, 0.0), (1.0, 2.0), (0.7, 0.0))
    )
    assert quad.quality is Quality.COMPLETE
    np.testing.assert_allclose(quad.corners, WIDE.places(pad.corners()), atol=NEAR)
    # A pixel is 8 mrad here, and slopes change faster than section angles.
    np.testing.assert_allclose(quad.rays, rays_of(pad.corners()), atol=NEAR * 0.02)
    np.testing.assert_allclose(dim.corners, calm.corners, atol=0.1)


def test_something_dark_at_a_side_does_not_move_its_line():
    pad = PADS["before"]
    light = light_of(pad).copy()
    columns, rows = WIDE.places(pad.corners()).T.round().astype(int)
    # It takes a fifth of the left side.
    top, bottom = rows[1], rows[0]
    part = (bottom - top) // 5
    light[top + 2 * part : top + 3 * part, columns[0] - 5 : columns[0] + 15] = DARK
    # The other four fifths wander by a twentieth of a pixel.
    true = only(stored(light_of(pad)), LENS).corners
    np.testing.assert_allclose(only(stored(light), LENS).corners, true, atol=NEAR / 2)


def fitted(light: np.ndarray, pad: Pad) -> Quad:
    """By the contour of the pad itself, whatever lies over it."""
    quad = fit_quad(stored(light).astype(np.float32), LENS, contour_of(light_of(pad)))
    assert quad is not None
    return quad


@pytest.mark.parametrize(
    ("step", "quality"),
    [(LEAST_CONTRAST - 2, Quality.LOW_CONTRAST), (LEAST_CONTRAST + 5, Quality.COMPLETE)],
)
def test_a_low_step_of_brightness_is_too_little_contrast(step, quality):
    pad = PADS["before"]
    quad = fitted(drawn(WIDE, [pad], [lambda places: np.full(len(places), DARK + step)]), pad)
    assert quad.quality is quality
    assert quad.contrast == pytest.approx(step, abs=1)


@pytest.mark.parametrize("tenth", [False, True])
def test_a_side_that_is_not_or_hardly_found_is_not_complete(tenth):
    pad = PADS["before"]
    light = drawn(WIDE, [pad])
    columns, rows = WIDE.places(pad.corners()).T.round().astype(int)
    high, edge = (rows[0] - rows[1]) // 10, light.copy()
    light[:, : columns.min() + 20] = BRIGHT
    if tenth:
        # Light hides all but a tenth of the left side.
        shown = np.s_[rows[1] + 4 * high : rows[1] + 5 * high, : columns.min() + 20]
        light[shown] = edge[shown]
    quad = fitted(light, pad)
    assert quad.quality is not Quality.COMPLETE
    if not tenth:
        assert quad.quality is Quality.LOW_CONTRAST
        assert quad.contrast == pytest.approx(0, abs=1)
    # Where the side is nobody knows, as the covariance states.
    assert np.sqrt(quad.covariance[0, 0, 0]) > 50


@pytest.mark.parametrize("name", ["before", "below", "near", "flat"])
@pytest.mark.parametrize("radius", [1, 6, 8, 12])
def test_no_view_is_complete_that_is_too_blurred_for_its_corners(name, radius):
    pad = PADS.get(name, FLAT)
    quads = detect_quads(stored(defocused(drawn(WIDE, [pad]), radius), noise=1.0), LENS)
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
def test_an_image_turned_over_has_its_corners_turned_over(name):
    gray = stored(light_of(PADS[name]), noise=2.0)
    columns, rows = only(gray, LENS).corners.T
    # Corners go from bottom left clockwise.
    assert max(columns[[0, 1]]) < min(columns[[2, 3]])
    assert min(rows[[0, 3]]) > max(rows[[1, 2]])
    for axis, places, order in (
        (1, (479 - columns, rows), [3, 2, 1, 0]),
        (0, (columns, 359 - rows), [1, 0, 3, 2]),
    ):
        found = only(np.ascontiguousarray(np.flip(gray, axis)), LENS).corners
        np.testing.assert_allclose(found, np.stack(places, axis=-1)[order], atol=0.05)


def test_the_covariance_is_the_scatter_of_repeats():
    errors, predicted, pad = [], [], PADS["below"]
    for number in range(24):
        # Where pixels are against the sides is a part of the error: the pad is moved.
        *move, beside = np.random.default_rng(number).uniform(-0.3, 0.3, 3)
        first, second = (tuple(np.add(end, move)) for end in (pad.first, pad.second))
        moved = Pad(first, second, beside=beside)
        light = cv2.GaussianBlur(drawn(WIDE, [moved]), (0, 0), 0.7)
        for seed in range(2):
            gray = stored(light, noise=5.0, seed=100 * number + seed).astype(np.float32)
            quad = fit_quad(gray, LENS, contour_of(light))
            assert quad is not None
            errors.append(quad.corners - WIDE.places(moved.corners()))
            predicted.append(quad.covariance[:, [0, 1], [0, 1]])
    scatter, expected = np.mean(np.square(errors), axis=0), np.mean(predicted, axis=0)
    # Of variances. How alike neighbouring edges err is estimated from few of them.
    np.testing.assert_array_less(np.abs(np.log(expected / scatter)), np.log(2.5))


def test_of_a_rough_pad_the_covariance_is_roughness_and_of_a_noisy_one_it_is_not():
    light, generator = light_of(PADS["before"]), np.random.default_rng(5)
    rows, columns = np.indices(light.shape, np.float32)
    # Edges are off by 0.7 px, alike over some 8 px.
    off = [cv2.GaussianBlur(generator.standard_normal(light.shape), (0, 0), 4.0) for _ in range(2)]
    across, down = (0.7 * one / one.std() for one in off)
    places = (columns + across.astype(np.float32), rows + down.astype(np.float32))
    rough = cv2.remap(light, *places, cv2.INTER_LINEAR)
    first, second = (only(stored(rough, 2.0, seed), LENS) for seed in (1, 2))
    noisy = only(stored(light, 20.0), LENS)
    own = first.covariance - first.roughness
    # Two pictures of the rough pad differ by much less than both are off.
    off = first.corners - second.corners
    assert np.einsum("ci,cij,cj->c", off, np.linalg.inv(2 * own), off).max() < 3**2
    alike, total = (
        np.trace(part, axis1=1, axis2=2) for part in (first.roughness, first.covariance)
    )
    assert (alike > 0.8 * total).all()
    alike, total = (
        np.trace(part, axis1=1, axis2=2) for part in (noisy.roughness, noisy.covariance)
    )
    assert (alike < 0.6 * total).all()


def test_more_noise_is_more_scatter_and_a_larger_covariance():
    pad = PADS["before"]
    calm, noisy = (only(stored(light_of(pad), noise), LENS) for noise in (2.0, 10.0))
    assert noisy.scatter > 2 * calm.scatter
    assert np.linalg.det(noisy.covariance).min() > 4 * np.linalg.det(calm.covariance).max()


@pytest.mark.parametrize("direction", [(1, 0), (0, 1), (0, 0)])
def test_what_has_no_area_has_no_four_sides(direction):
    line = np.linspace(0, 1, 50)[:, None] * np.array(direction)
    assert first_corners(np.concatenate([line, line[::-1]])) is None


spots = st.floats(-2.0, 2.0)


@given(spots, spots, st.floats(0.3, 2), st.floats(0.3, 2), spots, st.floats(0.05, 2))
def test_first_corners_of_a_trapezium_are_its_own(left, shift, low_width, high_width, low, height):
    columns = left + np.array([0, shift, shift + high_width, low_width])
    corners = np.stack([columns, low + height * np.array([0, 1, 1, 0])], axis=-1)
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


SLIVER = 1.5
"""mm of another pad that are seen beside one, about as many pixels wide as edges are blurred."""


def run_into_another(end: int, gap: float, brighter: float) -> tuple[np.ndarray, np.ndarray]:
    """An image of a pad and of a little of another beside one end, and corners of both as one."""
    pad = PADS["before"]
    ends = [np.asarray(pad.first), np.asarray(pad.second)]
    outward = (2 * end - 1) * pad.step
    other = [ends[end] + part * outward for part in (gap, gap + SLIVER)]
    light = drawn(
        WIDE,
        [pad, Pad(tuple(other[0]), tuple(other[1]))],
        [lambda at: np.full(len(at), 80.0), lambda at: np.full(len(at), brighter * 80.0)],
    )
    ends[end] = other[1]
    gray = stored(cv2.GaussianBlur(light, (0, 0), 0.7), 1.0).astype(np.float32)
    return gray, WIDE.places(Pad(tuple(ends[0]), tuple(ends[1])).corners())


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize(("gap", "brighter"), [(0.0, 1.2), (0.0, 1.8), (0.2, 1.2), (1.0, 1.0)])
def test_a_view_that_has_run_into_a_brighter_one_ends_at_the_seam(end, gap, brighter):
    gray, both = run_into_another(end, gap, brighter)
    (quad,) = follow_quads(gray, LENS, [both], beside=end)
    assert quad is not None
    assert quad.quality is Quality.COMPLETE
    off = quad.corners - WIDE.places(PADS["before"].corners())
    assert np.abs(off).max() < 1.0
    spread = np.linalg.inv(quad.covariance + 0.1**2 * np.eye(2))
    assert np.einsum("ci,cij,cj->c", off, spread, off).max() < 3.5**2


@pytest.mark.parametrize(("dimmed", "only_by_lamp"), [(1.0, True), (0.03, False)])
def test_a_lamp_across_an_end_may_hide_a_part(dimmed, only_by_lamp):
    pad = PADS["before"]
    light, corners = drawn(WIDE, [pad]), WIDE.places(pad.corners())
    (left, top), (right, _) = corners[1:3].astype(int)
    lamps = np.zeros(light.shape, np.uint8)
    lamps[top - 14 : top + 2, left - 20 : right + 20] = 255
    contour = contour_of(light)
    light = np.where(lamps > 0, 1000.0, DARK + dimmed * (light - DARK))
    gray = stored(cv2.GaussianBlur(light, (0, 0), 0.8))
    quad = fit_quad(gray.astype(np.float32), LENS, contour, lamps)
    assert quad is not None
    assert quad.quality is Quality.CLIPPED
    assert quad.before_lamp == only_by_lamp


@pytest.mark.parametrize("end", [0, 1])
def test_where_light_does_not_rise_to_another_view_there_is_no_seam(end):
    pad = PADS["before"]
    gray = stored(light_of(pad), 2.0).astype(np.float32)
    assert follow_quads(gray, LENS, [WIDE.places(pad.corners())]) != [None]
    assert follow_quads(gray, LENS, [WIDE.places(pad.corners())], beside=end) == [None]


def test_each_is_followed_in_the_light_that_is_its_own():
    lights = [light_of(PADS[name]) for name in ("before", "near")]
    first, second = (stored(light, 2.0).astype(np.float32) for light in lights)
    corners = [WIDE.places(PADS[name].corners()) for name in ("before", "near")]
    crossed = corners[0][::-1]
    together = follow_quads([first, first, second], LENS, [corners[0], crossed, corners[1]])
    alone = [follow_quads(first, LENS, corners[:1])[0], follow_quads(second, LENS, corners[1:])[0]]
    assert together[1] is None
    for one, other in zip((together[0], together[2]), alone, strict=True):
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one.corners, other.corners)
    with pytest.raises(ValueError, match="shorter"):
        follow_quads([first], LENS, corners)


def test_quadrilaterals_together_are_those_of_each_by_itself():
    """A pad, a part of it that is followed to the same edges, a line that is none, and a blotch."""
    light = cv2.GaussianBlur(drawn(WIDE, [PADS["before"]]), (0, 0), 0.8)
    gray = stored(light).astype(np.float32)
    contour = contour_of(light)
    middle = contour.mean(axis=0)
    contours = [
        contour,
        np.round(middle + 0.97 * (contour - middle)).astype(contour.dtype),
        np.array([[50, 60], [90, 60]], contour.dtype),
        np.array([[5, 5], [5, 15], [15, 15], [15, 5]], contour.dtype),
    ]
    together = fit_quads(gray, LENS, contours)
    alone = [fit_quad(gray, LENS, one) for one in contours]
    assert [quad is None for quad in together] == [quad is None for quad in alone]
    assert together[0] is not None
    assert together[2] is None
    for one, other in zip(together, alone, strict=True):
        if one is not None and other is not None:
            np.testing.assert_equal(dataclasses.asdict(one), dataclasses.asdict(other))
    assert fit_quads(gray, LENS, []) == []
