"""The bent centre line against integrals of its tangent in 40 digits, and central differences."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from optics.chamber import bend_center_line
from tests.helpers import check_gradients

LENGTH = 100.0
BENDS_DEG = (0.0, np.rad2deg(1e-8), 0.01, 10.0, 90.0, 120.0)
BENDS = [sign * float(np.deg2rad(bend)) for bend in BENDS_DEG for sign in (1, -1)]
ARCS = np.array([0.0, 0.3, 35.0, 80.0, LENGTH])

ROUNDING = 8 * np.finfo(float).eps  # relative: a dozen operations
GRADIENT = 1e-7  # mm per radian, of some 1e2; what central differences can tell
KINDS = ("across", "along", "turned")


def integrated(bend: float, arc: float) -> tuple[float, float]:
    """The tangent (sin κs, cos κs) integrated by Gauss and Legendre's rule, in 40 digits."""
    with mpmath.workdps(40):
        curvature = mpmath.mpf(bend) / mpmath.mpf(LENGTH)
        ends = [0, mpmath.mpf(arc)]
        across = mpmath.quad(lambda s: mpmath.sin(curvature * s), ends, method="gauss-legendre")
        along = mpmath.quad(lambda s: mpmath.cos(curvature * s), ends, method="gauss-legendre")
        return float(mpmath.mpf(across)), float(mpmath.mpf(along))


@pytest.mark.parametrize("bend", BENDS)
def test_centre_line_is_its_tangent_integrated(bend):
    line = bend_center_line(jnp.asarray(ARCS), jnp.asarray(bend), jnp.asarray(LENGTH))
    across, along = np.transpose([integrated(bend, arc) for arc in ARCS])
    # The sine of a half turn's neighbour loses what its argument is rounded by: no bend is near.
    np.testing.assert_allclose(line.across, across, rtol=ROUNDING, atol=0)
    np.testing.assert_allclose(line.along, along, rtol=ROUNDING, atol=ROUNDING * LENGTH)
    np.testing.assert_allclose(line.turned, bend * ARCS / LENGTH, rtol=ROUNDING, atol=0)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_are_central_differences(kind):
    def place(values: tuple[jax.Array, jax.Array, jax.Array]) -> jax.Array:
        return getattr(bend_center_line(*values), kind)

    bends = [bend for bend in BENDS if bend == 0 or abs(bend) > 1e-6]
    points = np.array([(arc, bend, LENGTH) for arc in ARCS if arc > 0 for bend in bends])
    check_gradients(place, tuple(jnp.asarray(points.T)), atol=GRADIENT, rtol=GRADIENT)


def test_slopes_of_tiny_bends_do_not_cancel():
    # cos(κs) integrated: s − s³ κ²/6 + s⁵ κ⁴/120, κ in the bend over the length.
    bends, arc = np.array([1e-300, 1e-12, 1e-10, 1e-6, 0.09, 0.11]), 70.0
    series = -(arc**3) * bends / (3 * LENGTH**2) + arc**5 * bends**3 / (30 * LENGTH**4)
    seventh = arc**7 * bends**5 / (840 * LENGTH**6)  # the next term, with its factor
    along = jax.grad(lambda bend: bend_center_line(*map(jnp.asarray, (arc, bend, LENGTH))).along)
    found = jax.jit(jax.vmap(along))(jnp.asarray(bends))
    np.testing.assert_allclose(found, series - seventh, rtol=1e-7, atol=1e-13)
