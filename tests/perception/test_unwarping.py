"""Places of pads against a camera in three dimensions; pads unwarped."""

import dataclasses

import numpy as np
import pytest

from perception.places import find_places_in_air
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

EYE = Eye(540, 720, focal=193.0)
LENS = EYE.lens()
PADS = {
    "before": Pad((20, -12), (22, 12)),
    "below": Pad((21, -20), (8, -36), width=20.0),
    "beside": Pad((18, -10), (19, 10), beside=4),
}


@pytest.mark.parametrize("name", PADS)
def test_places_are_imaged_where_the_camera_images_them_and_back(name):
    pad = PADS[name]
    view, places = exact_view(EYE, pad), pad.lattice(9).reshape(-1, 2)
    size = pad.length, pad.width
    there = EYE.places(pad.points(places))
    # The homography is found in single precision.
    np.testing.assert_allclose(map_to_image(view, LENS, places, *size), there, atol=1e-3)
    # Rays are looked up between pixels, to a 60th of a pixel.
    np.testing.assert_allclose(map_to_pad(view, LENS, there, *size), places, atol=0.01)
    # An affine map is off by millimetres.
    affine = map_to_pad_affinely(view, there, *size)
    assert np.hypot(*(affine - places).T).max() > 1
    # With its ends exchanged a view shows the pad from its other end.
    order = [1, 0, 3, 2]
    turned = dataclasses.replace(view, corners=view.corners[order], rays=view.rays[order])
    opposite = np.stack([pad.length - places[:, 0], places[:, 1]], axis=-1)
    np.testing.assert_allclose(map_to_image(turned, LENS, opposite, *size), there, atol=1e-3)


@pytest.mark.parametrize("name", PADS)
def test_single_samples_are_where_they_should_be(name):
    # The brightness gives the place: 4 levels for a sample of 0.1 mm, and half of one for rounding.
    pad = dataclasses.replace(PADS[name], width=6.0)
    for axis, slope in ((0, 40.0), (1, 40.0)):
        steep = 255 / slope
        light = drawn(EYE, [pad], [lambda p, a=axis, s=steep: 255 * (p[:, a] % s) / s])
        picture = unwarp(stored(light), exact_view(EYE, pad), LENS, pad.length, pad.width)
        assert picture.shape == (round(pad.length * PER_MM), round(pad.width * PER_MM))
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
def test_the_least_scale_is_that_of_the_camera(name):
    pad = PADS[name]
    places, small = pad.lattice(41), 1e-4
    steps = [
        (EYE.places(pad.points(places + move)) - EYE.places(pad.points(places - move)))
        / (2 * small)
        for move in small * np.eye(2)
    ]
    least = np.linalg.svd(np.stack(steps, axis=-1), compute_uv=False)[..., -1].min()
    found = least_scale(exact_view(EYE, pad), LENS, pad.length, pad.width)
    # It looks at 25 places, the corners among them, by steps of 0.1 mm.
    assert found == pytest.approx(least, rel=0.02)


NEAR_AND_FLAT = exact_view(EYE, Pad((12, -14), (4, -36)), path="flat", area=9000.0)
FAR_AND_STRAIGHT = exact_view(EYE, Pad((30, -12), (30, 11.4)), path="straight", area=8000.0)


@pytest.mark.parametrize(("by", "path"), [("area", "flat"), ("scale", "straight")])
def test_the_best_view_is_the_largest_or_the_one_of_the_greatest_least_scale(by, path):
    views = [NEAR_AND_FLAT, FAR_AND_STRAIGHT]
    poor = [dataclasses.replace(NEAR_AND_FLAT, quality=q) for q in Quality if q.name != "COMPLETE"]
    for several in (views, views[::-1], [*poor, *views]):
        best = select_view(several, LENS, 23.4, 24.0, by=by)
        assert best is not None
        assert best.path == path
    # Only complete views count.
    assert select_view([*poor, FAR_AND_STRAIGHT], LENS, 23.4, 24.0, by=by) is FAR_AND_STRAIGHT
    for nothing in (poor, []):
        assert select_view(nothing, LENS, 23.4, 24.0, by=by) is None


def test_places_that_are_handed_in_replace_those_of_the_corners():
    pad = PADS["before"]
    view, size = exact_view(EYE, pad), (pad.length, pad.width)
    light = drawn(EYE, [pad], [lambda p: 40 + 8 * p[:, 0]])
    in_air = find_places_in_air(view, LENS, *size)
    plain = unwarp(stored(light), view, LENS, *size).astype(int)
    same = unwarp(stored(light), view, LENS, *size, in_air).astype(int)
    assert np.abs(same - plain)[5:-5, 5:-5].max() <= 1
    onward = np.array([1.0, 0, 0])
    moved = unwarp(stored(light), view, LENS, *size, lambda p: in_air(p + onward)).astype(int)
    off = (moved - plain)[5:-25, 5:-5]
    assert np.median(off) == 8
