"""Views found in rendered frames against the truth about them, and in frames that are none."""

import cv2
import numpy as np
import pytest

from optics.rendering import Effects, TactileImage
from optics.rendering.renderer import TrueView
from perception.detection import detect_quads, detect_views
from perception.matching import Sighting
from perception.quads import Quad
from perception.quality import Quality
from studies.models.sensor.finger_sensor import FingerSensor
from tests.perception.rendered import POSES, analysed, covered, findable, signed_area

NEAR = 2.0
"""Corners are found to so many pixels of 540 rows, in good light and through fair tolerances."""

STEP = np.deg2rad(1.0)
"""From one value of the catalogue to the next."""

FRAMES = range(len(POSES))


def off(sighting: Sighting, view: TrueView) -> float:
    """How far the furthest corner of a view was found from where it is, px."""
    found = sighting.view(view.pad, view.path)
    if found is None or found.quality is not Quality.COMPLETE:
        return np.inf
    assert found.reflections == view.reflections
    return np.abs(found.corners - view.corners).max()


def check_complete(image: TactileImage, sighting: Sighting) -> None:
    """All corners are near the true ones, whether a little of the pad is hidden or not."""
    for view in sighting.complete():
        true = image.view(view.pad, view.path)
        assert true is not None
        assert np.abs(view.corners - true.corners).max() < NEAR, (view.pad, view.path)


def test_every_wanted_view_is_found_somewhere(finger, designed_frames):
    wanted = {(family.pad, family.path) for family in finger.catalog.families if family.wanted}
    seen = {(v.pad, v.path) for f in designed_frames for v in findable(finger, f.image)}
    assert seen == wanted


@pytest.mark.parametrize("number", FRAMES)
@pytest.mark.parametrize("frames", ["designed_frames", "made_frames"])
def test_whole_views_are_found_where_they_are(finger, frames, number, request):
    image, sighting = request.getfixturevalue(frames)[number]
    views = findable(finger, image)
    assert len(views) >= 2
    for view in views:
        assert off(sighting, view) < NEAR, (view.pad, view.path)


@pytest.mark.parametrize("number", FRAMES)
@pytest.mark.parametrize("frames", ["designed_frames", "made_frames"])
def test_what_is_called_complete_is_where_it_is_said_to_be(frames, number, request):
    check_complete(*request.getfixturevalue(frames)[number])


@pytest.mark.parametrize("number", FRAMES)
def test_rough_angles_are_near_the_true_ones(designed_frames, number):
    image, sighting = designed_frames[number]
    # A view hidden in part tells its joint by a whole one's corners only.
    np.testing.assert_allclose(sighting.angles, image.angles, atol=3.5 * STEP)


def test_a_mirror_reverses_handedness(finger, designed_frames):
    direct = {"proximal": set(), "distal": set()}
    mirrored = {"proximal": set(), "distal": set()}
    for image, sighting in designed_frames:
        for view in findable(finger, image):
            found = sighting.view(view.pad, view.path)
            assert found is not None
            if view.pad in direct:
                kind = mirrored if view.reflections else direct
                kind[view.pad].add(np.sign(signed_area(found.corners)))
    assert all(len(signs) == 1 for signs in [*direct.values(), *mirrored.values()])
    assert all(direct[pad] != mirrored[pad] for pad in direct)


def clear_quads(finger: FingerSensor, pixels: np.ndarray) -> list[Quad]:
    """Blotches of the background, which are hardly brighter than it, come and go."""
    quads = detect_quads(np.ascontiguousarray(pixels), finger.lens)
    return [quad for quad in quads if quad.quality is not Quality.LOW_CONTRAST]


@pytest.mark.parametrize("number", [0, 2, 4])
def test_a_frame_turned_left_to_right_has_its_quads_turned(finger, designed_frames, number):
    pixels = designed_frames[number].image.pixels
    quads = clear_quads(finger, pixels)
    turned = clear_quads(finger, pixels[:, ::-1])
    assert len(turned) == len(quads)
    for quad, other in zip(quads, turned, strict=True):
        columns, rows = quad.corners[[3, 2, 1, 0]].T
        assert other.quality is quad.quality
        if quad.quality is Quality.COMPLETE:
            expected = np.stack([719 - columns, rows], axis=-1)
            np.testing.assert_allclose(other.corners, expected, atol=0.3)


@pytest.mark.parametrize("number", [0, 2, 4])
def test_a_frame_turned_upside_down_has_its_quads_turned(finger, designed_frames, number):
    pixels = designed_frames[number].image.pixels
    quads = clear_quads(finger, pixels)
    turned = clear_quads(finger, pixels[::-1])[::-1]
    assert len(turned) == len(quads)
    for quad, other in zip(quads, turned, strict=True):
        columns, rows = quad.corners[[1, 0, 3, 2]].T
        assert other.quality is quad.quality
        if quad.quality is Quality.COMPLETE:
            expected = np.stack([columns, 539 - rows], axis=-1)
            np.testing.assert_allclose(other.corners, expected, atol=0.3)


@pytest.mark.parametrize("number", [1, 2, 3, 4])
@pytest.mark.parametrize("gain", [0.7, 1.3])
def test_exposure_leaves_views_where_they_are(finger, designed_frames, number, gain):
    image, sighting = designed_frames[number]
    brighter = cv2.convertScaleAbs(image.pixels, alpha=gain)
    found = detect_views(brighter, finger.lens, finger.catalog)
    check_complete(image, found)
    for view in findable(finger, image):
        before, after = (one.view(view.pad, view.path) for one in (sighting, found))
        assert before is not None
        assert after is not None
        assert after.quality is Quality.COMPLETE
        np.testing.assert_allclose(after.corners, before.corners, atol=0.5)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_compression_hides_no_view_in_a_dark_finger(finger, noise):
    renderer = finger.renderer(Effects(blur=0.8, jpeg=8, noise=noise), None, seed=1)
    for number, pose in enumerate(POSES):
        image, sighting = analysed(finger, renderer.render(pose, frame=number))
        for view in findable(finger, image):
            assert off(sighting, view) < NEAR, (number, view.pad, view.path)


@pytest.mark.parametrize("pip_deg", [44, 45, 46])
def test_a_view_of_which_a_fiftieth_is_hidden_is_not_complete(finger, pip_deg):
    """The intermediate pad hides the end of the proximal one in its mirror."""
    renderer = finger.renderer(Effects.graded(1.0), None, seed=1)
    image, sighting = analysed(finger, renderer.render(np.deg2rad([pip_deg, 20]), frame=0))
    view = sighting.view("proximal", "mirror:proximal")
    assert view is not None
    assert view.quality is Quality.CLIPPED
    for true in image.views:
        assert not true.complete or (true.pad, true.path) != (view.pad, view.path)


def test_one_channel_is_seen_as_three_equal_ones(finger, designed_frames):
    gray = designed_frames[2].image.pixels.max(axis=-1)
    quads = detect_quads(gray, finger.lens)
    same = detect_quads(np.repeat(gray[..., None], 3, axis=-1), finger.lens)
    assert len(quads) == len(same) > 2
    for quad, other in zip(quads, same, strict=True):
        np.testing.assert_array_equal(quad.corners, other.corners)


def test_quads_come_from_top_to_bottom(finger, designed_frames):
    for image, _ in designed_frames:
        rows = [q.corners[:, 1].mean() for q in detect_quads(image.pixels, finger.lens)]
        assert rows == sorted(rows)


@pytest.mark.parametrize("number", [2, 4])
def test_a_covered_view_is_not_found_and_the_others_stay(finger, designed_frames, number):
    image = designed_frames[number].image
    for view in findable(finger, image):
        hidden = detect_views(covered(image.pixels, view), finger.lens, finger.catalog)
        found = hidden.view(view.pad, view.path)
        assert found is None or found.quality is Quality.MISSING
        for other in findable(finger, image):
            if (other.pad, other.path) != (view.pad, view.path):
                assert off(hidden, other) < NEAR, (other.pad, other.path)


def test_a_covered_pad_that_does_not_move_is_missing(finger, designed_frames):
    image = designed_frames[2].image
    view = image.view("intermediate", "direct")
    assert view is not None
    hidden = detect_views(covered(image.pixels, view), finger.lens, finger.catalog)
    found = hidden.view("intermediate", "direct")
    assert found is not None
    assert found.quality is Quality.MISSING


def shape_of(finger: FingerSensor) -> tuple[int, int, int]:
    return (*finger.lens.shape, 3)


NOTHING = {
    "black": lambda shape: np.zeros(shape, np.uint8),
    "grey": lambda shape: np.full(shape, 90, np.uint8),
    "white": lambda shape: np.full(shape, 255, np.uint8),
    "noise": lambda shape: np.random.default_rng(0).integers(0, 256, shape, np.uint8),
    "blobs": lambda shape: cv2.resize(
        np.random.default_rng(1).integers(0, 256, (6, 8, 3), np.uint8),
        shape[1::-1],
        interpolation=cv2.INTER_CUBIC,
    ),
}


@pytest.mark.parametrize("kind", NOTHING)
def test_frames_without_a_finger_show_none(finger, kind):
    sighting = detect_views(NOTHING[kind](shape_of(finger)), finger.lens, finger.catalog)
    assert sighting.complete() == []
    assert np.isnan(sighting.angles).all()
    # What does not move must be in every image.
    assert {v.quality for v in sighting.views} <= {Quality.MISSING, Quality.CLIPPED}


@pytest.mark.parametrize("part", ["top", "bottom", "left", "right"])
@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_frame_half_covered_has_no_false_view(finger, designed_frames, part, level):
    image, _ = designed_frames[2]
    rows, columns = finger.lens.shape
    halves = {
        "top": np.s_[: rows // 2],
        "bottom": np.s_[rows // 2 :],
        "left": np.s_[:, : columns // 2],
        "right": np.s_[:, columns // 2 :],
    }
    pixels = image.pixels.copy()
    pixels[halves[part]] = level
    sighting = detect_views(pixels, finger.lens, finger.catalog)
    check_complete(image, sighting)
    if part in ("left", "right"):
        # Every view is cut in its middle.
        assert sighting.complete() == []
