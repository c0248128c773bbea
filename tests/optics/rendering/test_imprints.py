"""Height maps of objects against their geometry, and smoothing against SciPy's."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from optics.rendering import Imprint, list_imprints, make_height_map
from optics.rendering.imprints import SMOOTHING

STEP = 0.04
ROUNDING = 1e-6
"""Of depths of about 1 mm in float32."""

DEPTH = 0.6

every_kind = pytest.mark.parametrize("kind", list_imprints())


def grid(length: float = 24.0, width: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """Places along a pad and across it from its middle."""
    along = STEP * np.arange(round(length / STEP) + 1)
    across = STEP * np.arange(round(width / STEP) + 1) - width / 2
    along, across = np.meshgrid(along, across, indexing="ij")
    return along, across


def smooth(imprint: Imprint) -> np.ndarray:
    return make_height_map(imprint, *grid(), STEP)


def sharp(imprint: Imprint, along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Heights of places that are too far from each other to be smoothed together."""
    return make_height_map(imprint, np.atleast_2d(along), np.atleast_2d(across), 1000.0)


def test_a_sphere_is_a_cap():
    imprint = Imprint("sphere", 12.0, 1.0, DEPTH)
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-5, 5, (2, 200))
    # By Pythagoras about a centre 8 mm above the lowest place.
    wanted = np.maximum(np.sqrt(64 - x**2 - y**2) - (8 - DEPTH), 0)
    np.testing.assert_allclose(sharp(imprint, 12 + x, 1 + y)[0], wanted, atol=ROUNDING)
    assert sharp(imprint, np.array([12.0]), np.array([1.0])) == pytest.approx(DEPTH)


@pytest.mark.parametrize(("diameter", "depth"), [(6.0, 1.0), (1.0, 0.5), (12.0, 0.2)])
def test_a_contact_has_its_diameter_and_depth(diameter, depth):
    imprint = Imprint.of_contact(12.0, -1.0, diameter, depth)
    turns = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    for share, inside in ((0.99, True), (1.01, False)):
        off = share * diameter / 2 * np.array([np.cos(turns), np.sin(turns)])
        heights = sharp(imprint, 12 + off[0], off[1] - 1)
        assert ((heights > 0) == inside).all()
    assert sharp(imprint, np.array([12.0]), np.array([-1.0])) == pytest.approx(depth)
    # Places on an arc see its chord under one angle (the inscribed angle theorem).
    along = np.linspace(-0.45, 0.45, 10) * diameter
    heights = sharp(imprint, 12 + along, np.full(10, -1.0))[0]
    first, last = (
        np.arctan2(heights, along + diameter / 2),
        np.arctan2(heights, diameter / 2 - along),
    )
    np.testing.assert_allclose(first + last, 2 * np.arctan(2 * depth / diameter), atol=1e-6)


def test_the_balls_of_an_array_are_nine():
    imprint = Imprint("ball array", 12.0, 0.0, DEPTH)
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-10, 10, (2, 2000))
    wanted = np.zeros_like(x)
    for i in (-4, 0, 4):
        for j in (-4, 0, 4):
            cap = np.sqrt(np.maximum(4 - (x - i) ** 2 - (y - j) ** 2, 0)) - (2 - DEPTH)
            wanted = np.maximum(wanted, cap)
    np.testing.assert_allclose(sharp(imprint, 12 + x, y)[0], wanted, atol=ROUNDING)


def test_a_brick_has_four_round_studs():
    imprint = Imprint("studded brick", 12.0, 0.0, DEPTH)
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-8, 8, (2, 2000))
    heights = sharp(imprint, 12 + x, y)[0]
    centers = np.array([4 + 4j, 4 - 4j, -4 + 4j, -4 - 4j])
    nearest = np.abs((x + 1j * y)[:, None] - centers).min(axis=1)
    np.testing.assert_allclose(heights, np.where(nearest < 4.8 / 2, DEPTH, 0), atol=ROUNDING)


def test_an_edge_is_a_ridge_of_a_right_angle_across_the_pad():
    imprint = Imprint("edge", 12.0, 3.0, DEPTH)
    x = np.linspace(-1, 1, 21)
    wanted = np.interp(np.abs(x), [0, DEPTH], [DEPTH, 0])  # 45° on both sides
    for across in (-9.0, 0.0, 9.0):
        heights = sharp(imprint, 12 + x, np.full(21, across))[0]
        np.testing.assert_allclose(heights, wanted, atol=ROUNDING)


def test_a_thread_has_its_pitch_depth_and_diameter():
    imprint = Imprint("screw thread", 12.0, 0.0, DEPTH)
    pitch, height, radius = 0.45, 0.27, 1.25
    turns = pitch * np.arange(-10, 11)
    crests = sharp(imprint, np.full(21, 12.0), turns)
    np.testing.assert_allclose(crests, DEPTH, atol=ROUNDING)
    roots = sharp(imprint, np.full(21, 12.0), turns + pitch / 2)
    np.testing.assert_allclose(roots, DEPTH - height, atol=ROUNDING)
    # At both sides it is the outline of a cylinder, and leans by half a pitch from one to another.
    x, y = np.linspace(-1, 1, 41), np.linspace(-pitch / 2, pitch / 2, 901)
    along, across = np.meshgrid(12 + x, y, indexing="ij")
    heights = sharp(imprint, along, across)
    circle = np.maximum(np.sqrt(radius**2 - x**2) - (radius - DEPTH), 0)
    np.testing.assert_allclose(heights.max(axis=1), circle, atol=1e-5)
    at_crest = y[heights.argmax(axis=1)]
    pressed = (circle > 0.05) & (np.abs(at_crest) < 0.8 * pitch / 2)
    lean = np.polyfit(x[pressed], at_crest[pressed], 1)[0] * 2 * radius
    assert abs(lean) == pytest.approx(pitch / 2, rel=0.01)


@every_kind
def test_turned_and_moved_objects_are_the_same_objects(kind):
    rng = np.random.default_rng(3)
    places = rng.uniform(-6, 6, 300) + 1j * rng.uniform(-6, 6, 300)
    moved = (12 - 2j) + places * np.exp(0.4j)
    still = sharp(Imprint(kind, 0.0, 0.0, DEPTH), places.real, places.imag)
    turned = sharp(Imprint(kind, 12.0, -2.0, DEPTH, turn=0.4), moved.real, moved.imag)
    # A place on a stud's rim may fall on either side of it.
    np.testing.assert_allclose(np.sort(turned[0]), np.sort(still[0]), atol=1e-5)
    np.testing.assert_allclose(turned, still, atol=1e-5)


@every_kind
def test_the_gel_follows_smoothly(kind):
    imprint = Imprint(kind, 11.3, -1.2, DEPTH, turn=0.3)
    along, across = grid()
    unsmoothed = make_height_map(imprint, along, across, 1000.0)
    wanted = gaussian_filter(unsmoothed.astype(float), SMOOTHING / STEP, mode="mirror")
    np.testing.assert_allclose(smooth(imprint), wanted, atol=10 * ROUNDING)
    assert smooth(imprint).dtype == np.float32
    assert smooth(imprint).min() >= 0
    assert DEPTH / 2 < smooth(imprint).max() <= DEPTH + ROUNDING
    for depth in (0.0, -1.0):  # what does not touch leaves nothing
        assert not smooth(Imprint(kind, 12.0, depth=depth)).any()


def test_unknown_objects_are_refused_by_naming_the_known_ones():
    with pytest.raises(ValueError, match=r"'cube'.*sphere.*screw thread"):
        smooth(Imprint("cube", 12.0))
