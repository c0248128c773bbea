"""Corners as arrays: their weights against the closed inverse of two rows and columns."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.matching import View
from perception.proprioception import Observation, observe, stack_observations
from perception.proprioception.observation import CONSTANT, FLOOR, WORST
from perception.quality import Quality
from tests.perception.proprioception.toy import VIEWS, missing, sighting_of, view_of

deviation = st.floats(1e-2, 1e2)
correlation = st.floats(-0.99, 0.99)


def covariance_of(first: float, second: float, share: float) -> np.ndarray:
    both = share * first * second
    return np.array([[first**2, both], [both, second**2]])


def view_with(
    covariances: list[np.ndarray],
    pad: str = "low",
    path: str = "direct",
    *,
    rough: float | list[float] = 0.0,
) -> View:
    """A view with some covariances of corners, of which parts are roughness."""
    covariance = np.stack(covariances)
    roughness = np.reshape(np.broadcast_to(rough, 4), (4, 1, 1)) * covariance
    view = view_of(pad, path, (-0.5, -0.1))
    return dataclasses.replace(view, covariance=covariance, roughness=roughness)


@given(
    st.lists(st.tuples(deviation, deviation, correlation), min_size=4, max_size=4),
    st.lists(st.floats(0, 0.99), min_size=4, max_size=4),
    st.sampled_from([FLOOR, 2.0]),
)
def test_covariances_are_split_by_frame_and_alike_and_both_are_enlarged(corners, rough, floor):
    covariances = [covariance_of(*corner) for corner in corners]
    seen = observe(sighting_of(view_with(covariances, rough=rough)), VIEWS, floor)
    parts = zip(np.asarray(seen.whitening)[0], np.asarray(seen.common)[0], strict=True)
    for (whitening, common), covariance, share in zip(parts, covariances, rough, strict=True):
        own, alike = (1 - share) * covariance, share * covariance + CONSTANT**2 * np.eye(2)
        # With the floor the condition number is below 1e7.
        product = whitening.T @ whitening @ (own + floor**2 * np.eye(2))
        np.testing.assert_allclose(product, np.eye(2), atol=1e-8)
        np.testing.assert_allclose(common @ common, alike, rtol=1e-9, atol=1e-12 * alike.max())
        np.testing.assert_allclose(common, common.T, rtol=1e-12)
        assert np.linalg.eigvalsh(common).min() > 0


@pytest.mark.parametrize("ends", list(itertools.product([True, False], repeat=2)))
def test_corners_of_ends_that_are_not_granted_have_no_weight(ends):
    view = dataclasses.replace(view_of("low", "direct", (-0.5, -0.1)), ends=ends)
    seen = observe(sighting_of(view), VIEWS)
    assert seen.used[0].tolist() == [[ends[end]] * 2 for end in (0, 1, 1, 0)]


def test_corners_stand_in_the_order_of_the_model():
    angles = {view: (0.1 * i, 0.1 * i + 0.05) for i, view in enumerate(VIEWS)}
    views = [view_of(*view, angles[view]) for view in reversed(VIEWS)]
    seen = observe(sighting_of(*views), VIEWS)
    assert seen.seen.tolist() == [True] * 4
    for corners, view in zip(seen.corners, views[::-1], strict=True):
        np.testing.assert_array_equal(corners, view.corners)


POOR = [view_of(*VIEWS[0], (0.1, 0.2), quality=q) for q in Quality if q is not Quality.COMPLETE]
POOR += [missing(*VIEWS[0]), view_with([np.full((2, 2), np.nan)] * 4)]


@pytest.mark.parametrize("poor", POOR)
def test_what_is_not_complete_or_of_unknown_place_has_no_weight(poor):
    seen = observe(sighting_of(poor, view_of(*VIEWS[2], (0.3, 0.4))), VIEWS)
    assert seen.seen.tolist() == [False, False, True, False]
    assert not np.any(np.asarray(seen.whitening)[[0, 1, 3]])
    assert np.isfinite(seen.corners).all()


@pytest.mark.parametrize(("share", "used"), [(0.5, True), (2.0, False)])
def test_a_view_with_a_corner_known_very_unevenly_is_not_used(share, used):
    uneven = np.diag([share * WORST * 2 * FLOOR**2, FLOOR**2])
    good = covariance_of(0.1, 0.1, 0.0)
    sighting = sighting_of(
        view_with([good, good, uneven, good]), view_with([good] * 4, "low", "mirror:low")
    )
    assert observe(sighting, VIEWS).seen.tolist() == [used, True, False, False]


def test_frames_are_stacked_along_a_first_axis():
    several = [observe(sighting_of(view_of(*VIEWS[i], (0.1, 0.2))), VIEWS) for i in (0, 1, 3)]
    stacked = stack_observations(several)
    assert isinstance(stacked, Observation)
    assert stacked.seen.tolist() == [[i == index for i in range(4)] for index in (0, 1, 3)]
    for number, one in enumerate(several):
        np.testing.assert_array_equal(np.asarray(stacked.corners)[number], one.corners)
        np.testing.assert_array_equal(np.asarray(stacked.whitening)[number], one.whitening)
        np.testing.assert_array_equal(np.asarray(stacked.common)[number], one.common)
