"""Places of pads against a camera in three dimensions; chequered and pressed pads unwarped."""

import dataclasses
import functools

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optics.rendering import Imprint
from perception.detection import detect_quads
from perception.matching import View
from perception.quality import Quality
from perception.unwarping import (
    PER_MM,
    least_scale,
    map_to_image,
    map_to_pad,
    map_to_pad_affinely,
    select_view,
    unwarp,
)
from tests.perception.drawn import Eye, Pad, drawn, exact_view, stored
from tests.perception.rendered import analysed

EYE = Eye(540, 720, focal=193.0)
LENS = EYE.lens()
PADS = {
    "before": Pad((20, -12), (22, 12)),
    "below": Pad((21, -20), (8, -36), width=20.0),
    "beside": Pad((18, -10), (19, 10), beside=4),
}
SQUARE = 2.0
"""Side of the squares of a chequerboard, mm."""


def lattice(pad: Pad, count: int = 9) -> np.ndarray:
    along = np.linspace(0, pad.length, count)
    across = pad.width * np.linspace(-0.5, 0.5, count)
    return np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("name", PADS)
def test_places_are_imaged_where_the_camera_images_them(name):
    pad = PADS[name]
    places = lattice(pad)
    found = map_to_image(exact_view(EYE, pad), LENS, places, pad.length, pad.width)
    # The homography is found in single precision.
    np.testing.assert_allclose(found, EYE.places(pad.points(places)), atol=1e-3)


@given(st.sampled_from(sorted(PADS)), st.floats(0, 1), st.floats(-0.5, 0.5))
def test_pad_and_image_invert_each_other(name, along, across):
    pad = PADS[name]
    view = exact_view(EYE, pad)
    place = np.array([[along * pad.length, across * pad.width]])
    there = map_to_image(view, LENS, place, pad.length, pad.width)
    back = map_to_pad(view, LENS, there, pad.length, pad.width)
    # Rays are looked up between pixels, to a 60th of a pixel.
    np.testing.assert_allclose(back, place, atol=0.01)


@pytest.mark.parametrize("name", PADS)
def test_places_of_the_image_are_those_that_rays_meet(name):
    pad = PADS[name]
    middle = EYE.places(pad.points(np.array([[pad.length / 2, 0.0]])))
    places = middle + np.random.default_rng(0).uniform(-20, 20, (100, 2))
    found = map_to_pad(exact_view(EYE, pad), LENS, places, pad.length, pad.width)
    np.testing.assert_allclose(found, pad.met(EYE.directions(places)), atol=0.01)


def turned(view: View, length: float) -> View:
    """The same view of a pad whose ends have changed names."""
    order = [1, 0, 3, 2]
    return dataclasses.replace(view, corners=view.corners[order], rays=view.rays[order])


def test_places_go_from_the_first_end():
    pad = PADS["before"]
    view, places = exact_view(EYE, pad), lattice(pad)
    there = map_to_image(turned(view, pad.length), LENS, places, pad.length, pad.width)
    opposite = np.stack([pad.length - places[:, 0], places[:, 1]], axis=-1)
    expected = map_to_image(view, LENS, opposite, pad.length, pad.width)
    np.testing.assert_allclose(there, expected, atol=1e-3)


def chequered(places: np.ndarray) -> np.ndarray:
    odd = np.floor(places / SQUARE).astype(int).sum(axis=-1) % 2
    return np.where(odd, 70.0, 180.0)


@functools.cache
def chequered_image(name: str) -> np.ndarray:
    light = cv2.GaussianBlur(drawn(EYE, [PADS[name]], [chequered]), (0, 0), 0.6)
    return np.repeat(stored(light)[..., None], 3, axis=-1)


def crossings(pad: Pad) -> np.ndarray:
    """Where four squares meet, two squares and more from the sides."""
    along = SQUARE * np.arange(2, pad.length / SQUARE - 1)
    half = int(pad.width / 2 / SQUARE) - 2
    across = SQUARE * np.arange(-half, half + 1)
    return np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("name", PADS)
def test_a_chequered_pad_comes_out_as_a_chequerboard(name):
    pad = PADS[name]
    picture = unwarp(chequered_image(name), exact_view(EYE, pad), LENS, pad.length, pad.width)
    assert picture.shape == (round(pad.length * PER_MM), round(pad.width * PER_MM), 3)
    true = crossings(pad)
    guess = (true + np.array([0, pad.width / 2]))[:, None, ::-1] * PER_MM - 0.5
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
    gray = np.ascontiguousarray(picture[..., 0])
    found = cv2.cornerSubPix(gray, guess.astype(np.float32), (7, 7), (-1, -1), criteria)
    places = (found[:, 0, ::-1] + 0.5) / PER_MM - [0, pad.width / 2]
    assert np.hypot(*(places - true).T).max() < 0.1


@pytest.mark.parametrize("name", PADS)
def test_single_samples_are_where_they_should_be(name):
    # The brightness tells the place: 4 levels for a sample of 0.1 mm, and half of one for rounding.
    pad = dataclasses.replace(PADS[name], width=6.0)
    for axis, slope in ((0, 40.0), (1, 40.0)):
        steep = 255 / slope
        light = drawn(EYE, [pad], [lambda p, a=axis, s=steep: 255 * (p[:, a] % s) / s])
        picture = unwarp(stored(light), exact_view(EYE, pad), LENS, pad.length, pad.width)
        samples = [(np.arange(n) + 0.5) / PER_MM for n in picture.shape]
        places = np.stack(np.meshgrid(*samples, indexing="ij"), axis=-1) - [0, pad.width / 2]
        part = places[..., axis] % steep
        shown = picture / 255 * steep
        # Away from where the brightness jumps, and from the sides.
        sure = (part > 1) & (part < steep - 1)
        sure[:10] = sure[-10:] = sure[:, :10] = sure[:, -10:] = False
        assert sure.sum() > 1000
        assert np.abs(shown - part)[sure].max() < 0.06


@pytest.mark.parametrize("name", PADS)
def test_an_affine_map_is_off_by_millimetres(name):
    pad = PADS[name]
    view, places = exact_view(EYE, pad), lattice(pad)
    there = EYE.places(pad.points(places))
    affine = map_to_pad_affinely(view, there, pad.length, pad.width)
    exact = map_to_pad(view, LENS, there, pad.length, pad.width)
    assert np.hypot(*(affine - places).T).max() > 1
    assert np.hypot(*(exact - places).T).max() < 0.05


def test_an_affine_map_of_a_parallelogram_is_exact():
    pad = Pad((20, 0), (20, 10))
    corners = np.array([[100.0, 300.0], [120.0, 200.0], [260.0, 220.0], [240.0, 320.0]])
    view = dataclasses.replace(exact_view(EYE, pad), corners=corners)
    found = map_to_pad_affinely(view, corners[:1] / 2 + corners[2:3] / 2, 10.0, 24.0)
    np.testing.assert_allclose(found, [[5.0, 0.0]], atol=1e-9)


@pytest.mark.parametrize("name", PADS)
def test_the_least_scale_is_that_of_the_camera(name):
    pad = PADS[name]
    along = np.linspace(0, pad.length, 41)
    across = pad.width * np.linspace(-0.5, 0.5, 41)
    places = np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1)
    small = 1e-4
    steps = [
        (EYE.places(pad.points(places + move)) - EYE.places(pad.points(places - move)))
        / (2 * small)
        for move in small * np.eye(2)
    ]
    least = np.linalg.svd(np.stack(steps, axis=-1), compute_uv=False)[..., -1].min()
    found = least_scale(exact_view(EYE, pad), LENS, pad.length, pad.width)
    # It looks at 25 places, the corners among them, by steps of 0.1 mm.
    assert found == pytest.approx(least, rel=0.02)


def test_the_scale_straight_before_a_pinhole_is_focal_length_over_distance():
    eye = Eye(540, 720, focal=400.0, pinhole=True)
    pad = Pad((50, -8), (50, 8))
    scale = least_scale(exact_view(eye, pad), eye.lens(), pad.length, pad.width)
    assert scale == pytest.approx(400 / 50, rel=1e-4)


NEAR_AND_FLAT = exact_view(EYE, Pad((12, -14), (4, -36)), path="flat", area=9000.0)
FAR_AND_STRAIGHT = exact_view(EYE, Pad((30, -12), (30, 11.4)), path="straight", area=8000.0)


@pytest.mark.parametrize(("by", "path"), [("area", "flat"), ("scale", "straight")])
@pytest.mark.parametrize("order", [1, -1])
def test_the_best_view_is_the_largest_or_the_one_of_the_greatest_least_scale(by, path, order):
    views = [NEAR_AND_FLAT, FAR_AND_STRAIGHT][::order]
    best = select_view(views, LENS, 23.4, 24.0, by=by)
    assert best is not None
    assert best.path == path


def test_only_complete_views_are_best():
    poor = [dataclasses.replace(NEAR_AND_FLAT, quality=q) for q in Quality if q.name != "COMPLETE"]
    assert select_view(poor, LENS, 23.4, 24.0) is None
    assert select_view([], LENS, 23.4, 24.0, by="area") is None
    for by in ("area", "scale"):
        best = select_view([*poor, FAR_AND_STRAIGHT], LENS, 23.4, 24.0, by=by)
        assert best is FAR_AND_STRAIGHT


def test_a_drawn_pad_is_unwarped_by_the_corners_found():
    pad = PADS["below"]
    (quad,) = detect_quads(stored(drawn(EYE, [pad])), LENS)
    # Its lower end is the second one.
    order = [1, 0, 3, 2]
    view = dataclasses.replace(
        exact_view(EYE, pad), corners=quad.corners[order], rays=quad.rays[order]
    )
    places = lattice(pad)
    found = map_to_pad(view, LENS, EYE.places(pad.points(places)), pad.length, pad.width)
    np.testing.assert_allclose(found, places, atol=0.1)


@pytest.mark.parametrize(("pad", "pose"), [("proximal", (50, 45)), ("distal", (60, 60))])
def test_an_imprint_is_at_the_same_place_in_both_views(finger, perfect, pad, pose):
    length, width = finger.catalog.lengths[pad], finger.width
    true = np.array([0.3 * length, 4.0])
    pressed = Imprint("sphere", along=true[0], across=true[1], depth=1.0)
    angles = np.deg2rad(np.array(pose, float))
    before = analysed(finger, perfect.render(angles))
    after = perfect.render(angles, {pad: [pressed]})
    views = [view for view in before.sighting.complete() if view.pad == pad]
    assert sorted(view.reflections for view in views) == [0, 1]
    for view in views:
        pictures = [
            unwarp(image.pixels, view, finger.lens, length, width).astype(float)
            for image in (before.image, after)
        ]
        changed = np.abs(pictures[1] - pictures[0]).sum(axis=-1)
        # The sides change by light that is blurred into them, the imprint by much more.
        weight = np.where(changed > 0.2 * changed.max(), changed, 0)
        along, across = (np.arange(n) + 0.5 for n in weight.shape)
        total = weight.sum()
        found = np.array(
            [weight.sum(axis=1) @ along / total, weight.sum(axis=0) @ across / total]
        ) / PER_MM - [0, width / 2]
        # The ball shades an area of 8 mm, seen at a few pixels per mm.
        np.testing.assert_allclose(found, true, atol=0.5)
