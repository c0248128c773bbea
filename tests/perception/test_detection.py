"""Views found in rendered frames against the truth about them, and in frames that are none."""

import cv2
import numpy as np
import pytest

from optics.rendering import Effects, TactileImage
from optics.rendering.renderer import TrueView
from perception.chamber import IN_VIEW, ChamberStatus, find_regions
from perception.detection import detect_quads
from perception.matching import Sighting
from perception.quality import Quality
from tests.perception.rendered import POSES, analysed, covered, findable, signed_area

NEAR = 2.0
"""Corners are found to so many pixels of 540 rows, in good light and through fair tolerances."""

STEP = np.deg2rad(1.0)
"""From one value of the catalogue to the next."""

FRAMES = range(len(POSES))
both_fingers = pytest.mark.parametrize("frames", ["designed_frames", "made_frames"])


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


@both_fingers
def test_whole_views_are_found_where_they_are(finger, frames, request):
    seen = set()
    for image, sighting in request.getfixturevalue(frames):
        check_complete(image, sighting)
        views = findable(finger, image)
        seen |= {(view.pad, view.path) for view in views}
        assert len(views) >= 2
        assert max(off(sighting, view) for view in views) < NEAR
    # Every view that is asked for is found somewhere.
    assert seen == set(finger.model.views)


def test_rough_angles_are_near_the_true_ones(designed_frames):
    for image, sighting in designed_frames:
        # A view hidden in part gives its joint by a whole one's corners only.
        np.testing.assert_allclose(sighting.angles, image.angles, atol=3.5 * STEP)


def test_a_mirror_reverses_handedness(finger, designed_frames):
    signs = {(pad, count): set() for pad in ("proximal", "distal") for count in (0, 1)}
    for image, sighting in designed_frames:
        for view in findable(finger, image):
            found = sighting.view(view.pad, view.path)
            if view.pad != "intermediate":
                signs[view.pad, view.reflections].add(np.sign(signed_area(found.corners)))
    for pad in ("proximal", "distal"):
        (direct,), (mirrored,) = signs[pad, 0], signs[pad, 1]
        assert direct == -mirrored


@pytest.mark.parametrize("number", [0, 2, 4])
@pytest.mark.parametrize("axis", [1, 0], ids=["left to right", "upside down"])
def test_a_frame_turned_over_has_its_quads_turned_over(finger, designed_frames, number, axis):
    def clear(pixels: np.ndarray) -> list:
        # Blotches of the background, little brighter than it, come and go.
        quads = detect_quads(np.ascontiguousarray(pixels), finger.lens)
        return [quad for quad in quads if quad.quality is not Quality.LOW_CONTRAST]

    pixels = designed_frames[number].image.pixels
    quads, turned = clear(pixels), clear(np.flip(pixels, axis))[:: 2 * axis - 1]
    assert len(turned) == len(quads)
    order = [3, 2, 1, 0] if axis else [1, 0, 3, 2]
    for quad, other in zip(quads, turned, strict=True):
        expected = quad.corners[order].copy()
        expected[:, 1 - axis] = pixels.shape[axis] - 1 - expected[:, 1 - axis]
        assert other.quality is quad.quality
        if quad.quality is Quality.COMPLETE:
            np.testing.assert_allclose(other.corners, expected, atol=0.3)
    rows = [quad.corners[:, 1].mean() for quad in detect_quads(pixels, finger.lens)]
    assert rows == sorted(rows)


@pytest.mark.parametrize("number", [1, 4])
@pytest.mark.parametrize("gain", [0.7, 1.3])
def test_exposure_leaves_views_where_they_are(finger, designed_frames, number, gain):
    image, sighting = designed_frames[number]
    found = finger.detect(cv2.convertScaleAbs(image.pixels, alpha=gain))
    check_complete(image, found)
    for view in findable(finger, image):
        before, after = (one.view(view.pad, view.path) for one in (sighting, found))
        assert after.quality is Quality.COMPLETE
        np.testing.assert_allclose(after.corners, before.corners, atol=0.5)


@pytest.mark.parametrize("noise", [0.01, pytest.param(0.0, marks=pytest.mark.nightly)])
def test_compression_hides_no_view_in_a_dark_finger(finger, noise):
    renderer = finger.renderer(Effects(blur=0.8, jpeg=8, noise=noise), None, seed=1)
    for number, pose in enumerate(POSES):
        image, sighting = analysed(finger, renderer.render(pose, frame=number))
        for view in findable(finger, image):
            assert off(sighting, view) < NEAR, (number, view.pad, view.path)


def test_a_view_of_which_a_fiftieth_is_hidden_is_not_complete(finger):
    """The intermediate pad hides the end of the proximal one in its mirror."""
    renderer = finger.renderer(Effects.graded(1.0), None, seed=1)
    for pip_deg in (44, 45, 46):
        image, sighting = analysed(finger, renderer.render(np.deg2rad([pip_deg, 20]), frame=0))
        name = ("proximal", "mirror:proximal")
        found = sighting.view(*name)
        assert found is not None
        assert found.quality is Quality.CLIPPED
        true = image.view(*name)
        assert true is None or not true.complete


def test_one_channel_is_seen_as_three_equal_ones(finger, designed_frames):
    gray = designed_frames[2].image.pixels.max(axis=-1)
    quads = detect_quads(gray, finger.lens)
    same = detect_quads(np.repeat(gray[..., None], 3, axis=-1), finger.lens)
    assert len(quads) == len(same) > 2
    for quad, other in zip(quads, same, strict=True):
        np.testing.assert_array_equal(quad.corners, other.corners)


@pytest.mark.parametrize("number", [2, pytest.param(4, marks=pytest.mark.nightly)])
def test_a_covered_view_is_not_found_and_the_others_stay(finger, designed_frames, number):
    image = designed_frames[number].image
    views = findable(finger, image)
    for view in views:
        hidden = finger.detect(covered(image.pixels, view))
        found = hidden.view(view.pad, view.path)
        # What does not move must be in every image.
        fixed = view.pad == "intermediate"
        assert not fixed if found is None else found.quality is Quality.MISSING
        for other in views:
            assert other is view or off(hidden, other) < NEAR, (other.pad, other.path)


NOTHING = {
    "black": lambda shape, _: np.zeros(shape, np.uint8),
    "grey": lambda shape, _: np.full(shape, 90, np.uint8),
    "white": lambda shape, _: np.full(shape, 255, np.uint8),
    "noise": lambda shape, random: random.integers(0, 256, shape, np.uint8),
    "blobs": lambda shape, random: cv2.resize(
        random.integers(0, 256, (6, 8, 3), np.uint8), shape[1::-1], interpolation=cv2.INTER_CUBIC
    ),
}


@pytest.mark.parametrize("kind", NOTHING)
def test_frames_without_a_finger_show_none(finger, kind):
    shape = (*finger.lens.shape, 3)
    sighting = finger.detect(NOTHING[kind](shape, np.random.default_rng(1)))
    assert sighting.complete() == []
    assert np.isnan(sighting.angles).all()
    assert {v.quality for v in sighting.views} <= {Quality.MISSING, Quality.CLIPPED}


@pytest.mark.parametrize("part", ["top", "bottom", "left", "right"])
@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_frame_half_covered_has_no_false_view(finger, designed_frames, part, level):
    image, _ = designed_frames[2]
    row, column = np.array(finger.lens.shape) // 2
    halves = {"top": np.s_[:row], "bottom": np.s_[row:]}
    halves |= {"left": np.s_[:, :column], "right": np.s_[:, column:]}
    pixels = image.pixels.copy()
    pixels[halves[part]] = level
    sighting = finger.detect(pixels)
    check_complete(image, sighting)
    # Every view is cut in its middle from left to right.
    assert part in ("top", "bottom") or sighting.complete() == []


def test_no_chamber_is_found_in_this_sensor(designed_frames):
    for frame in designed_frames:
        assert find_regions(frame.image.pixels).status not in {*IN_VIEW, ChamberStatus.SWAPPED}
