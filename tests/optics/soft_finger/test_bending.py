"""The bent centre line against integrals of its tangent in 40 digits, and central differences."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from optics.chamber import bend_center_line
from tests.helpers import central_differences

LENGTH = 100.0
BENDS_DEG = (0.0, np.rad2deg(1e-8), 0.01, 10.0, 90.0, 120.0)
BENDS = [sign * float(np.deg2rad(bend)) for bend in BENDS_DEG for sign in (1, -1)]
ARCS = np.array([0.0, 0.3, 35.0, 80.0, LENGTH])

ROUNDING = 8 * np.finfo(float).eps  # relative: a dozen operations
GRADIENT = 1e-7  # mm per radian, of some 1e2; what central differences can tell
KINDS = ("across", "along", "turned")


@jax.jit
def slopes(arcs: jax.Array, bends: jax.Array) -> dict[str, tuple[jax.Array, ...]]:
    """Of every kind by arc, bend and length, batched."""

    def of(kind: str) -> tuple[jax.Array, ...]:
        slope = jax.grad(lambda *at: getattr(bend_center_line(*at), kind), (0, 1, 2))
        return jax.vmap(slope, (0, 0, None))(arcs, bends, jnp.asarray(LENGTH))

    return {kind: of(kind) for kind in KINDS}


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


def test_a_straight_finger_begins_to_bend_as_a_parabola():
    arcs = np.array([1.0, 35.0, LENGTH])
    across, along, turned = (slopes(jnp.asarray(arcs), jnp.zeros(3))[kind][1] for kind in KINDS)
    np.testing.assert_allclose(across, arcs**2 / (2 * LENGTH), rtol=ROUNDING)
    np.testing.assert_array_equal(along, 0)
    np.testing.assert_allclose(turned, arcs / LENGTH, rtol=ROUNDING)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_are_central_differences(kind):
    @jax.jit
    def place(values: tuple[jax.Array, jax.Array, jax.Array]) -> jax.Array:
        return getattr(bend_center_line(*values), kind)

    bends = [bend for bend in BENDS if bend == 0 or abs(bend) > 1e-6]
    points = np.array([(arc, bend, LENGTH) for arc in ARCS if arc > 0 for bend in bends])
    found = np.transpose(slopes(*jnp.asarray(points[:, :2].T))[kind])
    wanted = [central_differences(place, tuple(map(jnp.asarray, point))) for point in points]
    np.testing.assert_allclose(found, wanted, atol=GRADIENT, rtol=GRADIENT)


def test_slopes_of_tiny_bends_do_not_cancel():
    # cos(κs) integrated: s − s³ κ²/6 + s⁵ κ⁴/120, κ in the bend over the length.
    bends, arc = np.array([1e-300, 1e-12, 1e-10, 1e-6, 0.09, 0.11]), 70.0
    series = -(arc**3) * bends / (3 * LENGTH**2) + arc**5 * bends**3 / (30 * LENGTH**4)
    seventh = arc**7 * bends**5 / (840 * LENGTH**6)  # the next term, with its factor
    found = slopes(jnp.full(6, arc), jnp.asarray(bends))["along"][1]
    np.testing.assert_allclose(found, series - seventh, rtol=1e-7, atol=1e-13)
