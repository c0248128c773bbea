"""Least squares against linear algebra, the scatter of repeated fits, and central differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import least_squares
from designopt.fitting import add_information

X = np.linspace(0.0, 3.0, 13)
TRUTH = 2.0, -0.7
DEVIATION = 0.01


def residuals(parameters, data):
    amplitude, rate = parameters
    return (amplitude * jnp.exp(rate * X) - data) / DEVIATION


def noisy(seed):
    noise = np.random.default_rng(seed).normal(scale=DEVIATION, size=X.shape)
    return TRUTH[0] * np.exp(TRUTH[1] * X) + noise


fitted = jax.jit(least_squares, static_argnums=0, static_argnames="max_steps")


def fit_of(data):
    return fitted(residuals, jnp.asarray([1.0, 0.0]), data)


def test_a_linear_fit_is_the_normal_equations():
    design = np.stack([np.ones(13), np.asarray(X)], axis=1)
    data = np.random.default_rng(1).normal(size=13)
    fit = fitted(lambda p, data: design @ p - data, jnp.zeros(2), jnp.asarray(data))
    expected, chi_squared, _, _ = np.linalg.lstsq(design, data)
    assert bool(fit.solution.ok)
    np.testing.assert_allclose(fit.solution.value, expected, rtol=1e-8)
    np.testing.assert_allclose(fit.chi_squared, chi_squared[0], rtol=1e-10)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(design.T @ design), rtol=1e-8)
    np.testing.assert_allclose(fit.residuals, design @ expected - data, atol=1e-8)
    assert float(fit.solution.residual) < 1e-8


def test_covariance_is_the_scatter_of_repeated_fits():
    fits = jax.jit(jax.vmap(fit_of))(np.stack([noisy(seed) for seed in range(400)]))
    assert np.all(fits.solution.ok)
    scatter = np.cov(np.asarray(fits.solution.value).T)
    # 400 draws know a variance to 7 % (1 σ).
    np.testing.assert_allclose(np.mean(fits.covariance, axis=0), scatter, rtol=0.25)
    np.testing.assert_allclose(np.mean(fits.chi_squared), 11, rtol=0.1)


def test_the_derivative_in_the_data_is_implicit():
    data, step = noisy(0), 1e-5 * np.eye(13)[4]
    rate = jax.jit(jax.vmap(jax.value_and_grad(lambda data: fit_of(data).solution.value[1])))
    (_, high, low), (gradient, *_) = rate(np.stack([data, data + step, data - step]))
    expected = (high - low) / 2e-5
    # Implicit derivatives of a least-squares solution are exact at its minimum.
    np.testing.assert_allclose(gradient[4], expected, rtol=1e-4)


def test_parameters_that_cannot_be_told_apart_have_no_margin():
    fit = fitted(lambda p, _: (p[0] + p[1]) * X - 1.0, jnp.asarray([1.0, 0.0]))
    assert float(fit.solution.margin) < 1e-7
    assert np.all(np.isfinite(fit.covariance))


def test_degenerate_fits_have_finite_derivatives_in_a_batch():
    def first(target):
        model = least_squares(lambda p, a: (p[0] + p[1]) * X - a, jnp.asarray([1.0, 0.0]), target)
        return model.solution.value[0]

    slopes = jax.jit(jax.vmap(jax.grad(first)))(jnp.asarray([1.0, 2.0]))
    assert np.all(np.isfinite(slopes))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_the_unit_of_the_residuals_does_not_matter(dtype):
    def fit_in(unit):
        return least_squares(lambda p, unit: unit * (p * x - 1), jnp.asarray([5.0], dtype), unit)

    x = X.astype(dtype)
    with jax.enable_x64(dtype == "float64"):
        fit = jax.jit(jax.vmap(fit_in))(np.asarray([1e-14, 1.0, 1e14], dtype))
    assert np.all(fit.solution.ok)
    # A minimum is flat: its place is known to the square root of rounding.
    rtol = float(np.sqrt(np.finfo(dtype).eps))
    np.testing.assert_allclose(fit.solution.value, np.sum(x) / np.sum(x**2), rtol=rtol)


def test_a_perfect_fit_is_ok():
    fit = fitted(lambda p, _: p * X - 2 * X, jnp.asarray([5.0]))
    assert bool(fit.solution.ok)
    np.testing.assert_allclose(fit.solution.value, 2.0, rtol=1e-9)


def test_a_fit_that_does_not_arrive_says_so():
    fit = fitted(residuals, jnp.asarray([1.0, 0.0]), noisy(0), max_steps=2)
    assert not bool(fit.solution.ok)


def test_residuals_outside_their_domain_are_reported_and_stay_finite():
    fit = fitted(lambda p, _: jnp.sqrt(p[0]) * X - 1, jnp.asarray([-1.0]))
    assert not bool(fit.solution.ok)
    assert fit.solution.messages()[0]
    parts = (fit.solution.value, fit.solution.margin, fit.solution.residual)
    assert all(np.all(np.isfinite(part)) for part in (*parts, fit.covariance, fit.chi_squared))


def test_information_adds_to_the_inverse_of_a_covariance():
    roots = np.random.default_rng(0).normal(size=(2, 5, 5))
    covariance, information = (root @ root.T for root in roots)
    expected = np.linalg.inv(np.linalg.inv(covariance) + information)
    np.testing.assert_allclose(add_information(covariance, information), expected, rtol=1e-9)
    # What is held stays held, and the others are as if it were not there.
    held = covariance.copy()
    held[2] = held[:, 2] = 0
    free = np.delete(np.arange(5), 2)
    parts = np.ix_(free, free)
    expected = np.zeros((5, 5))
    expected[parts] = np.linalg.inv(np.linalg.inv(held[parts]) + information[parts])
    np.testing.assert_allclose(add_information(held, information), expected, atol=1e-9)
