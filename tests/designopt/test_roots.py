"""Root finding, every method and float type: known roots, derivatives, failures."""

from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import find_root
from designopt.roots import RootMethod

METHODS = get_args(RootMethod)
NEEDS_DEFAULT_FLOAT = ("dogleg", "levenberg-marquardt")


found_by = jax.jit(find_root, static_argnums=0, static_argnames=("method", "bracket"))


def cubic(y, a):
    """One real root for a > 0: y³ + a y = 1 has y(a) with dy/da = −y / (3y² + a)."""
    return y**3 + a * y - 1


def true_root(a: float) -> float:
    return float(next(r.real for r in np.roots([1, 0, a, -1]) if abs(r.imag) < 1e-12))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("method", METHODS)
def test_root_margin_and_residual(method, dtype):
    with jax.enable_x64(dtype == "float64"):
        guess, a = np.asarray([0.7, 2.0], dtype)
        found = found_by(cubic, guess, a, method=method, bracket=(-1, 2))
        assert bool(found.ok), found.messages()
        assert found.value.dtype == dtype
    # The residual's slope is about 2.6, so its tolerance of 8 units bounds the root's error.
    tolerance = 8 * float(np.finfo(dtype).eps) if dtype == "float32" else 1e-12
    np.testing.assert_allclose(found.value, true_root(2.0), rtol=2 * tolerance)
    np.testing.assert_allclose(found.margin, 3 * true_root(2.0) ** 2 + 2, rtol=1e-5)
    assert float(found.residual) <= 10 * tolerance


@pytest.mark.parametrize("method", METHODS)
def test_derivative_is_the_implicit_one(method):
    def root(a):
        return find_root(cubic, jnp.asarray(0.7), a, method=method, bracket=(-1, 2)).value

    y = true_root(2.0)
    expected = -y / (3 * y**2 + 2)
    (_, high, low), (slope, *_) = jax.jit(jax.vmap(jax.value_and_grad(root)))(
        np.array([2.0, 2.0 + 1e-5, 2.0 - 1e-5])
    )
    np.testing.assert_allclose(slope, expected, rtol=1e-9)
    np.testing.assert_allclose((high - low) / 2e-5, expected, rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_batch_holds_its_failures(method):
    """y² + a has no root for a = 1: that element reports it, the other does not notice."""

    def residual(y, a):
        return y * y + a

    def solve(a):
        found = find_root(residual, jnp.asarray(1.5), a, method=method, bracket=(0, 3))
        return found.value, found

    values, found = jax.jit(jax.vmap(solve))(jnp.asarray([-4.0, 1.0]))
    np.testing.assert_allclose(values[0], 2.0, rtol=1e-9)
    assert found.ok.tolist() == [True, False]
    assert found.messages()[0] == ""
    assert found.messages()[1]
    finite = jax.tree.map(lambda leaf: bool(jnp.all(jnp.isfinite(leaf))), found)
    assert jax.tree.leaves((finite.value, finite.margin, finite.residual)) == 3 * [True]


def test_a_flat_residual_fails_with_finite_derivative():
    def root(a):
        return find_root(lambda y, a: 0 * y + a, jnp.asarray(0.5), a).value

    assert np.all(np.isfinite(jax.jit(jax.value_and_grad(root))(1.0)))


def test_a_falling_residual_is_bisected_too():
    found = found_by(lambda y, _: 1 - y, jnp.asarray(0.0), method="bisection", bracket=(0, 3))
    assert bool(found.ok)
    np.testing.assert_allclose(found.value, 1.0, rtol=1e-11)


def test_a_tolerance_below_rounding_is_raised_to_it():
    assert bool(found_by(cubic, jnp.asarray(0.7), jnp.asarray(2.0), tolerance=0.0).ok)


@pytest.mark.parametrize("method", ["bisection", "jaxopt-bisection"])
def test_a_bisection_needs_a_bracket(method):
    with pytest.raises(ValueError, match=r"pass bracket=\(lower, upper\)"):
        find_root(cubic, jnp.asarray(0.7), jnp.asarray(2.0), method=method)


@pytest.mark.parametrize("method", NEEDS_DEFAULT_FLOAT)
def test_methods_that_mix_float_types_say_so(method):
    single = jnp.asarray(0.7, jnp.float32)
    with pytest.raises(ValueError, match=r"enable_x64\(False\)"):
        find_root(cubic, single, single, method=method)


@pytest.mark.parametrize("method", ["newton", "chord", "jaxopt-gauss-newton"])
def test_a_residual_outside_its_domain_is_reported_and_stays_finite(method):
    found = found_by(lambda y, _: jnp.sqrt(y) + 0.1, jnp.asarray(0.5), method=method)
    assert not bool(found.ok)
    assert all(np.isfinite(part) for part in (found.value, found.margin, found.residual))
