"""The bend from markers, against integrated arcs, brute force and markers that are none."""

import numpy as np
import pytest
from scipy.optimize import fminbound

from perception.posture import Bends, fit_bend

LENGTH = 100.0
ARCS = (10.0, 40.0, 70.0, 100.0)
BENDS = np.deg2rad([-179.0, -90.0, -1e-6, 0.0, 1e-6, 0.5, 30.0, 92.0, 120.0, 179.0])

NUDGED = 1e-8  # radians: slopes by differences are off by 1e-9 of themselves
SEARCHED = 2e-5  # radians: how well a search finds a least value, the root of rounding


def integrated(bend: float) -> np.ndarray:
    """Markers by Gauss and Legendre's rule from the tangent (sin κs, cos κs)."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    places = []
    for arc in ARCS:
        turned = bend / LENGTH * arc * (nodes + 1) / 2
        places.append([arc / 2 * weights @ np.sin(turned), arc / 2 * weights @ np.cos(turned)])
    return np.array(places[1:]) - np.array(places[0])


def found(markers: np.ndarray) -> Bends:
    return fit_bend(markers, ARCS, LENGTH)


def test_an_arc_has_its_bend_and_nothing_is_left():
    fit = found(np.stack([integrated(bend) for bend in BENDS]))
    assert fit.known.all()
    np.testing.assert_allclose(fit.bend, BENDS, atol=NUDGED)
    np.testing.assert_allclose(fit.residual, 0, atol=NUDGED * LENGTH)


def test_noisy_markers_as_by_brute_force():
    generator = np.random.default_rng(5)
    bends = np.deg2rad(generator.uniform(-100, 120, 12))
    markers = np.stack([integrated(bend) for bend in bends])
    markers += np.tile([3.0, 20.0], 6)[:, None, None] * generator.standard_normal(markers.shape)
    fit = found(markers)
    grid = np.linspace(-np.pi, np.pi, 401)
    drawn = np.stack([integrated(bend) for bend in grid])
    for wanted, bend, residual in zip(markers, fit.bend, fit.residual, strict=True):

        def squares(bend: float, wanted=wanted) -> float:
            return float(np.sum((integrated(bend) - wanted) ** 2))

        start = grid[np.argmin(np.sum((drawn - wanted) ** 2, axis=(1, 2)))]
        bounds = (max(start - 0.02, -np.pi), min(start + 0.02, np.pi))
        best = float(np.asarray(fminbound(squares, *bounds, xtol=1e-10)))
        assert bend == pytest.approx(best, abs=SEARCHED)
        assert squares(bend) <= squares(best) * (1 + 1e-12)
        assert residual == pytest.approx(np.sqrt(squares(bend) / 3), rel=1e-9)


@pytest.mark.parametrize("place", [(0, 0), (1, 1), (2, 0)])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300, -1001.0])
def test_markers_that_are_none_are_not_known_and_finite(bad, place):
    markers = np.stack([integrated(0.5)] * 3)
    markers[1][place] = bad
    fit = found(markers)
    assert fit.known.tolist() == [True, False, True]
    assert (fit.bend[1], fit.residual[1]) == (0, 0)
    np.testing.assert_allclose(fit.bend[[0, 2]], 0.5, atol=NUDGED)


@pytest.mark.parametrize(
    "arcs",
    [ARCS, *(tuple(LENGTH * (1 - apart * np.arange(3, -1, -1))) for apart in (2e-6, 1e-3, 0.3))],
)
def test_any_markers_have_a_finite_answer(arcs):
    """However small, large, or close together along the finger they are."""
    generator, shape = np.random.default_rng(6), (300, 3, 2)
    markers = 10.0 ** generator.uniform(-12, 3, shape) * generator.choice([-1, 1], shape)
    fit = fit_bend(markers, arcs, LENGTH)
    assert fit.known.all()
    assert (np.abs(fit.bend) <= np.pi).all()
    assert np.isfinite(fit.residual).all()
    assert found(markers[:0]).bend.shape == (0,)


@pytest.mark.parametrize(
    ("place", "arc"),
    [(1, 10.0), (2, 40.0), (3, 30.0), (0, -1.0), (3, 101.0), (3, np.nan), (0, np.nan), (3, np.inf)],
)
def test_markers_that_do_not_rise_along_the_finger_are_refused(place, arc):
    first, second, third, last = (*ARCS[:place], arc, *ARCS[place + 1 :])
    with pytest.raises(ValueError, match="rise along the finger"):
        fit_bend(integrated(0.5)[None], (first, second, third, last), LENGTH)


@pytest.mark.parametrize("length", [0.0, -100.0, np.nan, np.inf])
def test_lengths_that_are_none_are_refused(length):
    with pytest.raises(ValueError, match="length is positive"):
        fit_bend(integrated(0.5)[None], ARCS, length)
