"""Contacts in pictures by other formulas, in noise, and in a path tracer's picture."""

from __future__ import annotations

import importlib.util
import math

import cv2
import numpy as np
import pytest

from designopt import UserError
from perception.contacts import find_contacts
from perception.contacts.change import Change
from perception.contacts.fitting import (
    COMPRESSED_SPREADS,
    SPREAD,
    Fit,
    fit,
    mean_of,
    start_at,
)
from perception.places import Sight, find_sight
from perception.unwarping import PER_MM
from tests.perception.contacts.shaded import (
    Bump,
    lamps,
    light_of,
    picture_of,
    response,
    sight,
    view,
)

needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None,
    reason="Mitsuba is not installed; the extra 'judge' brings it",
)


def found_in(
    bumps,
    *,
    lit,
    slope=(0.0, 0.0),
    gamma=1.0,
    jpeg=None,
    seed=0,
    levels=(0.35, 0.35),
    unlit=(),
):
    generator = np.random.default_rng(seed)
    pressed, flat = (
        picture_of(light_of(own, lit, slope), generator, gamma=gamma, jpeg=jpeg, level=level)
        for own, level in zip((bumps, []), levels, strict=True)
    )
    own = lamps() if lit else unlit
    fine = jpeg is None
    return find_contacts(pressed, flat, view(), sight(slope), own, response(gamma), fine=fine)


@pytest.mark.parametrize("lit", [True, False])
@pytest.mark.parametrize("gamma", [1.0, 2.2])
@pytest.mark.parametrize(
    "bump", [Bump(9.0, 2.0, 3.0, 0.6), Bump(14.3, -4.1, 4.0, 0.9), Bump(12.0, 0.0, 5.0, 1.1)]
)
def test_a_sphere_is_found_where_it_is_and_as_large_as_it_is(bump, lit, gamma):
    [found] = found_in([bump], lit=lit, gamma=gamma, jpeg=90)
    assert found.center == pytest.approx([bump.along, bump.across], abs=0.15)
    assert found.diameter == pytest.approx(bump.diameter, rel=0.12)
    assert (found.pad, found.paths) == ("tip", ("direct",))
    assert np.all(found.deviations > 0)
    away = np.linalg.norm(found.outline - found.center, axis=1)
    assert away == pytest.approx(np.full(len(away), found.diameter / 2))


@pytest.mark.parametrize("lit", [True, False])
def test_several_bumps_are_several_contacts(lit):
    bumps = [Bump(6.0, -6.0, 3.0, 0.6), Bump(17.0, -5.0, 4.0, 0.9), Bump(12.0, 6.0, 3.5, 0.7)]
    found = found_in(bumps, lit=lit)
    assert len(found) == 3
    for bump in bumps:
        nearest = min(found, key=lambda one: math.dist(one.center, bump[:2]))
        assert nearest.center == pytest.approx(bump[:2], abs=0.15)
        assert nearest.diameter == pytest.approx(bump.diameter, rel=0.12)
    strengths = [one.strength for one in found]
    assert strengths == sorted(strengths, reverse=True)


@pytest.mark.parametrize("lit", [True, False])
def test_what_is_lifted_is_found_where_it_is_not_where_it_appears(lit):
    slope, bump = (0.7, -0.3), Bump(12.0, 1.0, 4.0, 0.8)
    [found] = found_in([bump], lit=lit, slope=slope)
    assert found.center == pytest.approx(bump[:2], abs=0.25)
    assert found.diameter == pytest.approx(bump.diameter, rel=0.15)
    # It appears farther off than that.
    [ignored] = found_in([bump._replace(along=12.0 - 0.7 * 0.8, across=1.0 + 0.3 * 0.8)], lit=lit)
    assert math.dist(ignored.center, bump[:2]) > 0.4


@pytest.mark.parametrize("lit", [True, False])
@pytest.mark.parametrize("exposed", [0.7, 1.4])
def test_exposures_need_not_be_the_same(lit, exposed):
    bump = Bump(9.0, 2.0, 4.0, 0.8)
    level = 0.35 if lit else 0.6
    [found] = found_in([bump], lit=lit, levels=(exposed * level, level))
    assert found.center == pytest.approx(bump[:2], abs=0.15)
    assert found.diameter == pytest.approx(bump.diameter, rel=0.1)
    assert found.depth == pytest.approx(bump.depth, rel=0.4)


def test_what_is_dark_shows_less_of_its_change():
    bump = Bump(9.0, 2.0, 4.0, 0.8)
    generator = np.random.default_rng(0)
    # Six codes of 255, by half of which `DARK` would make every contact flatter.
    pressed, flat = (
        picture_of(light_of(own, True), generator, level=6 / 255, noise=0.002)
        for own in ([bump], [])
    )
    [found] = find_contacts(pressed, flat, view(), sight(), lamps())
    assert found.center == pytest.approx(bump[:2], abs=0.15)
    assert found.diameter == pytest.approx(bump.diameter, rel=0.1)
    assert found.depth == pytest.approx(bump.depth, rel=0.4)


def test_lamps_that_light_no_color_from_aside_are_even_light():
    bump = Bump(9.0, 2.0, 3.0, 0.6)
    [one], [other] = (found_in([bump], lit=False, unlit=own) for own in ((), [None] * 3))
    np.testing.assert_array_equal(one.measured, other.measured)


def test_hues_of_blocks_are_no_contacts():
    generator = np.random.default_rng(4)
    # A code of chroma, as JPEG keeps it of every block: the sum of the colors stays.
    hues = np.kron(generator.normal(size=(15, 15, 2)), np.ones((16, 16, 1)))
    red, blue = 1.402 * hues[..., 0], 1.772 * hues[..., 1]
    green = -0.714 * hues[..., 0] - 0.344 * hues[..., 1]
    flat = picture_of(light_of([], False), generator)
    codes = flat + np.stack([red, green, blue], axis=-1)
    picture = np.clip(np.rint(codes), 0, 255).astype(np.uint8)
    assert np.abs(picture.astype(float) - flat).max() > 3
    assert find_contacts(picture, flat, view(), sight(), []) == []


REDDER = np.array([1.0, -0.299 / 0.587, 0])
"""A change of color that is none of brightness (ITU-R BT.601)."""


def red_of(picture, quality):
    """A picture's red as JPEG has it, the mean of rows away from its border."""
    pixels = np.rint(picture[..., ::-1]).astype(np.uint8)
    _, file = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    stored = cv2.imdecode(file, cv2.IMREAD_COLOR)
    assert stored is not None
    return stored[16:48, :, 2].mean(axis=0)


def test_half_of_the_columns_spread_colors_as_is_reckoned_with():
    """A column that is redder, at every place of a block."""
    around, red = np.arange(-12, 13), np.zeros(25)
    for column in range(64, 80):
        picture = np.full((64, 144, 3), 128.0)
        picture[:, column] += 60 * REDDER
        red += red_of(picture, 98)[column + around] - 128
    share = red / red.sum()
    variance = share @ (around - share @ around) ** 2
    assert math.sqrt(SPREAD**2 + 12 * variance) == pytest.approx(COMPRESSED_SPREADS[0], abs=0.05)


def test_steps_of_few_codes_are_twice_as_wide():
    """By their quartiles: what is dropped of them has ripples far away."""
    generator = np.random.default_rng(0)
    around, red = np.arange(-20, 21), np.zeros(41)
    for column in list(range(80, 96)) * 4:
        picture = np.full((64, 192, 3), 40.0)
        picture[:, column:] += 10 * REDDER
        picture = cv2.GaussianBlur(picture, (0, 0), 0.6) + generator.normal(0, 1.5, picture.shape)
        red += red_of(picture, 90)[column + around]
    rising = np.cumsum(np.diff(red)) / (red[-1] - red[0])
    first, last = np.interp([0.16, 0.84], rising, around[1:])
    deviation = (last - first) / 2
    assert math.sqrt(12) * deviation == pytest.approx(COMPRESSED_SPREADS[1], abs=0.5)


def test_what_is_not_known_of_the_spread_of_colors_is_a_deviation():
    """Of a picture with two samples a pixel, which is not compressed."""
    bump, generator, above = Bump(9.0, 2.0, 3.0, 0.8), np.random.default_rng(0), sight()
    pictures = []
    for bumps in ([bump], []):
        light = cv2.resize(light_of(bumps, True), (120, 120), interpolation=cv2.INTER_AREA)
        coarse = picture_of(light, generator, noise=0.005)
        pictures.append(cv2.resize(coarse, (240, 240), interpolation=cv2.INTER_LINEAR))
    pressed, flat = pictures
    above = Sight(above.slopes, 2 * above.pixels)
    [fine], [compressed] = (
        find_contacts(pressed, flat, view(), above, lamps(), fine=fine) for fine in (True, False)
    )
    assert fine.diameter == pytest.approx(bump.diameter, abs=0.1)
    off = bump.diameter - compressed.diameter
    assert 0.2 < off < 2 * compressed.deviations[2]
    assert compressed.deviations[2] > 1.5 * fine.deviations[2]


def test_fits_that_are_as_likely_are_averaged_as_a_mixture_of_normals():
    """Against samples of the mixture."""
    generator = np.random.default_rng(3)
    roots = generator.standard_normal((2, 5, 5))
    fits = [
        Fit(generator.standard_normal(5), root @ root.T, 0.9, strength, 1.0)
        for root, strength in zip(roots, (30.0, 20.0), strict=True)
    ]
    samples = np.concatenate(
        [generator.multivariate_normal(one.parameters, one.covariance, 200_000) for one in fits]
    )
    found = mean_of(fits)
    np.testing.assert_allclose(found.parameters, samples.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(found.covariance, np.cov(samples.T), atol=0.1)
    assert found.strength == 30.0


def test_what_lies_in_the_shadow_of_another_contact_is_not_fitted():
    generator = np.random.default_rng(3)
    pressed, flat = (
        picture_of(light_of(own, True), generator) for own in ([Bump(12.0, -5.0, 3.0, 0.6)], [])
    )
    change = Change.of(pressed, flat, sight(), None, colored=True)
    start = start_at(np.array([12.0, -5.0, 1.5]))
    lit = [lamps()[0], None, None]
    assert fit(change, start, np.zeros((0, 3)), lit, SPREAD) is not None
    assert fit(change, start, np.array([[12.0, 9.0, 6.0]]), lit, SPREAD) is None


def test_what_is_pressed_off_the_pad_is_not_claimed():
    assert found_in([Bump(12.0, 11.5, 4.0, 0.8)], lit=True) == []


@pytest.mark.parametrize("lit", [True, False])
@pytest.mark.parametrize("jpeg", [None, 90])
def test_nothing_is_claimed_where_nothing_is(lit, jpeg):
    generator = np.random.default_rng(1)
    v = np.linspace(-1, 1, 240)
    flat = light_of([], lit) * (0.5 + 0.5 * v**2)[:, None]
    claimed = 0
    for number in range(10):
        # Lamps age and cameras are moved: a picture is brighter, and 0.3 samples off.
        moved = cv2.warpAffine(flat, np.array([[1.0, 0, 0.2], [0, 1, 0.2]]), (240, 240),
                               borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
        gamma = (1.0, 2.2)[number % 2]
        picture, reference = (
            picture_of(one, generator, gamma=gamma, jpeg=jpeg) for one in (1.05 * moved, flat)
        )
        own = lamps() if lit else []
        fine = jpeg is None
        found = find_contacts(picture, reference, view(), sight(), own, response(gamma), fine=fine)
        claimed += len(found)
    assert claimed == 0


@pytest.mark.parametrize("side", [np.s_[:12], np.s_[-12:], np.s_[:, :12], np.s_[:, -12:]])
def test_a_view_with_a_dark_side_claims_nothing(side):
    generator = np.random.default_rng(2)
    pressed, flat = (
        picture_of(light_of(own, True), generator) for own in ([Bump(12.0, 0.0, 4.0, 0.8)], [])
    )
    assert len(find_contacts(pressed, flat, view(), sight(), lamps())) == 1
    pressed[side] //= 10
    assert find_contacts(pressed, flat, view(), sight(), lamps()) == []


def test_a_contact_that_is_seen_flat_in_part_is_not_claimed():
    generator = np.random.default_rng(2)
    pressed, flat = (
        picture_of(light_of(own, True), generator) for own in ([Bump(10.0, 0.0, 4.0, 0.8)], [])
    )
    slopes, pixels = np.zeros((13, 13, 2)), np.full((13, 13, 2), 1 / PER_MM)
    assert len(find_contacts(pressed, flat, view(), Sight(slopes, pixels), lamps())) == 1
    pixels[6:, :, 0] *= 2  # from the middle on
    assert find_contacts(pressed, flat, view(), Sight(slopes, pixels), lamps()) == []


def test_flat_views_and_dark_ones_claim_nothing():
    generator = np.random.default_rng(2)
    bump = [Bump(12.0, 0.0, 4.0, 0.8)]
    pressed, flat = (picture_of(light_of(own, True), generator) for own in (bump, []))
    assert len(find_contacts(pressed, flat, view(), sight(), lamps())) == 1
    # Rays that are nearly parallel to the pad.
    assert find_contacts(pressed, flat, view(), sight((10.0, 0.0)), lamps()) == []
    dark = np.zeros_like(flat)
    assert find_contacts(dark, dark, view(), sight(), lamps()) == []


@pytest.mark.parametrize(
    ("picture", "reference", "message"),
    [
        (np.zeros((240, 240), np.uint8), np.zeros((240, 240, 3), np.uint8), "unwarped pad"),
        (np.zeros((240, 240, 3), np.uint8), np.zeros((240, 240, 3)), "reference of a pad"),
        (np.zeros((240, 230, 3), np.uint8), np.zeros((240, 240, 3), np.uint8), "its reference"),
    ],
)
def test_pictures_of_other_kinds_are_refused(picture, reference, message):
    with pytest.raises(UserError, match=message):
        Change.of(picture, reference, sight(), None, colored=True)


def test_pictures_of_two_sizes_are_refused():
    picture, reference = (np.zeros((size, 240, 3), np.uint8) for size in (240, 230))
    with pytest.raises(UserError, match="its reference"):
        find_contacts(picture, reference, view(), sight(), [])


@needs_mitsuba
def test_contacts_in_a_path_tracers_picture_are_where_they_were_pressed():
    from studies.oracles.judge.capture import Capture
    from studies.oracles.judge.contacts import Contact
    from studies.oracles.judge.photograph import photograph

    length, width, height = 24.0, 24.0, 30.0
    pad = {"name": "pad", "from": [0, 0], "to": [length, 0], "side": "left", "width": width}
    camera = {"position": [12, height], "direction_deg": -90, "fov_deg": 90, "pixels": 500}
    pressed = (
        Contact("pad", "sphere", 7.0, -4.0, 0.8, size=5.0),
        Contact("pad", "pin", 16.5, 4.5, 0.7, size=1.5),
    )
    pictures = [
        photograph({"camera": camera, "pads": [pad]}, None, {}, Capture(contacts=own), seed).pixels
        for seed, own in enumerate([pressed, ()])
    ]
    rows, columns = pictures[0].shape[:2]

    def places_of(points):
        # The image height of the lens is its angle: half the rows are 45°.
        u, v = points[:, 0] - length / 2, points[:, 1]
        away = np.hypot(u, v) + 1e-12
        radius = rows / 2 / math.radians(45) * np.arctan2(away, height - points[:, 2])
        # Along the pad is up in the picture of a camera that looks down.
        return np.stack(
            [(columns - 1) / 2 + radius * v / away, (rows - 1) / 2 - radius * u / away], axis=-1
        )

    shape = round(length * PER_MM), round(width * PER_MM)
    along, across = (np.arange(size) / PER_MM + 0.5 / PER_MM for size in shape)
    flat = np.stack(np.meshgrid(along, across - width / 2, [0.0], indexing="ij"), -1)
    maps = places_of(flat.reshape(-1, 3)).reshape(*shape, 2).astype(np.float32)
    picture, reference = (
        cv2.remap(one, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR) for one in pictures
    )
    found = find_contacts(picture, reference, view(), find_sight(places_of, length, width), [])
    assert len(found) == 2
    for one in pressed:
        nearest = min(found, key=lambda own: math.dist(own.center, (one.along, one.across)))
        assert nearest.center == pytest.approx([one.along, one.across], abs=0.15)
        assert nearest.diameter == pytest.approx(2 * one.edge, abs=0.2)
