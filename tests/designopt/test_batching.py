"""Batches in blocks against the same function of the whole batch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.batching import map_in_chunks


def rows(batch: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
    """Of every element by itself: its row's sum by its number, and its row turned round."""
    row, number = batch
    return jnp.sum(row, axis=1) * number, row[:, ::-1]


@pytest.mark.parametrize(("count", "most"), [(1, 4), (4, 4), (5, 4), (12, 5), (13, 5), (13, 1)])
def test_blocks_give_what_the_whole_batch_gives(count, most):
    rng = np.random.default_rng(count)
    batch = jnp.asarray(rng.normal(size=(count, 3))), jnp.asarray(rng.normal(size=count))
    found = jax.jit(lambda batch: map_in_chunks(rows, batch, most))(batch)
    for leaf, wanted in zip(found, rows(batch), strict=True):
        np.testing.assert_allclose(leaf, wanted, rtol=1e-15)


def test_derivatives_pass_through_blocks():
    batch = jnp.arange(21.0).reshape(7, 3), jnp.arange(7.0)
    slopes = jax.jit(jax.grad(lambda batch: jnp.sum(map_in_chunks(rows, batch, 2)[0])))(batch)
    np.testing.assert_array_equal(slopes[0], np.repeat(np.arange(7.0)[:, None], 3, axis=1))
    np.testing.assert_array_equal(slopes[1], np.asarray(batch[0]).sum(axis=1))


@pytest.mark.parametrize(
    ("count", "most", "size"), [(8, 8, 8), (9, 8, 8), (12, 8, 6), (91, 50, 50)]
)
def test_blocks_are_no_longer_than_asked_and_equal_if_they_can_be(count, most, size):
    seen = []

    def watched(batch: jax.Array) -> jax.Array:
        seen.append(batch.shape[0])
        return batch

    map_in_chunks(watched, jnp.arange(float(count)), most)
    assert set(seen) == {size}
