"""Rays against a camera written out in three dimensions; straight lines in tangent planes."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.lens import TangentPlane
from tests.perception.drawn import Eye, rays_of

EYES = {"equidistant": Eye(), "pinhole": Eye(pinhole=True)}
TURNS, PARTS = np.random.default_rng(0).uniform((0, 0), (2 * np.pi, 1), (500, 2)).T
AROUND = np.sqrt(PARTS)[:, None] * np.stack([np.cos(TURNS), np.sin(TURNS)], axis=-1)
"""Places in the unit circle."""

GRAIN = 1 / 64
"""Places may be rounded by so many pixels when a map is looked up."""

CURVED = 3.0
"""Slopes within a radian from the axis curve by no more than 8 · 3 / 2 per rad², both ways."""

angles = st.floats(-1.4, 1.4)


@pytest.fixture(params=EYES)
def eye(request: pytest.FixtureRequest) -> Eye:
    return EYES[request.param]


def test_rays_are_those_of_the_exact_formula(eye):
    lens = eye.lens()
    assert lens.shape == (360, 480)
    whole = np.array([[0.0, 0.0], [479.0, 359.0], [17.0, 200.0]])
    # The map is in single precision.
    np.testing.assert_allclose(lens.rays(whole), rays_of(eye.directions(whole)), atol=1e-6)
    # Between pixels; the slope grows four times as fast a radian from the axis as on it.
    places = eye.middle + eye.focal * AROUND
    left = np.abs(lens.rays(places) - rays_of(eye.directions(places)))
    assert left.max() < 4 * GRAIN / eye.focal + CURVED / eye.focal**2


def test_projecting_inverts_rays(eye):
    lens, places = eye.lens(), eye.middle + 1.2 * eye.focal * AROUND
    np.testing.assert_allclose(lens.project(lens.rays(places)), places, atol=0.05)
    exact = rays_of(eye.directions(places))
    np.testing.assert_allclose(lens.project(exact), places, atol=1e-9)


@given(angles, st.floats(-1.4, 1.4), st.floats(-3, 3))
def test_the_tangent_plane_gives_rays_back(middle, turn, slope):
    plane = TangentPlane(middle)
    rays = np.array([[middle + turn, slope]])
    np.testing.assert_allclose(plane.rays(plane.flat(rays)), rays, rtol=1e-9, atol=1e-9)


@given(angles, st.floats(-1.2, 1.2), st.floats(-3, 3))
def test_the_tangent_plane_is_the_central_projection_onto_it(middle, turn, slope):
    angle = middle + turn
    direction = np.array([np.cos(angle), np.sin(angle), slope])
    towards = np.array([np.cos(middle), np.sin(middle), 0])
    up = np.array([-np.sin(middle), np.cos(middle), 0])
    expected = np.array([direction[2], direction @ up]) / (direction @ towards)
    flat = TangentPlane(middle).flat(np.array([[angle, slope]]))[0]
    np.testing.assert_allclose(flat, expected, rtol=1e-9, atol=1e-9)


POINT = st.tuples(st.floats(5, 40), st.floats(-30, 30), st.floats(-30, 30))


@given(POINT, POINT, st.floats(-0.1, 0.1))
def test_straight_lines_stay_straight(first, second, middle):
    share = np.linspace(0, 1, 9)[:, None]
    flat = TangentPlane(middle).flat(rays_of(np.array(first) + share * np.subtract(second, first)))
    off, along = flat - flat[0], flat[-1] - flat[0]
    across = off[:, 0] * along[1] - off[:, 1] * along[0]
    np.testing.assert_allclose(across, 0, atol=1e-9 * (1 + np.abs(flat).max() ** 2))


def test_a_response_codes_light_and_back():
    eye = Eye()
    codes = np.arange(256, dtype=np.uint8)[None]
    linear = eye.lens()
    np.testing.assert_array_equal(linear.light(codes), codes)
    np.testing.assert_array_equal(linear.codes(np.array([3.5])), [3.5])
    curved = dataclasses.replace(linear, response=255 * (np.arange(256) / 255) ** 2.2)
    light = curved.light(codes)
    assert light.dtype == np.float32
    np.testing.assert_allclose(light, 255 * (codes / 255.0) ** 2.2, rtol=1e-6)
    np.testing.assert_allclose(curved.codes(light.astype(float)), codes, atol=1e-3)
