"""Views found in rendered frames against the truth about them, and in frames that are none."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import cv2
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.ndimage

from optics.rendering import Effects, Imprint, Renderer, TactileImage, TrueView
from perception.chamber import IN_VIEW, ChamberStatus, find_regions
from perception.detection import detect_quads
from perception.matching import Sighting
from perception.quality import Quality
from perception.unwarping import PER_MM
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.spec import FingerImagesSpec
from tests.perception.drawn import Eye, rays_of

POSES = np.deg2rad([[5, 5], [15, 70], [30, 30], [50, 45], [60, 60], [75, 20], [70, 85]])
"""Joint angles in which all views are seen well at one time or another, rad."""

NEAR = 2.0
"""Corners are found to so many pixels of 540 rows, in good light and through fair tolerances."""

STEP = np.deg2rad(1.0)
"""From one value of the catalogue to the next."""


class Frame(NamedTuple):
    """A frame, and what was found in it."""

    image: TactileImage
    sighting: Sighting


@pytest.fixture(scope="module")
def finger() -> FingerSensor:
    return FingerSensor.of(FingerImagesSpec(), rows=540)


@pytest.fixture(scope="module")
def designed_frames(finger: FingerSensor) -> list[Frame]:
    """Frames of the finger as designed, in the light of a good one."""
    return frames_of(finger, finger.renderer(Effects.graded(1.0), None, seed=1))


@pytest.fixture(scope="module")
def made_frames(finger: FingerSensor) -> list[Frame]:
    """The same of a finger that was made with errors, its lens as designed."""
    errors, _ = finger.made(0, 1)
    errors = eqx.tree_at(lambda e: e.distortion, errors, None, is_leaf=lambda leaf: leaf is None)
    # Of the types that no errors have: it is compiled once.
    errors = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)), errors)
    return frames_of(finger, finger.renderer(Effects.graded(1.0), errors, seed=2))


def frames_of(finger: FingerSensor, renderer: Renderer, poses: np.ndarray = POSES) -> list[Frame]:
    images = [renderer.render(pose, frame=number) for number, pose in enumerate(poses)]
    return [Frame(image, finger.detect(image.pixels)) for image in images]


def findable(finger: FingerSensor, image: TactileImage) -> list[TrueView]:
    """Views that are asked for, and whole and off the border."""
    whole = (view for view in image.views if view.complete and not view.at_border)
    return [view for view in whole if (view.pad, view.path) in finger.model.views]


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


@pytest.mark.parametrize("frames", ["designed_frames", "made_frames"])
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


@pytest.mark.parametrize("gain", [0.7, 1.3])
def test_exposure_leaves_views_where_they_are(finger, designed_frames, gain):
    image, sighting = designed_frames[4]
    found = finger.detect(cv2.convertScaleAbs(image.pixels, alpha=gain))
    check_complete(image, found)
    for view in findable(finger, image):
        before, after = (one.view(view.pad, view.path) for one in (sighting, found))
        assert after.quality is Quality.COMPLETE
        np.testing.assert_allclose(after.corners, before.corners, atol=0.5)


def test_compression_hides_no_view_in_a_dark_finger(finger):
    renderer = finger.renderer(Effects(blur=0.8, jpeg=8, noise=0.01), None, seed=1)
    for image, sighting in frames_of(finger, renderer, POSES[::2]):
        for view in findable(finger, image):
            assert off(sighting, view) < NEAR, (view.pad, view.path)


LIGHTS = {
    "lamps": Effects(lamps=9.0, shadows=0.5, ambient=0.02, blur=0.8, noise=0.01),
    "lamps in view": Effects(lamps=4.0, strips=1.0, walls=0.04, blur=0.8, noise=0.01),
    "response": Effects(lamps=4.0, ambient=0.02, blur=0.8, noise=0.01, gamma=2.2),
    "out of focus": Effects(defocus=60.0, ambient=0.02, noise=0.01),
}


@pytest.mark.parametrize("light", LIGHTS)
def test_uneven_light_lamps_and_defocus_hide_no_view(finger, light):
    effects = LIGHTS[light]
    response = 255 * (np.arange(256) / 255) ** effects.gamma
    known = dataclasses.replace(finger, lens=dataclasses.replace(finger.lens, response=response))
    renderer = finger.renderer(effects, None, seed=1)
    for image, sighting in frames_of(known, renderer, POSES[::2]):
        for view in findable(finger, image):
            found = sighting.view(view.pad, view.path)
            assert found is not None
            assert found.quality is Quality.COMPLETE
            off = found.corners - view.corners
            covariance = found.covariance + 0.25**2 * np.eye(2)
            far = np.einsum("ci,cij,cj->c", off, np.linalg.inv(covariance), off)
            assert (np.hypot(*off.T) < NEAR).all() or far.max() < 4**2, (view.pad, view.path)


def test_a_view_of_which_a_fiftieth_is_hidden_is_not_complete(finger):
    """The intermediate pad hides the end of the proximal one in its mirror."""
    renderer = finger.renderer(Effects.graded(1.0), None, seed=1)
    ((image, sighting),) = frames_of(finger, renderer, np.deg2rad([[45, 20]]))
    name = ("proximal", "mirror:proximal")
    assert [v.quality for v in sighting.views if (v.pad, v.path) == name] == [Quality.CLIPPED]
    true = image.view(*name)
    assert true is None or not true.complete


def test_one_channel_is_seen_as_three_equal_ones(finger, designed_frames):
    gray = designed_frames[2].image.pixels.max(axis=-1)
    quads = detect_quads(gray, finger.lens)
    same = detect_quads(np.repeat(gray[..., None], 3, axis=-1), finger.lens)
    assert len(quads) == len(same) > 2
    rows = [quad.corners[:, 1].mean() for quad in quads]
    assert rows == sorted(rows)
    for quad, other in zip(quads, same, strict=True):
        np.testing.assert_array_equal(quad.corners, other.corners)


def covered(pixels: np.ndarray, view: TrueView, margin: int = 12) -> np.ndarray:
    """An image in which something black hides a view."""
    hidden = pixels.copy()
    low, high = view.corners.min(axis=0) - margin, view.corners.max(axis=0) + margin
    cv2.rectangle(hidden, low.astype(int).tolist(), high.astype(int).tolist(), (0, 0, 0), -1)
    return hidden


def test_a_covered_view_is_not_found_and_the_others_stay(finger, designed_frames):
    image = designed_frames[2].image
    views = findable(finger, image)
    for view in views:
        hidden = finger.detect(covered(image.pixels, view))
        found = hidden.view(view.pad, view.path)
        # What does not move must be in every image.
        fixed = view.pad == "intermediate"
        assert not fixed if found is None else found.quality is Quality.MISSING
        for other in views:
            assert other is view or off(hidden, other) < NEAR, (other.pad, other.path)


SHAPE, RANDOM = (540, 720, 3), np.random.default_rng(1)
COARSE = RANDOM.integers(0, 256, (6, 8, 3), np.uint8)
NOTHING = {str(level): np.full(SHAPE, level, np.uint8) for level in (0, 90, 255)} | {
    "noise": RANDOM.integers(0, 256, SHAPE, np.uint8),
    "blobs": cv2.resize(COARSE, SHAPE[1::-1], interpolation=cv2.INTER_CUBIC),
}


@pytest.mark.parametrize("kind", NOTHING)
def test_frames_without_a_finger_show_none(finger, kind):
    sighting = finger.detect(NOTHING[kind])
    assert sighting.complete() == []
    assert np.isnan(sighting.angles).all()
    assert {v.quality for v in sighting.views} <= {Quality.MISSING, Quality.CLIPPED}


ROW, COLUMN = SHAPE[0] // 2, SHAPE[1] // 2
HALVES = {"top": np.s_[:ROW], "bottom": np.s_[ROW:]}
HALVES |= {"left": np.s_[:, :COLUMN], "right": np.s_[:, COLUMN:]}


@pytest.mark.parametrize("part", HALVES)
@pytest.mark.parametrize("level", [0, 255])
def test_a_frame_half_covered_has_no_false_view(finger, designed_frames, part, level):
    image = designed_frames[2].image
    pixels = image.pixels.copy()
    pixels[HALVES[part]] = level
    sighting = finger.detect(pixels)
    check_complete(image, sighting)
    # Every view is cut in its middle from left to right.
    assert part in ("top", "bottom") or sighting.complete() == []


def test_no_chamber_is_found_in_this_sensor(designed_frames):
    for frame in designed_frames:
        assert find_regions(frame.image.pixels).status not in {*IN_VIEW, ChamberStatus.SWAPPED}


def test_the_fingers_lens_is_the_equidistant_formula(finger):
    rows, columns = finger.lens.shape
    # 80° from the axis are imaged at the border.
    eye = Eye(rows, columns, focal=rows / 2 / np.deg2rad(80))
    places = eye.grid()
    within = np.linalg.norm(places - eye.middle, axis=-1) < eye.focal
    exact = rays_of(eye.directions(places[within]))
    np.testing.assert_allclose(finger.lens.ray_map[within], exact, atol=1e-6)
    np.testing.assert_allclose(finger.lens.project(exact), places[within], atol=1e-6)


@pytest.mark.parametrize(("pad", "pose"), [("proximal", (50, 45)), ("distal", (60, 60))])
def test_an_imprint_is_at_the_same_place_in_both_views(finger, pad, pose):
    true = np.array([0.3 * finger.catalog.lengths[pad], 4.0])
    pressed = Imprint("sphere", along=true[0], across=true[1], depth=1.0)
    angles = np.deg2rad(np.array(pose, float))
    renderer = finger.renderer(Effects(), None, seed=0)
    before, after = (renderer.render(angles, touch) for touch in ({}, {pad: [pressed]}))
    views = [view for view in finger.detect(before.pixels).complete() if view.pad == pad]
    assert sorted(view.reflections for view in views) == [0, 1]
    for view in views:
        plain, touched = (finger.unwarp(one.pixels, view).astype(float) for one in (before, after))
        changed = np.abs(touched - plain).sum(axis=-1)
        # The sides change by light that is blurred into them, the imprint by much more.
        weight = np.where(changed > 0.2 * changed.max(), changed, 0)
        middle = scipy.ndimage.center_of_mass(weight)
        found = (np.array(middle) + 0.5) / PER_MM - [0, finger.width / 2]
        # The ball shades an area of 8 mm, seen at a few pixels per mm.
        np.testing.assert_allclose(found, true, atol=0.5)
