"""One end's curve against the curve it was made from, and against repeats; answers in general."""

import math

import numpy as np
import pytest

from perception.matching import Sighting
from perception.proprioception import (
    EdgeCurve,
    EdgeEstimator,
    Estimate,
    fit_edges,
    make_undefined,
    select_defined,
)
from perception.proprioception.edge import BEYOND, PARABOLA
from perception.quality import Quality
from tests.perception.proprioception.toy import missing, sighting_of, view_of

VIEW = ("low", "direct")
OTHER = ("low", "mirror:low")
NOISE, LABELS = 0.004, 0.01
DEVIATIONS = {"label_deviation": LABELS, "edge_deviation": NOISE}
LOW, HIGH = -0.6, 0.4
"""Labelled section angles of an end, rad."""


def line(section: np.ndarray | float) -> np.ndarray:
    return np.asarray(0.7 - 1.4 * np.asarray(section))


def parabola(section: np.ndarray | float) -> np.ndarray:
    return np.asarray(0.7 - 1.4 * np.asarray(section) + 0.3 * np.asarray(section) ** 2)


def first_end(section: float) -> Sighting:
    """The other end is cut off."""
    return sighting_of(
        view_of(*VIEW, (section, np.nan), shown=(True, False), quality=Quality.CLIPPED)
    )


def ruler_of(sections: np.ndarray, labels: np.ndarray) -> EdgeEstimator:
    return fit_edges([first_end(one) for one in sections.tolist()], labels, [VIEW], **DEVIATIONS)


@pytest.mark.parametrize(
    ("count", "curve", "terms"),
    [(2, line, 2), (PARABOLA - 1, line, 2), (PARABOLA, parabola, 3), (9, parabola, 3)],
)
def test_exact_frames_give_back_their_curve(count, curve, terms):
    sections = np.linspace(LOW, HIGH, count)
    ruler = ruler_of(sections, curve(sections))
    assert [(c.pad, c.path, c.end, len(c.coefficients)) for c in ruler.curves] == [
        (*VIEW, 0, terms)
    ]
    for section in np.linspace(LOW - 0.2, HIGH + 0.2, 7):
        estimate = ruler.estimate(first_end(section))
        assert estimate.angle == pytest.approx(float(curve(section)), abs=1e-9)
        assert estimate.reason == "end 0 of low, direct"


def test_few_frames_of_a_curve_have_the_line_of_least_squares():
    sections = np.array([LOW, -0.3, 0.1, HIGH])
    slope, constant = np.polyfit(sections, parabola(sections), 1)
    estimate = ruler_of(sections, parabola(sections)).estimate(first_end(0.2))
    assert estimate.angle == pytest.approx(constant + 0.2 * slope, abs=1e-9)


def test_frames_that_do_not_move_have_no_curve_and_two_angles_a_line():
    for sections, terms in (
        (np.array([0.1]), []),
        (np.linspace(0, 3.9 * NOISE, 6), []),
        (np.linspace(0, 4.1 * NOISE, 5), [3]),
        (np.array([LOW, HIGH] * 4), [2]),
    ):
        curves = ruler_of(sections, line(sections)).curves
        assert [len(curve.coefficients) for curve in curves] == terms


@pytest.mark.parametrize("count", [3, 7])
def test_far_beyond_the_labelled_range_nothing_is_said(count):
    sections = np.linspace(LOW, HIGH, count)
    ruler = ruler_of(sections, line(sections))
    beyond = BEYOND * (HIGH - LOW)
    for inside in (LOW - 0.99 * beyond, HIGH + 0.99 * beyond):
        assert ruler.estimate(first_end(inside)).defined
    for outside in (LOW - 1.01 * beyond, HIGH + 1.01 * beyond, math.nan):
        estimate = ruler.estimate(first_end(outside))
        assert not estimate.defined
        assert estimate.reason == "the end lies outside of the labelled range"


def full(section: float) -> Sighting:
    """Both ends of both views; the last moves most, and gives a joint angle best."""
    angle = float(line(section))
    return sighting_of(
        view_of(*VIEW, (0.2 * angle, 0.5 * angle)), view_of(*OTHER, (0.8 * angle, -2.0 * angle))
    )


def full_ruler(views: tuple[tuple[str, str], ...] = (VIEW, OTHER)) -> EdgeEstimator:
    sections = np.linspace(LOW, HIGH, 7)
    frames = [full(one) for one in sections.tolist()]
    return fit_edges(frames, line(sections), views, **DEVIATIONS)


def test_of_several_ends_the_best_is_taken():
    ruler = full_ruler()
    assert [(c.path, c.end) for c in ruler.curves] == [
        ("direct", 0), ("direct", 1), ("mirror:low", 0), ("mirror:low", 1),
    ]  # fmt: skip
    estimate = ruler.estimate(full(0.1))
    assert estimate.angle == pytest.approx(float(line(0.1)), abs=1e-9)
    assert estimate.reason == "end 1 of low, mirror:low"


def test_an_end_that_is_not_seen_or_beyond_its_range_gives_way_to_another():
    ruler, angle = full_ruler(), float(line(0.1))
    # What stands for the end that is cut off would mislead.
    cut = view_of(*OTHER, (0.8 * angle, 0.3), shown=(True, False), quality=Quality.CLIPPED)
    within = view_of(*VIEW, (0.2 * angle, 0.5 * angle))
    beyond = view_of(*VIEW, (3.0, 0.5 * angle)), view_of(*OTHER, (3.0, 3.0))
    for views, end in (((within, cut), "0 of low, mirror:low"), (beyond, "1 of low, direct")):
        estimate = ruler.estimate(sighting_of(*views))
        assert estimate.angle == pytest.approx(angle, abs=1e-9)
        assert estimate.reason == f"end {end}"


@pytest.mark.parametrize(
    "sighting",
    [
        sighting_of(),
        sighting_of(missing(*VIEW)),
        sighting_of(view_of("high", "direct", (0.1, 0.2))),
        sighting_of(view_of(*VIEW, (0.1, 0.2), shown=(False, False), quality=Quality.CLIPPED)),
    ],
    ids=["nothing", "missing", "another pad", "cut off at both ends"],
)
def test_without_a_labelled_end_there_is_no_angle(sighting):
    estimate = full_ruler((VIEW,)).estimate(sighting)
    assert not estimate.defined
    assert math.isinf(estimate.deviation)
    assert estimate.reason == "no labelled end is seen"


def test_a_curve_is_of_the_frames_that_show_its_end_and_have_a_label():
    sections = np.linspace(LOW, HIGH, 6)
    hidden = view_of(*VIEW, (9.0, 9.0), shown=(False, False))
    spoilt = [first_end(float(section)) for section in (*sections, 0.0)]
    spoilt += [sighting_of(missing(*VIEW)), sighting_of(), sighting_of(hidden)]
    labels = np.append(parabola(sections), [np.nan, 5.0, 6.0, 7.0])
    ruler = fit_edges(spoilt, labels, [VIEW], **DEVIATIONS)
    expected = ruler_of(sections, labels[:6])
    for name in ("coefficients", "covariance"):
        found, wanted = (getattr(one.curves[0], name) for one in (ruler, expected))
        np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_a_known_curve_errs_by_the_ends_noise_times_its_slope():
    curve = EdgeCurve(*VIEW, 0, np.array([0.7, -1.4, 0.3]), np.zeros((3, 3)), NOISE, 0.1, (-1, 1))
    for section in (-0.4, 0.1, 0.5):
        slope = -1.4 + 0.6 * (section - 0.1)
        assert curve.estimate(section).deviation == pytest.approx(abs(slope) * NOISE)


def test_through_two_frames_an_angle_errs_as_between_two_points():
    first, second = -0.5, 0.3
    ruler = ruler_of(np.array([first, second]), line(np.array([first, second])))
    for asked in (-0.6, -0.1, 0.4):
        shares = np.array([second - asked, asked - first]) / (second - first)
        label = LABELS**2 + (1.4 * NOISE) ** 2
        expected = np.sqrt(np.sum(shares**2) * label + (1.4 * NOISE) ** 2)
        assert ruler.estimate(first_end(asked)).deviation == pytest.approx(expected)


def test_frames_that_scatter_more_than_stated_are_believed_less():
    generator, found, stated = np.random.default_rng(2), [], []
    sections = np.linspace(LOW, HIGH, 10)
    for _ in range(200):
        labels = parabola(sections) + generator.normal(0, 5 * LABELS, len(sections))
        estimate = ruler_of(sections, labels).estimate(first_end(0.5))
        found.append(estimate.angle)
        stated.append(estimate.deviation)
    # 200 draws know a deviation to 5 % (1 σ); the end's own noise is a small part of it.
    assert np.mean(stated) == pytest.approx(np.std(found), rel=0.15)


def test_only_finite_angles_are_defined_and_the_first_of_these_counts():
    nothing, found = make_undefined("the pad is covered"), Estimate(1e-300, 0.1, "found")
    assert math.isnan(nothing.angle)
    assert math.isinf(nothing.deviation)
    assert (nothing.reason, nothing.defined) == ("the pad is covered", False)
    for angle, defined in ((math.inf, False), (-math.inf, False), (0.0, True), (1e-300, True)):
        assert Estimate(angle, 0.1, "found").defined is defined
    assert select_defined(nothing, found, Estimate(0.0, 0.1, "later")) is found
    assert select_defined(nothing, make_undefined("later")) is nothing
