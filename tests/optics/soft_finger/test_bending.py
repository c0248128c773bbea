"""The bent centre line against integrals of its tangent in 40 digits, and central differences."""

from __future__ import annotations

import functools

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


@functools.cache
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


def slope(kind: str, bend: float, arc: float) -> float:
    """By the bend, compiled and batched."""

    def place(bend: jax.Array, arc: jax.Array) -> jax.Array:
        return getattr(bend_center_line(arc, bend, jnp.asarray(LENGTH)), kind)

    slopes = jax.jit(jax.vmap(jax.grad(place)))
    return float(slopes(jnp.asarray([bend, 1.0]), jnp.asarray([arc, 1.0]))[0])


@pytest.mark.parametrize("arc", [1.0, 35.0, LENGTH])
def test_a_straight_finger_begins_to_bend_as_a_parabola(arc):
    assert slope("across", 0.0, arc) == pytest.approx(arc**2 / (2 * LENGTH), rel=ROUNDING)
    assert slope("along", 0.0, arc) == 0
    assert slope("turned", 0.0, arc) == pytest.approx(arc / LENGTH, rel=ROUNDING)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_are_central_differences(kind):
    def place(values: tuple[jax.Array, jax.Array, jax.Array]) -> jax.Array:
        return getattr(bend_center_line(*values), kind)

    bends = [bend for bend in BENDS if bend == 0 or abs(bend) > 1e-6]
    arcs = [arc for arc in ARCS if arc > 0]
    points = np.array([(arc, bend, LENGTH) for arc in arcs for bend in bends])
    batch = tuple(jnp.asarray(column) for column in points.T)
    found = np.transpose(jax.jit(jax.vmap(jax.grad(place)))(batch))
    compiled = jax.jit(place)
    wanted = [
        central_differences(compiled, tuple(jnp.asarray(value) for value in point))
        for point in points
    ]
    np.testing.assert_allclose(found, wanted, atol=GRADIENT, rtol=GRADIENT)


@pytest.mark.parametrize("bend", [1e-300, 1e-12, 1e-10, 1e-6, 0.09, 0.11])
def test_slopes_of_tiny_bends_do_not_cancel(bend):
    # cos(κs) integrated: s − s³ κ²/6 + s⁵ κ⁴/120, κ in the bend over the length.
    arc = 70.0
    series = -(arc**3) * bend / (3 * LENGTH**2) + arc**5 * bend**3 / (30 * LENGTH**4)
    seventh = arc**7 * bend**5 / (840 * LENGTH**6)  # the next term, with its factor
    assert slope("along", bend, arc) == pytest.approx(series - seventh, rel=1e-7, abs=1e-13)
