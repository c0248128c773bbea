"""Lengths of pads by exact and by noisy corners against the lengths that were imaged."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.detection import detect_quads
from perception.lengths import LEAST_DEVIATION, measured_grazing, measured_length, shortened
from tests.perception.drawn import Eye, Pad, drawn, exact_quad, quad_at, stored

EYE = Eye()
LENS = EYE.lens()
PADS = {
    "before": Pad((20, -14), (22, 12)),
    "below": Pad((12, -30), (20, -18)),
    "near": Pad((15, -10), (19, 16), beside=3),
}


@given(st.floats(8, 40), st.floats(-25, -5), st.floats(8, 40), st.floats(-4, 25), st.floats(-6, 6))
def test_exact_corners_give_the_length_and_the_flattest_angle(forward, up, further, higher, beside):
    pad = Pad((forward, up), (further, higher), beside=beside)
    quad = exact_quad(EYE, pad)
    length, deviation = measured_length(quad, pad.width, LENS)
    assert length == pytest.approx(pad.length, rel=1e-9)
    assert deviation > 0
    lie = np.arctan2(higher - up, further - forward)
    between = [lie - np.arctan2(up, forward), lie - np.arctan2(higher, further)]
    flattest = min(min(angle % np.pi, -angle % np.pi) for angle in between)
    assert measured_grazing(quad, pad.width) == pytest.approx(flattest, abs=1e-9)


@pytest.mark.parametrize("name", PADS)
def test_a_drawn_pad_is_as_long_as_it_is(name):
    pad = PADS[name]
    (quad,) = detect_quads(stored(drawn(EYE, [pad]), noise=2.0), LENS)
    length, deviation = measured_length(quad, pad.width, LENS)
    assert abs(length - pad.length) < deviation
    assert deviation < 0.1 * pad.length


@pytest.mark.parametrize(("name", "scatter"), [("before", 0.0), ("below", 1.0), ("near", 1.0)])
def test_the_deviation_is_that_of_noisy_corners(name, scatter):
    pad = PADS[name]
    quad = exact_quad(EYE, pad, deviation=scatter)
    _, deviation = measured_length(quad, pad.width, LENS)
    generator, lengths = np.random.default_rng(0), []
    size = np.hypot(scatter, LEAST_DEVIATION)
    for _ in range(100):
        corners = quad.corners + size * generator.standard_normal((4, 2))
        noisy = quad_at(EYE, corners, deviation=scatter)
        lengths.append(measured_length(noisy, pad.width, LENS)[0])
    # 100 draws know a deviation to 7 % (1 σ); the length is not quite linear in the corners.
    assert deviation == pytest.approx(np.std(lengths), rel=0.2)


@pytest.mark.parametrize("name", PADS)
@pytest.mark.parametrize("kept", [0, 1])
def test_a_view_that_is_too_long_is_shortened_to_the_pad(name, kept):
    pad = PADS[name]
    longer = 1.15 * pad.length * pad.step
    moved = {"second": tuple(pad.first + longer), "first": tuple(pad.second - longer)}
    end, own, other = [("second", [0, 3], [1, 2]), ("first", [1, 2], [0, 3])][kept]
    quad = exact_quad(EYE, dataclasses.replace(pad, **{end: moved[end]}), deviation=0.1)
    extent, expected = np.array([pad.length, 0.0]), exact_quad(EYE, pad)
    found = shortened(quad, pad.width, extent, LENS, kept)
    np.testing.assert_allclose(found.corners, expected.corners, atol=1e-6)
    np.testing.assert_allclose(found.rays, expected.rays, atol=1e-9)
    np.testing.assert_array_equal(found.covariance[own], quad.covariance[own])
    assert (found.covariance[other, 1, 1] > quad.covariance[other, 1, 1]).all()
    # A pad that may be made longer may end where it would then.
    one, longer = (
        shortened(quad, pad.width, np.array([pad.length + more, of_finger]), LENS, kept)
        for more, of_finger in ((0.0, 0.3), (0.3, 0.0))
    )
    added = np.trace((one.covariance - found.covariance)[other], axis1=1, axis2=2)
    moved = np.hypot(*(longer.corners - found.corners)[other].T)
    np.testing.assert_allclose(np.sqrt(added), moved, rtol=0.05)
