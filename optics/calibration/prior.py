"""What is known of a lens before anything is seen: its image heights are smooth in the angle.

Over focal length and angle they are 1 + Σ cₙ (Tₙ(2 θ²/θₘ² − 1) − Tₙ(−1)), with Chebyshev's
polynomials Tₙ up to θₘ. The cₙ of an analytic function fall by a constant factor (L. N. Trefethen,
*Approximation Theory and Approximation Practice*, 2013, theorem 8.1, which is not read): by 2.6 for
the arctangent, which is singular at θ = ±i, and faster for the projections of textbooks. Expected
deviations of cₙ that fall alike leave a polynomial free where corners determine it, and tame
beyond; and as it has more terms than most lenses need, the covariance counts what a shorter one
would lack.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from optics.calibration.bundle import Prior, parameters_of
from optics.calibration.fisheye import Fisheye

WIDEST = 2.0
"""Angle θₘ up to which heights are smooth, rad."""

BEND, FALL = 1.0, 2.5
"""Deviations of cₙ are `BEND` / `FALL`ⁿ."""

ASIDE = 0.1
"""Deviation of the principal point from the image's middle, over the image's width."""

PUPIL = 3.0, 1.5
"""Deviations of e₂ and e₄, mm."""


def prior_of(lens: Fisheye, size: tuple[int, int]) -> Prior:
    """What is known of a lens that is roughly the given one, in the middle of the image.

    The focal length has a deviation of its own size.

    Args:
        lens: where a search starts.
        size: columns and rows of the image.

    Example:
        >>> prior = prior_of(Fisheye(400.0, np.zeros(2), np.zeros(8), np.zeros(2)), (1280, 960))
        >>> np.sqrt(np.sum(prior.root**2, axis=1))[:4].round(2).tolist()
        [400.0, 128.0, 128.0, 0.54]
    """
    mean, terms = parameters_of(lens), len(lens.coefficients)
    root = np.diag([mean[0], *2 * [ASIDE * size[0]], *terms * [0.0], *PUPIL])
    for n in range(1, terms + 1):
        one = Chebyshev.basis(n, domain=[0, WIDEST**2]).convert(kind=Polynomial)
        root[3 : 3 + n, 2 + n] = BEND / FALL**n * np.real(one.coef[1:])
    return Prior(mean, root)
