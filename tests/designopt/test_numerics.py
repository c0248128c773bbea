"""Safe operations against the plain ones where those exist, and finite everywhere else."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from designopt import as_float, safe_arctan2, safe_divide, safe_quadratic_roots, safe_sqrt
from designopt.numerics import bisect, refine_root
from tests.designopt.tables import cases

moderate = st.floats(-1e6, 1e6).filter(lambda x: abs(x) > 1e-6)


quotient = jax.jit(jax.value_and_grad(lambda n, d: safe_divide(n, d)[0], argnums=(0, 1)))
arctan2 = jax.jit(safe_arctan2)
roots_of = jax.jit(safe_quadratic_roots)


@given(numerator=moderate, denominator=moderate)
def test_division_is_division_in_value_and_slope(numerator, denominator):
    value, slopes = quotient(numerator, denominator)
    np.testing.assert_allclose(value, numerator / denominator, rtol=1e-15)
    np.testing.assert_allclose(slopes, [1 / denominator, -numerator / denominator**2], rtol=1e-14)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [(1.0, 0.0), (0.0, 0.0), (1.0, 1e-160), (1e300, 1e-10), (-1.0, 1e-30)],
)
def test_division_beyond_the_range_is_reported(dtype, numerator, denominator):
    with jax.enable_x64(dtype == "float64"):
        n, d = np.minimum([numerator, denominator], np.finfo(dtype).max).astype(dtype)
        _, valid = jax.jit(safe_divide)(n, d)
        value, slopes = quotient(n, d)
        assert np.all(np.isfinite([value, *slopes]))
        # float64 holds 1/1e-30 and its slope.
        assert bool(valid) == (dtype == "float64" and denominator == 1e-30)


def test_division_of_arrays_judges_every_element():
    with jax.enable_x64(False):
        value, valid = safe_divide(jnp.asarray([3e38, 1.0, 3.0]), jnp.asarray([3e-6, 2.0, jnp.inf]))
    assert valid.tolist() == [False, True, True]
    assert value.tolist() == [0.0, 0.5, 0.0]


def test_square_root():
    roots = jax.vmap(jax.value_and_grad(safe_sqrt))(jnp.asarray([4.0, 0.0, -1.0]))
    np.testing.assert_allclose(roots, [[2, 0, 0], [0.25, 0, 0]])


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_square_root_has_finite_slopes_of_several_orders_where_it_is_zero(dtype):
    slope = safe_sqrt
    for _ in range(3):
        slope = jax.jit(jax.grad(slope))
        assert [float(slope(dtype(value))) for value in (0.0, -1.0)] == [0.0, 0.0]


@given(y=moderate, x=moderate)
def test_arctan2_is_the_plain_one(y, x):
    np.testing.assert_allclose(arctan2(y, x), np.arctan2(y, x))


@given(first=moderate, second=moderate, lead=moderate)
def test_quadratic_roots_are_those_it_was_made_of(first, second, lead):
    coefficients = [lead, -lead * (first + second), lead * first * second]
    roots, exist, discriminant = roots_of(*coefficients)
    found = sorted(root for root, real in zip(roots.tolist(), exist.tolist(), strict=True) if real)
    if abs(first - second) > 1e-4 * max(abs(first), abs(second)):
        assert float(discriminant) > 0
        np.testing.assert_allclose(found, sorted([first, second]), rtol=1e-7)


def test_quadratic_keeps_the_small_root():
    """x² − 1e8 x + 1 = 0: the schoolbook formula gives 7.45e-9 for the root at 1e-8."""
    roots, exist, _ = roots_of(1.0, -1e8, 1.0)
    assert np.all(exist)
    np.testing.assert_allclose(sorted(roots.tolist()), [1e-8, 1e8], rtol=1e-15)


root_slopes = jax.jit(jax.jacrev(lambda *c: safe_quadratic_roots(*c)[0], argnums=(0, 1, 2)))


@pytest.mark.parametrize(("coefficients", "expected"), cases("quadratics"))
def test_degenerate_quadratics_are_finite(coefficients, expected):
    roots, exist, discriminant = map(np.asarray, roots_of(*coefficients))
    assert roots[exist].tolist() == expected
    assert np.all(np.isfinite(roots))
    assert float(discriminant) >= -1
    slopes = root_slopes(*coefficients)
    assert np.all(np.isfinite(slopes))


def test_quadratic_gradient_is_the_implicit_one():
    # 2x² − 7x + 3 has roots 1/2 and 3; dx/dc0 = −1 / (4x − 7), dx/dc1 = x dx/dc0, and so on.
    x, coefficients = np.array([0.5, 3.0]), (2.0, -7.0, 3.0)
    order = np.argsort(roots_of(*coefficients)[0])
    for power, slopes in zip((2, 1, 0), root_slopes(*coefficients), strict=True):
        np.testing.assert_allclose(slopes[order], -(x**power) / (4 * x - 7), rtol=1e-12)


def test_bisection_of_every_element_ends_on_both_sides_of_its_own_step():
    steps, start = np.array([0.1, -0.7, 0.9]), jnp.full(3, -1.0)
    last, first = bisect(lambda x: x < steps, start, -start)
    assert np.all(last < steps)
    assert np.all(first >= steps)
    np.testing.assert_allclose(last, first, rtol=1e-15)
    coarse = bisect(lambda x: x < steps, start, -start, 3)
    np.testing.assert_allclose(coarse[1] - coarse[0], 2 / 2**3)


def test_a_refined_root_has_the_slope_of_the_root():
    def root(a):
        return refine_root(lambda a, x: x**3 - a, a, jnp.asarray(2 + 1e-8))

    np.testing.assert_allclose(jax.value_and_grad(root)(8.0), (2, 1 / 12), rtol=1e-7)
    flat = jax.value_and_grad(lambda a: refine_root(lambda a, x: a + 0 * x, a, jnp.asarray(2.0)))
    assert flat(1.0) == (2.0, 0.0)


def test_as_float_keeps_float_types_and_lifts_the_rest():
    assert as_float(3).dtype == jnp.float64
    assert as_float(3.0).weak_type is False
    assert as_float(jnp.asarray(3.0, jnp.float32)).dtype == jnp.float32
    assert as_float(np.int64(3)).dtype == jnp.float64
