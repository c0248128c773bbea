"""The gap of two views against formulas, brute force and repeats."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from perception.proprioception import GapEstimator, GapTable, calibrate_gap
from perception.quality import Quality
from tests.perception.proprioception.toy import missing, sighting_of, view_of

PAD, MIRROR = "low", "mirror:low"
ANGLES = np.linspace(-0.1, 1.3, 281)
STEP = float(ANGLES[1] - ANGLES[0])
NOISE, LABELS = 0.004, 0.01
LABELLED = np.linspace(0.0, 1.2, 6)


def gap_at(angle: np.ndarray) -> np.ndarray:
    """Rising, and bent."""
    return 0.2 + 0.5 * angle + 0.1 * angle**2


def rate_at(angle: np.ndarray) -> np.ndarray:
    return 0.5 + 0.2 * angle


def table_of(gaps: np.ndarray, angles: np.ndarray = ANGLES) -> GapTable:
    return GapTable(PAD, MIRROR, (1, 1), angles, gaps)


RISING = table_of(gap_at(ANGLES))
FALLING = table_of(1.5 - gap_at(ANGLES))
both = pytest.mark.parametrize("table", [RISING, FALLING], ids=["rising", "falling"])


def from_gaps(gaps: np.ndarray, there: np.ndarray | None = None) -> GapTable:
    """A table whose first ends face each other at given gaps; the others are far apart."""
    count = len(gaps)
    there = np.ones(count, bool) if there is None else there
    direct = np.stack([np.zeros(count), np.full(count, -100.0)], axis=-1)
    mirrored = np.stack([gaps, np.full(count, 100.0)], axis=-1)
    seen = np.ones((count, 2, 2), bool)
    seen[:, 0, 0] = there
    return GapTable.of(PAD, MIRROR, np.arange(count, dtype=float), direct, mirrored, seen)


def longest_run(gaps: np.ndarray, there: np.ndarray) -> int:
    """How many values in a row can be used, by trying all."""
    best = 0
    for first in range(len(gaps)):
        for last in range(first + 1, len(gaps) + 1):
            steps = np.diff(gaps[first:last])
            if there[first:last].all() and ((steps > 0).all() or (steps < 0).all()):
                best = max(best, last - first)
    return best


@pytest.mark.parametrize("ends", [(0, 0), (0, 1), (1, 0), (1, 1)])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_ends_that_face_each_other_are_the_nearest(ends, sign):
    # Pads of half a radian; the direct view moves, and the two views grow apart.
    away = np.stack([0.5 * (np.arange(2) != ends[0])] * len(ANGLES))
    beyond = np.stack([0.5 * (np.arange(2) != ends[1])] * len(ANGLES))
    direct = -sign * (0.3 * ANGLES[:, None] + away)
    mirrored = sign * (0.2 + 0.2 * ANGLES[:, None] + 0.1 * ANGLES[:, None] ** 2 + beyond)
    seen = np.ones((len(ANGLES), 2, 2), bool)
    table = GapTable.of(PAD, MIRROR, ANGLES, direct, mirrored, seen)
    assert (table.pad, table.mirror, table.ends) == (PAD, MIRROR, ends)
    np.testing.assert_array_equal(table.angles, ANGLES)
    np.testing.assert_allclose(table.gaps, gap_at(ANGLES), rtol=1e-12)


@given(st.lists(st.tuples(st.integers(1, 4), st.booleans()), min_size=2, max_size=9))
def test_the_part_kept_is_the_longest_of_all_that_go_one_way(values):
    gaps = np.array([float(gap) for gap, _ in values])
    # Few are not seen, or nothing would be left.
    there = np.array([seen or i % 3 > 0 for i, (_, seen) in enumerate(values)])
    assume(there.any())
    longest = longest_run(gaps, there)
    if longest < 2:
        with pytest.raises(ValueError, match="never shows facing ends"):
            from_gaps(gaps, there)
        return
    table = from_gaps(gaps, there)
    assert len(table.angles) == longest
    kept = table.angles.astype(int)
    np.testing.assert_array_equal(kept, np.arange(kept[0], kept[0] + longest))
    assert there[kept].all()
    np.testing.assert_array_equal(table.gaps, gaps[kept])
    steps = np.diff(table.gaps)
    assert (steps > 0).all() or (steps < 0).all()


def test_views_that_are_never_seen_at_once_have_no_gap():
    seen = np.zeros((4, 2, 2), bool)
    seen[:2, 0], seen[2:, 1] = True, True
    ends = np.zeros((4, 2))
    with pytest.raises(ValueError, match="never seen directly and in mirror:low at once"):
        GapTable.of(PAD, MIRROR, np.arange(4.0), ends, ends, seen)


@both
def test_gap_and_angle_are_those_of_the_formula_within_the_table(table):
    angles = np.linspace(-0.1, 1.3, 37)
    expected = gap_at(angles) if table is RISING else 1.5 - gap_at(angles)
    # Between values a line is off by at most an eighth of the step squared times the bend.
    np.testing.assert_allclose(table.gap(angles), expected, atol=STEP**2 * 0.2 / 8 + 1e-15)
    for angle in (-0.1, 0.0, 0.123, 0.7, 1.2999, 1.3):
        assert table.angle(float(table.gap(angle))) == pytest.approx(angle, abs=1e-12)
    low, high = sorted((table.gaps[0], table.gaps[-1]))
    assert np.isnan([table.angle(gap) for gap in (low - 1e-6, high + 1e-6, math.nan)]).all()
    assert np.isnan(table.gap(np.array([-0.11, 1.31, np.nan]))).all()


def test_the_rate_is_the_slope_of_the_formula():
    # Values that lie unevenly; inside, a parabola through three is the parabola itself.
    angles = ANGLES + 0.3 * STEP * np.sin(np.arange(len(ANGLES)))
    rate = table_of(gap_at(angles), angles).rate
    np.testing.assert_allclose(rate[1:-1], rate_at(angles)[1:-1], rtol=1e-9)
    np.testing.assert_allclose(rate[[0, -1]], rate_at(angles)[[0, -1]], atol=0.2 * STEP)


@pytest.mark.parametrize(
    ("ends", "gap"), [((0, 0), 0.8), ((0, 1), 1.0), ((1, 0), 0.3), ((1, 1), 0.5)]
)
def test_the_gap_of_an_image_is_between_the_ends_that_face(ends, gap):
    sighting = sighting_of(
        view_of(PAD, "direct", (0.3, -0.2)),
        view_of(PAD, MIRROR, (-0.5, -0.7)),
        view_of("high", "direct", (2.0, 2.0)),
    )
    table = dataclasses.replace(RISING, ends=ends)
    assert table.measured(sighting) == pytest.approx(gap)


@pytest.mark.parametrize("shown", [(True, True), (True, False), (False, True), (False, False)])
@pytest.mark.parametrize("clipped", ["direct", MIRROR])
def test_a_clipped_view_counts_if_the_end_that_faces_is_seen(shown, clipped):
    angles = {"direct": (0.3, -0.2), MIRROR: (-0.7, -0.5)}
    views = {path: view_of(PAD, path, ends) for path, ends in angles.items()}
    views[clipped] = dataclasses.replace(views[clipped], ends=shown, quality=Quality.CLIPPED)
    measured = RISING.measured(sighting_of(*views.values()))
    assert measured == pytest.approx(0.3) if shown[1] else math.isnan(measured)


@pytest.mark.parametrize(("lost", "other"), [("direct", MIRROR), (MIRROR, "direct")])
def test_without_one_of_both_views_there_is_no_gap(lost, other):
    there = view_of(PAD, other, (0.3, -0.2))
    assert math.isnan(RISING.measured(sighting_of(there)))
    assert math.isnan(RISING.measured(sighting_of(there, missing(PAD, lost))))


def calibrated(gaps: np.ndarray, angles: np.ndarray, table: GapTable = RISING) -> GapEstimator:
    meter = calibrate_gap(table, gaps, angles, noise=NOISE, label_deviation=LABELS)
    assert meter is not None
    return meter


@both
@pytest.mark.parametrize(("offset", "scale"), [(0.0, 1.0), (0.05, 0.9), (-0.03, 1.2)])
def test_offset_and_scale_of_exact_frames_are_found(table, offset, scale):
    # Two frames are enough.
    for labels in (LABELLED[[1, 4]], LABELLED):
        meter = calibrated(offset + scale * table.gap(labels), labels, table)
        assert meter.offset == pytest.approx(offset, abs=1e-12)
        assert meter.scale == pytest.approx(scale, rel=1e-12)
        for angle in (0.1, 0.77, 1.1):
            estimate = meter.estimate(offset + scale * float(table.gap(angle)))
            assert estimate.angle == pytest.approx(angle, abs=1e-9)
            assert estimate.reason == "gap"


def test_frames_without_a_gap_or_beyond_the_table_do_not_count():
    gaps = 0.02 + 1.1 * gap_at(LABELLED)
    wrong = np.append(gaps, [np.nan, 5.0, 5.0])
    labels = np.append(LABELLED, [0.5, 1.4, np.nan])
    meter, reference = calibrated(wrong, labels), calibrated(gaps, LABELLED)
    assert (meter.offset, meter.scale) == pytest.approx((reference.offset, reference.scale))
    np.testing.assert_allclose(meter.covariance, reference.covariance)


POOR = {
    "none": ([], []),
    "one": ([0.5], [0.4]),
    "one seen": ([0.5, np.nan, np.nan], [0.4, 0.6, 0.8]),
    "one inside": ([0.5, 0.6, 0.6], [0.4, 1.4, -0.2]),
    "one angle": ([0.5, 0.51, 0.52], [0.4, 0.4, 0.4]),
    "falling": ([0.8, 0.6, 0.4], [0.2, 0.6, 1.0]),
    "constant": ([0.6, 0.6, 0.6], [0.2, 0.6, 1.0]),
}


@pytest.mark.parametrize("kind", POOR)
def test_what_cannot_be_calibrated_is_not(kind):
    gaps, angles = (np.array(values, float) for values in POOR[kind])
    assert calibrate_gap(RISING, gaps, angles, noise=NOISE, label_deviation=LABELS) is None


@both
def test_the_line_is_that_of_weighted_least_squares(table):
    # The textbook's sums. Where the gap changes fast a label's error weighs more.
    x, y = table.gap(LABELLED), table.gap(LABELLED) + 0.01 * np.cos(9 * LABELLED)
    weights = 1 / (NOISE**2 + (rate_at(LABELLED) * LABELS) ** 2)
    s, sx, sy, sxx, sxy = (np.sum(weights * part) for part in (1, x, y, x * x, x * y))
    determinant = s * sxx - sx**2
    meter = calibrated(y, LABELLED, table)
    assert meter.offset == pytest.approx((sxx * sy - sx * sxy) / determinant, rel=1e-6)
    assert meter.scale == pytest.approx((s * sxy - sx * sy) / determinant, rel=1e-6)
    expected = np.array([[sxx, -sx], [-sx, s]]) / determinant
    np.testing.assert_allclose(meter.covariance, expected, rtol=1e-6)


OFFSET, SCALE, ASKED = 0.03, 1.05, 0.8


@both
def test_the_deviation_of_an_angle_is_the_scatter_of_repeats(table):
    """Noisy frames and labels, and one more noisy gap at a known angle."""
    generator, off = np.random.default_rng(0), []
    for _ in range(1000):
        gaps = OFFSET + SCALE * table.gap(LABELLED) + generator.normal(0, NOISE, len(LABELLED))
        labels = LABELLED + generator.normal(0, LABELS, len(LABELLED))
        one = OFFSET + SCALE * float(table.gap(ASKED)) + generator.normal(0, NOISE)
        estimate = calibrated(gaps, labels, table).estimate(one)
        off.append((estimate.angle - ASKED) / estimate.deviation)
    # 1000 draws know a deviation to 2.2 %; labels weigh as if the scale were 1, not 1.05.
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1, abs=0.1)


def test_a_known_meter_errs_by_the_noise_over_the_rate():
    meter = GapEstimator(RISING, OFFSET, SCALE, np.zeros((2, 2)), NOISE)
    angles = np.array([0.1, 0.6, 1.2])
    stated = [meter.estimate(float(gap)).deviation for gap in OFFSET + SCALE * RISING.gap(angles)]
    np.testing.assert_allclose(stated, NOISE / (SCALE * rate_at(angles)), rtol=1e-6)


def test_where_the_gap_is_not_in_the_table_there_is_no_angle():
    meter = GapEstimator(RISING, OFFSET, SCALE, np.zeros((2, 2)), NOISE)
    low, high = (OFFSET + SCALE * gap_at(ANGLES[[0, -1]])).tolist()
    for gap, word in ((math.nan, "no gap"), (low - 1e-6, "outside"), (high + 1e-6, "outside")):
        estimate = meter.estimate(gap)
        assert not estimate.defined
        assert math.isinf(estimate.deviation)
        assert word in estimate.reason
