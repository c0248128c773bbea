from dataclasses import replace

import cv2
import numpy as np
import pytest

from perception.chamber import ChamberStatus, find_points, find_regions
from tests.perception.chamber.drawn import HALF, Ellipse, Scene, points_of

MEASURED = np.array([(1, 0), (0, 1), (1, 0), (1, 0), (0, 1), (1, 0), (1, 1)], bool)
"""The coordinates that the points are for; along the edge they are found far less well."""

CLEAN = 0.1
"""px; without noise there are whole grey levels and the light's falling off across an edge."""

NOISY = 0.3
"""px, for noise of 6 grey levels: three standard deviations in the darkest of these images."""

PLACES = [(0.0, 0.0), (13.27, -8.61), (-21.4, 17.9), (4.83, 24.35)]


@pytest.mark.parametrize("place", PLACES)
def test_points_without_noise(place: tuple[float, float]):
    scene = Scene().moved(*place)
    points = points_of(scene.image())
    assert points.seen.all()
    errors = np.abs(points.xy - scene.points)
    assert errors[MEASURED].max() < CLEAN
    # Along the edge the vertex of a parabola that is 100 times wider than high.
    assert errors.max() < 3 * CLEAN


@pytest.mark.parametrize("gain", [0.4, 1.0, 2.5])
def test_points_in_noise_and_all_light(gain: float):
    for place in PLACES:
        scene = Scene().moved(*place)
        points = points_of(scene.image(gain=gain, noise=6, seed=7))
        assert points.seen.all()
        assert np.abs(points.xy - scene.points)[MEASURED].max() < NOISY


@pytest.mark.parametrize("blur", [0.5, 1.2])
def test_small_squeezed_ellipses(blur: float):
    place = 150.37, 119.81
    scene = Scene(
        240, 320, Ellipse(*place, 88, 52), Ellipse(*place, 25, 33), Ellipse(*place, 9, 12)
    )
    points = points_of(scene.image(blur=blur))
    # The ends of the flat ellipse are twice as bent as circles, over which the blur moves inward.
    assert np.abs(points.xy - scene.points)[MEASURED].max() < 2 * CLEAN


def test_a_turned_image_has_turned_points():
    scene = HALF.moved(7.31, -5.77)
    image = scene.image(noise=3)
    points = points_of(image)
    mirrored = points_of(np.ascontiguousarray(image[:, ::-1]))
    turned = np.array([319, 0]) + mirrored.xy * np.array([-1, 1])
    # The lines of a fit begin at a whole pixel, half a one to the left of the middle at times.
    assert np.allclose(turned[[2, 1, 0, 5, 4, 3, 6]], points.xy, atol=CLEAN / 2)


@pytest.mark.parametrize(
    ("move", "cut"), [((-75, 0), "ad"), ((75, 0), "cf"), ((0, 50), "be"), ((0, -125), "acdef")]
)
def test_the_border_cuts_points(move: tuple[float, float], cut: str):
    scene = replace(HALF, top=None).moved(*move)
    points = points_of(scene.image(noise=3))
    assert {"abcdefg"[number] for number in np.flatnonzero(~points.seen)} == set(cut)
    assert (points.xy[~points.seen] == 0).all()
    if cut == "ad":
        # The others stay where they are.
        off = np.abs(points.xy - scene.points)
        assert max(off[2, 0], off[1, 1]) < NOISY


def test_yellow_out_of_view():
    scene = replace(HALF, yellow=None)
    image = scene.image(noise=4)
    regions = find_regions(image)
    assert regions.status is ChamberStatus.NO_YELLOW
    points = find_points(image, regions)
    assert points.seen.tolist() == [True, True, True, False, False, False, True]
    whole = HALF
    assert np.abs(points.xy - whole.points)[MEASURED & points.seen[:, None]].max() < NOISY


def test_the_centre_of_what_the_border_leaves():
    scene = HALF.moved(0, 60)
    y, x = np.mgrid[:240, :320]
    assert scene.blue is not None
    inside = scene.blue.holds(x, y)
    points = points_of(scene.image(noise=3))
    # Half a pixel of the rim is outside the polygon through pixels' middles.
    assert np.allclose(points.xy[6], [x[inside].mean(), y[inside].mean()], atol=0.5)


def test_a_corner_that_a_nearer_wall_leaves():
    """The leftmost point of the part that two circles share is where they cross."""
    scene = replace(
        HALF, yellow=None, blue=Ellipse(160, 150, 90, 90), opening=Ellipse(160, 60, 90, 90)
    )
    points = points_of(scene.image(noise=3))
    half = np.sqrt(90**2 - 45**2)
    assert points.seen[[0, 1, 2, 6]].all()
    # Blur rounds the corner off, by more than a pixel.
    assert np.allclose(points.xy[[0, 2]], [(160 - half, 105), (160 + half, 105)], atol=2.5)
    assert np.allclose(points.xy[1], (160, 150), atol=NOISY)


def test_highlights_leave_the_points():
    scene = HALF
    image = scene.image(noise=3)
    cv2.circle(image, (159, 48), 8, (255, 255, 255), -1)
    cv2.circle(image, (86, 119), 6, (255, 255, 255), -1)
    assert np.abs(points_of(image).xy - scene.points)[MEASURED].max() < NOISY
