"""The network against loops in NumPy, its loss by hand, slopes against central differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from perception.posture import PostureNetwork, compute_weighted_loss
from perception.posture.training import Rates, objective

CHANNELS = (2, 3, 4, 3)
SIZE = (13, 10)
"""Columns and rows: odd and even."""

SINGLE = 1e-5
"""Sums of at most a hundred products in float32 differ by less, of values about 1."""


def network(seed: int = 0) -> PostureNetwork:
    """With biases and a last layer, which are zero at first."""
    generator = np.random.default_rng(seed)
    made = PostureNetwork(SIZE, CHANNELS, generator)

    def noisy(leaf: jax.Array) -> jax.Array:
        return jnp.asarray(np.asarray(leaf) + 0.1 * generator.normal(size=leaf.shape), leaf.dtype)

    return jax.tree.map(noisy, made)


answered = eqx.filter_jit(lambda network, image: network(image))


def images(count: int) -> np.ndarray:
    return np.random.default_rng(9).normal(size=(count, SIZE[1], SIZE[0])).astype(np.float32)


def convolved(image: np.ndarray, weight: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """A pixel at a time; channels last."""
    rows, columns, _ = image.shape
    out = np.zeros((-(-rows // 2), -(-columns // 2), len(bias)))
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            out[row, column] = bias
            for i in range(3):
                for j in range(3):
                    r, c = 2 * row + i - 1, 2 * column + j - 1
                    if 0 <= r < rows and 0 <= c < columns:
                        out[row, column] += image[r, c] @ weight[i, j]
    return out


def test_as_loops_over_pixels():
    made, image = network(), images(1)[0]
    values = image[..., None].astype(float)
    for layer in made.convolutions:
        weight, bias = np.asarray(layer.weight, float), np.asarray(layer.bias, float)
        values = np.maximum(convolved(values, weight, bias), 0)
    expected = (values.reshape(-1) @ np.asarray(made.weight, float)).reshape(3, 2)
    expected += np.asarray(made.bias, float).reshape(3, 2)
    found = answered(made, image[None])
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, expected, atol=SINGLE)


def test_a_new_one_answers_zero_and_squared_weights_leave_biases_out():
    new = PostureNetwork(SIZE, CHANNELS, np.random.default_rng(0))
    assert not np.any(answered(new, images(1)))
    made = network()
    leaves = [np.asarray(leaf, float) for leaf in jax.tree.leaves(made)]
    expected = sum(np.sum(leaf**2) for leaf in leaves if leaf.ndim > 1)
    found = eqx.filter_jit(PostureNetwork.squared_weights)(made)
    assert float(found) == pytest.approx(expected, rel=1e-6)


def test_equation_4_by_hand():
    markers = jnp.zeros((2, 3, 2))
    predicted = jnp.array(
        [[[1.0, 2.0], [0.0, 3.0], [1.0, 1.0]], [[0.0, 0.0], [2.0, 0.0], [0.0, -1.0]]]
    )
    # 0.5·5 + 1·9 + 1.5·2 = 14.5 and 0.5·0 + 1·4 + 1.5·1 = 5.5
    assert float(compute_weighted_loss(predicted, markers, jnp.array([0.5, 1.0, 1.5]))) == 10.0


def test_gradient_against_central_differences():
    made = jax.tree.map(lambda leaf: leaf.astype(jnp.float64), network())
    shown = jnp.asarray(images(4), jnp.float64)
    markers = jnp.asarray(np.random.default_rng(3).normal(size=(4, 3, 2)))
    rates = Rates(
        learning_rate=jnp.asarray(0.003, jnp.float32),
        decay=jnp.asarray(1.0, jnp.float32),
        regularisation=jnp.asarray(0.3),
        loss_weights=jnp.asarray([0.5, 1.0, 1.5]),
        steps=jnp.asarray(1, jnp.int32),
    )

    @eqx.filter_jit
    def value(at: PostureNetwork) -> jax.Array:
        return objective(at, shown, markers, rates)[0]

    slopes = eqx.filter_jit(eqx.filter_grad(value))(made)
    generator, step = np.random.default_rng(4), 1e-6
    start = jax.tree.map(np.asarray, made)
    for _ in range(5):
        along = jax.tree.map(lambda leaf: generator.normal(size=leaf.shape), made)
        ahead, behind = (
            value(jax.tree.map(lambda leaf, d, s=sign: leaf + s * step * d, start, along))
            for sign in (1.0, -1.0)
        )
        pairs = zip(jax.tree.leaves(slopes), jax.tree.leaves(along), strict=True)
        slope = sum(np.vdot(own, direction) for own, direction in pairs)
        assert float(ahead - behind) / (2 * step) == pytest.approx(slope, rel=1e-6)
