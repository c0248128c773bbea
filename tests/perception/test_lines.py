"""Lines through edges, against least squares and repeats."""

from typing import NamedTuple

import numpy as np
import pytest
import scipy.ndimage

from perception.lines import fit_lines
from perception.sides import POINTS, SHARES, Edges

SCALE = 150.0
"""Pixels per unit of the tangent plane."""

ROUGH = 0.01 * np.fromstring(
    "-66 -71 -87 -79 -72 -60 -40 -28 -20 10 23 27 34 44 44 46 42 39 31 28 24 21 20 20 30 25 24 16 "
    "14 7 7 5 -6 0 -1 9 12 13 14 10 2 -9 -18 -30 -50 -61 -69 -73",
    sep=" ",
)
"""A rough side as it was rendered, px: its ends lie apart from its middle."""


class Line(NamedTuple):
    """One of `Lines`."""

    offset: float
    turn: float
    covariance: np.ndarray
    roughness: np.ndarray
    scatter: float

    def at(self, share: float) -> float:
        return self.offset + self.turn * share

    def variances(self, share: float) -> np.ndarray:
        return np.array([1, share]) @ [self.covariance, self.roughness] @ [1, share]


def lines_of(
    offsets: np.ndarray, found: np.ndarray | bool = True, doubt: float = 0.0
) -> list[Line]:
    """Of sides by offsets in pixels; beside them one that is straight, which must not matter."""
    rows = np.vstack([offsets / SCALE, 3 * SHARES])
    there, ones = np.broadcast_to(found, rows.shape).copy(), np.ones(len(rows))
    there[-1] = True
    doubts = doubt * (np.arange(len(rows)) < len(rows) - 1)
    scale = np.full(rows.shape, SCALE)
    lit = np.zeros(len(rows), bool)
    arrays = rows, scale, there, 100 * ones, ones, ones, doubts, lit, lit
    lines = fit_lines(Edges(*(one[None] for one in arrays)))
    assert lines.turn[0, -1] == pytest.approx(3)
    every = [Line(*(getattr(lines, name)[0, i] for name in Line._fields)) for i in range(len(rows))]
    for share in (0.0, 0.3):
        np.testing.assert_allclose(lines.at(share)[0], [line.at(share) for line in every])
        stated = [line.variances(share) for line in every]
        np.testing.assert_allclose(lines.variances(share)[0], stated, rtol=1e-9)
    return every[:-1]


def line_of(offsets: np.ndarray, found: np.ndarray | bool = True, doubt: float = 0.0) -> Line:
    return lines_of(offsets, found, doubt)[0]


def test_a_line_through_good_edges_is_that_of_least_squares():
    offsets = 0.7 - 1.3 * SHARES + np.random.default_rng(0).normal(0, 0.1, POINTS)
    line = line_of(offsets)
    slope, constant = np.polyfit(SHARES, offsets, 1)
    # Tukey's weights of normal residuals take a line away from the mean by a part of its error.
    assert line.offset * SCALE == pytest.approx(constant, abs=0.02)
    assert line.turn * SCALE == pytest.approx(slope, abs=0.04)
    assert line.scatter == pytest.approx(0.1, rel=0.3)
    assert line.at(0.5) == pytest.approx(line.offset + line.turn / 2)


@pytest.mark.parametrize(("alike", "within"), [(False, 0.3), (True, 0.5)])
def test_the_variance_of_a_line_is_the_scatter_of_repeats(alike, within):
    rough = np.random.default_rng(1).normal(0, 0.3, (400, POINTS + 4))
    if alike:
        # How alike neighbours err is estimated from these few; ignored, it would be a fifth.
        rough = scipy.ndimage.uniform_filter1d(rough, 5, axis=1)
    lines = lines_of(rough[:, 2:-2])
    for share in (0.0, 0.5, 1.0):
        scatter = np.var([line.at(share) for line in lines])
        expected = np.mean([line.variances(share)[0] for line in lines])
        # A variance of 400 draws is off by 7 % (1 σ); weights make it a little larger than stated.
        assert expected / scatter == pytest.approx(1, abs=within)


@pytest.mark.parametrize(("rough", "noise"), [(0.3, 0.1), (0.3, 0.3), (0.0, 0.3)])
def test_roughness_is_what_all_frames_of_a_side_have_alike(rough, noise):
    """The rest of a line's variance is about what scatters from frame to frame, or is larger."""
    generator = np.random.default_rng(2)
    white = np.sqrt(5) * rough * generator.standard_normal((400, POINTS + 4))
    shapes = scipy.ndimage.uniform_filter1d(white, 5, axis=1)[:, 2:-2]
    frames = [lines_of(shapes + noise * generator.standard_normal(shapes.shape)) for _ in range(2)]
    for share in (0.0, 0.5, 1.0):
        first, second = ([line.at(share) for line in lines] for lines in frames)
        stated = np.mean([line.variances(share) for lines in frames for line in lines], axis=0)
        by_frame = (stated[0] - stated[1]) / (np.var(np.subtract(first, second)) / 2)
        # What a rough edge has that neighbours do not share counts as noise: a fifth of it here.
        assert 0.75 < by_frame < (1.4 if noise >= rough else 3)
        if rough:
            # Noise hides how far roughness reaches, so that of equal parts only half is found.
            assert 0.4 < stated[1] / np.cov(first, second)[0, 1] < 1.3
        else:
            assert stated[1] < stated[0] / 3


def test_outliers_on_a_third_of_a_side_and_places_without_an_edge_do_not_move_its_line():
    offsets = 0.2 + 0.5 * SHARES + np.random.default_rng(3).normal(0, 0.1, POINTS)
    spoilt = offsets.copy()
    spoilt[20:36] -= 4
    there = np.arange(POINTS) % 3 > 0
    lines = line_of(spoilt), line_of(np.where(there, offsets, 50.0), there)
    for line in lines:
        for share in (0, 1):
            clean = line_of(offsets).at(share)
            assert line.at(share) * SCALE == pytest.approx(clean * SCALE, abs=0.1)


@pytest.mark.parametrize(("shift", "turn"), [(0.65, -0.9), (-0.7, 1.5), (1.0, 1.0)])
def test_the_line_does_not_depend_on_where_the_side_was_expected(shift, turn):
    expected = shift + turn * SHARES
    line, moved = line_of(ROUGH), line_of(ROUGH - expected)
    for share in (0, 1):
        found = moved.at(share) * SCALE + shift + turn * share
        assert found == pytest.approx(line.at(share) * SCALE, abs=0.05)


def test_doubt_is_added_to_the_variance_and_a_side_hardly_found_may_be_anywhere():
    offsets = np.random.default_rng(4).normal(0, 0.1, POINTS)
    sure, doubted = line_of(offsets), line_of(offsets, doubt=3.0)
    added = (doubted.variances(0.3)[0] - sure.variances(0.3)[0]) * SCALE**2
    assert added == pytest.approx(3.0**2)
    line = line_of(np.zeros(POINTS), np.arange(POINTS) < POINTS // 4 - 1)
    assert (line.offset, line.turn, line.scatter) == (0, 0, np.inf)
    assert np.sqrt(line.variances(0.5)[0]) * SCALE > 100


@pytest.mark.parametrize("bulge", [0.0, 1.0, 3.0])
def test_a_line_whose_end_is_bent_is_unsure_there(bulge):
    offsets = np.random.default_rng(5).normal(0, 0.1, POINTS)
    offsets[-POINTS // 5 :] += bulge
    line = line_of(offsets)
    start, end = (np.sqrt(line.variances(share)[0]) * SCALE for share in (0.0, 1.0))
    assert start < 0.15
    if bulge:
        assert end == pytest.approx(bulge, rel=0.3)
        assert abs(line.at(1.0) * SCALE - bulge) < 2 * end
    else:
        assert end < 0.15
