"""Long batches in one compiled program, block by block, so that what is computed stays in cache."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array


def in_blocks(function: Callable[[Any], Any], batch: Any, most: int) -> Any:
    """A function of a batch, applied to at most ``most`` of its elements at a time.

    Args:
        function: takes a batch and returns one; it treats each element by itself.
        batch: arrays with the batch along their first axis.
        most: elements of a block. A batch that is no longer is one block, without a loop.

    Returns:
        What the function returns for the whole batch.
    """
    count = jax.tree.leaves(batch)[0].shape[0]
    if count <= most:
        return function(batch)
    # Blocks of one size, near the wanted one; the last is filled up with the last element.
    size = next((s for s in range(most, most // 2, -1) if count % s == 0), most)
    blocks = -(-count // size)

    def fold(leaf: Array) -> Array:
        if blocks * size != count:
            last = jnp.repeat(leaf[-1:], blocks * size - count, axis=0)
            leaf = jnp.concatenate([leaf, last])
        return leaf.reshape(blocks, size, *leaf.shape[1:])

    done = jax.lax.map(function, jax.tree.map(fold, batch))
    return jax.tree.map(lambda leaf: leaf.reshape(blocks * size, *leaf.shape[2:])[:count], done)
