"""Heights by points that move, against maps made up; kinds of surfaces, against drawn profiles."""

from dataclasses import replace

import numpy as np
import pytest

from perception.chamber import (
    ChamberMap,
    Heights,
    Movements,
    Points,
    SurfaceKind,
    classify_surface,
    compute_movements,
    estimate_scatter,
    measure_shape,
)
from perception.chamber.heights import LEAST_APART
from perception.chamber.surfaces import CURVED, CUTOFF, LEAST_HEIGHTS, ROUGH

HEIGHTS = np.linspace(0.0, 12.0, 49)
RATES = np.array([3.7, 6.1, 3.8])
CHAMBER = ChamberMap(HEIGHTS, RATES * HEIGHTS[:, None] * (1 + 0.004 * HEIGHTS[:, None]))
X = np.linspace(-30.0, 30.0, 41)


def points(*rows: float, seen: tuple[bool, ...] = (True,) * 7) -> Points:
    xy = np.zeros((7, 2))
    xy[[1, 4, 6], 1] = rows
    return Points(xy, np.array(seen))


def moved(heights: np.ndarray, chamber: ChamberMap = CHAMBER) -> Movements:
    px = np.stack([np.interp(heights, HEIGHTS, chamber.moved[:, i]) for i in range(3)], axis=1)
    return Movements(px, np.ones(px.shape, bool))


def known(mm: np.ndarray) -> Heights:
    return Heights(mm, np.ones(len(mm), bool))


def kind(positions: np.ndarray, heights: Heights) -> SurfaceKind:
    return classify_surface(measure_shape(positions, heights))


def test_movements_are_upwards_from_the_mean_at_rest():
    rest = [points(400.0, 330.0, 240.0), points(401.0, 330.4, 240.0)]
    hidden = points(390.0, 0.0, 230.0, seen=(True, True, True, True, False, True, True))
    found = compute_movements([points(390.5, 320.2, 239.0), hidden], rest)
    np.testing.assert_allclose(found.px, [[10.0, 10.0, 1.0], [10.5, 0.0, 10.0]])
    assert found.seen.tolist() == [[True] * 3, [True, False, True]]
    whole = compute_movements([points(390.6, 320.2, 239.4)], rest, whole=True)
    assert whole.px.tolist() == [[400.0 - 391.0, 330.0 - 320.0, 240.0 - 239.0]]


def test_what_is_not_seen_at_rest_has_not_moved():
    blind, one = points(0.0, 0.0, 0.0, seen=(False,) * 7), points(390.0, 320.0, 239.0)
    for rest in ([blind], []):
        assert not compute_movements([one], rest).seen.any()
    assert compute_movements([], []).px.shape == (0, 3)


def test_scatter_parts_what_is_common_from_what_is_not():
    generator = np.random.default_rng(1)
    px = 0.5 * generator.standard_normal((4000, 1)) + 0.1 * generator.standard_normal((4000, 3))
    shake, noise = estimate_scatter(Movements(px, np.ones(px.shape, bool)))
    assert shake == pytest.approx(0.5, rel=0.05)
    assert noise == pytest.approx(0.1, rel=0.05)
    assert estimate_scatter(Movements(px[:1], np.ones((1, 3), bool))) == (0.0, 0.0)
    assert estimate_scatter(Movements(px, np.zeros(px.shape, bool))) == (0.0, 0.0)


def test_heights_are_those_that_moved_the_points():
    truth = np.linspace(0.05, 11.95, 200)
    for use in ("beg", "e", "bg"):
        found = CHAMBER.height(moved(truth), use=use)
        assert found.known.all()
        # the table is a chain of straight lines, and so is what moved the points
        np.testing.assert_allclose(found.mm, truth, atol=1e-12)


def test_what_is_not_seen_does_not_count():
    truth = np.array([2.0, 5.0, 9.0])
    frames = moved(truth)
    frames.seen[0, 1] = frames.seen[1, [0, 2]] = frames.seen[2] = False
    found = CHAMBER.height(Movements(np.where(frames.seen, frames.px, 0.0), frames.seen))
    np.testing.assert_allclose(found.mm, [2.0, 5.0, 0.0], atol=1e-12)
    assert found.known.tolist() == [True, True, False]


def test_beyond_the_map_nothing_is_known():
    end = CHAMBER.moved[-1]
    frames = Movements(np.stack([end + 1, -np.ones(3), end * [2, 0.5, 2]]), np.ones((3, 3), bool))
    found = CHAMBER.height(frames)
    assert found.known.tolist() == [False, False, True]
    assert found.mm[:2].tolist() == [0.0, 0.0]
    assert found.mm[2] == pytest.approx(np.interp(0.5 * end[1], CHAMBER.moved[:, 1], HEIGHTS))


def test_weights_are_those_of_least_variance():
    chamber = replace(CHAMBER, shake=0.5, noise=0.1)
    generator = np.random.default_rng(2)
    shaking = 0.5 * generator.standard_normal((20_000, 1))
    own = 0.1 * generator.standard_normal((20_000, 3))
    frames = moved(np.full(20_000, 6.0), chamber)
    frames = Movements(frames.px + shaking + own, frames.seen)
    rates = 1 / chamber.resolution(np.array([6.0]))[0]
    covariance = (0.5**2 + 0.1**2 * np.eye(3)) / rates / rates[:, None]
    best = 1 / np.sqrt(np.linalg.inv(covariance).sum())
    assert chamber.height(frames).mm.std() == pytest.approx(best, rel=0.03)
    alone = np.sqrt(covariance[1, 1])
    assert chamber.height(frames, use="e").mm.std() == pytest.approx(alone, rel=0.03)
    assert alone > 1.5 * best


def test_calibration_by_least_squares_is_numpys():
    generator, plate = np.random.default_rng(3), np.linspace(1.0, 11.0, 12)
    frames = moved(plate)
    px = frames.px + generator.normal(0, 0.5, frames.px.shape)
    found = CHAMBER.calibrated(plate, Movements(px, frames.seen))
    for point in range(3):
        line = np.polyfit(frames.px[:, point], px[:, point], 1)
        expected = np.polyval(line, CHAMBER.moved[:, point])
        np.testing.assert_allclose(found.moved[:, point], expected, atol=1e-9)
    # Plates beyond the table are at its end.
    beyond = CHAMBER.calibrated(np.array([13.0, 15.0]), moved(np.array([12.0, 12.0])))
    np.testing.assert_allclose(beyond.moved, CHAMBER.moved, atol=1e-12)


def test_too_few_frames_calibrate_what_they_can():
    nothing = CHAMBER.calibrated(np.zeros(0), Movements(np.zeros((0, 3)), np.zeros((0, 3), bool)))
    np.testing.assert_array_equal(nothing.moved, CHAMBER.moved)
    backwards = CHAMBER.calibrated(np.array([2.0, 8.0]), moved(np.array([8.0, 2.0])))
    assert (np.diff(backwards.moved, axis=0) > 0).all()


@pytest.mark.parametrize(("count", "height"), [(3, 11.7), (7, 9.9), (10, 11.4)])
def test_one_height_gives_an_offset_however_often(count, height):
    # The mean of equal numbers may be off by a rounding error, which is no spread.
    plate = np.full(count, height)
    frames = moved(plate)
    frames.seen[:, 2] = False
    noise = np.random.default_rng(count).normal(0, 0.5, frames.px.shape)
    found = CHAMBER.calibrated(plate, Movements(frames.px + noise, frames.seen))
    expected = CHAMBER.moved + noise.mean(axis=0) * [1, 1, 0]
    np.testing.assert_allclose(found.moved, expected, rtol=0, atol=1e-12)


def test_heights_that_hardly_differ_are_one():
    for apart, offset_only in ((0.99 * LEAST_APART, True), (1.01 * LEAST_APART, False)):
        plate = 5 + np.array([0.0, apart])
        found = CHAMBER.calibrated(plate, Movements(1.1 * moved(plate).px, np.ones((2, 3), bool)))
        kept = np.allclose(np.diff(found.moved, axis=0), np.diff(CHAMBER.moved, axis=0))
        assert kept is offset_only


@pytest.mark.parametrize("use", ["a", "bed", "E", ""])
def test_other_points_are_refused(use):
    with pytest.raises(ValueError, match="give one or more of the letters beg"):
        CHAMBER.height(moved(np.array([5.0])), use=use)


def test_resolution_is_the_slope_of_height_over_pixels():
    places, step = np.array([0.6, 3.1, 7.3, 11.9]), 1e-4
    found = CHAMBER.resolution(places)
    for point, name in enumerate("beg"):
        px = moved(places).px
        change = []
        for sign in (-0.5, 0.5):
            other = Movements(px + sign * step, np.ones(px.shape, bool))
            change.append(CHAMBER.height(other, use=name).mm)
        np.testing.assert_allclose(found[:, point], (change[1] - change[0]) / step, rtol=1e-7)
    ends = CHAMBER.resolution(np.array([-5.0, 0.1, 11.9, 50.0]))
    np.testing.assert_array_equal(ends[[0, 3]], ends[[1, 2]])


@pytest.mark.parametrize(
    ("heights", "moved"),
    [((0, 1), (0, 0)), ((0, 1), (0, -1)), ((0, 0), (0, 1)), ((0, -1), (0, 1)), ((0,), (0,))],
)
def test_a_map_of_one_place_or_that_does_not_rise_is_refused(heights, moved):
    with pytest.raises(ValueError, match="needs two places, and must rise"):
        ChamberMap(np.array(heights, float), np.tile(np.array(moved, float)[:, None], 3))


def test_a_parabola_is_all_sagitta():
    for sagitta in (-3.0, 2.0):
        z = sagitta * (1 - (X / 30) ** 2) + 0.02 * X + 7
        found = measure_shape(X, known(z))
        assert found is not None
        assert found.sagitta == pytest.approx(sagitta)
        assert found.roughness == pytest.approx(0, abs=1e-9)  # of second order: no form is left


@pytest.mark.parametrize(
    # ISO/TS 16610-31: 50 % at the cut-off; the ends, where the window is one-sided, leave less.
    ("part", "left"),
    [(0.25, (0.9, 1.1)), (0.5, (0.8, 1.1)), (1.0, (0.47, 0.53)), (3.0, (0, 0.1))],
)
def test_the_cutoff_parts_form_and_roughness(part, left):
    fine = np.linspace(-200, 200, 801)
    waves = np.sin(2 * np.pi * fine / (part * CUTOFF))
    found = measure_shape(fine, known(waves))
    assert found is not None
    assert left[0] <= found.roughness * np.sqrt(2) <= left[1]


@pytest.mark.parametrize(
    ("z", "expected"),
    [
        (0.02 * X, SurfaceKind.FLAT),
        (2 * CURVED * (X / 30) ** 2, SurfaceKind.CONCAVE),
        (-2 * CURVED * (X / 30) ** 2, SurfaceKind.CONVEX),
        (3 * ROUGH * np.sin(X), SurfaceKind.ROUGH),
        (np.where(np.abs(X) < 20, 4 - X**2 / 100, 0.0), SurfaceKind.CONVEX),
    ],
)
def test_kinds(z: np.ndarray, expected: SurfaceKind):
    noisy, gaps = z + np.random.default_rng(4).normal(0, 0.03, len(X)), np.arange(len(X)) % 3 > 0
    for heights in (known(z), known(noisy), known(z + 5 + 0.01 * X), Heights(gaps * z, gaps)):
        assert kind(X, heights) is expected


def test_too_little_is_undefined():
    assert classify_surface(None) is SurfaceKind.UNDEFINED
    number = np.arange(len(X))
    for there in (number < 0, number % 4 == 0, number < 15):
        assert there.sum() < LEAST_HEIGHTS or np.ptp(X[there]) < np.ptp(X) / 2
        assert kind(X, Heights(np.zeros(len(X)), there)) is SurfaceKind.UNDEFINED
    assert kind(np.zeros(0), Heights(np.zeros(0), np.zeros(0, bool))) is SurfaceKind.UNDEFINED
