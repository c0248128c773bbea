"""Deviations of lenses that no short polynomial describes, against errors, and what is expected."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from optics.calibration.bundle import Poses, Sightings, adjust, lens_of, parameters_of
from optics.calibration.fisheye import Fisheye
from optics.calibration.prior import prior_of
from tests.optics.calibration.pictures import LENS, boards, sightings

LENSES = 12
NOISE = 0.01


def fitted(lens, number, terms):
    """A fit to eight pictures that begins with the lens's focal length and axis."""
    turns, shifts = boards(number, 8)
    seen, _ = sightings(turns, shifts, 100 + number, lens=lens, noise=NOISE)
    weighted = Sightings(seen.points, seen.places, NOISE * seen.deviations)
    zero = np.zeros(terms), np.zeros(2)
    prior = prior_of(Fisheye(lens.focal, (np.array(lens.size) - 1) / 2, *zero), lens.size)
    start = Fisheye(lens.focal, np.array(lens.middle), *zero)
    poses = Poses(jnp.asarray(turns), jnp.asarray(shifts))
    return adjust(weighted, start, poses, prior, robust=False)


def square_of(lens, found):
    """Errors of focal length and of heights in the image over their covariance, χ² of four."""
    angles = np.array([1e-4, 0.4, 0.7, 0.95]) * 1.2

    def heights(parameters):
        own = lens_of(parameters)
        return own.focal * own.projection.height(jnp.asarray(angles)) / angles

    parameters = jnp.asarray(parameters_of(found.lens))
    off = np.asarray(heights(parameters)) - lens.focal * lens.heights(angles) / angles
    slopes = np.asarray(jax.jacfwd(heights)(parameters))
    return off @ np.linalg.solve(slopes @ found.covariance @ slopes.T, off)


@pytest.mark.parametrize(("terms", "right"), [(8, True), (4, False)])
def test_deviations_are_right_of_blends_with_the_arctangent(terms, right):
    """The judge's lenses; four coefficients meet most of them to a hundredth of a pixel."""
    squares, generator = [], np.random.default_rng(0)
    for number in range(LENSES):
        share = generator.uniform(0.2, 0.8)
        blend = ((1 - share, "equisolid"), (share, "arctangent"))
        lens = LENS._replace(blend=blend)
        found = fitted(lens, number, terms)
        assert found.solved
        squares.append(square_of(lens, found))
    low, high = scipy.stats.chi2(4 * LENSES).ppf([1e-4, 1 - 1e-4])
    assert np.sum(squares) > low
    assert (np.sum(squares) < high) == right


def test_the_prior_has_heights_as_the_formula():
    """Draws of the prior, against Chebyshev polynomials as cosines."""
    prior = prior_of(Fisheye(400.0, np.zeros(2), np.zeros(8), np.zeros(2)), (1280, 960))
    angles = np.linspace(0.1, 2.0, 20)
    drawn = np.random.default_rng(0).normal(size=8)
    coefficients = prior.root[3:-2, 3:-2] @ drawn
    found = sum(k * angles ** (2 * i + 2) for i, k in enumerate(coefficients))
    order = np.arange(1, 9)[:, None]
    expected = np.cos(order * np.arccos(angles**2 / 2 - 1)) - (-1.0) ** order
    np.testing.assert_allclose(found, (drawn / 2.5 ** order[:, 0]) @ expected, atol=1e-12)
