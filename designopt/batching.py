"""Long batches in one compiled program, chunk by chunk, so that what is computed stays in cache."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array


def map_in_chunks(function: Callable[[Any], Any], batch: Any, max_chunk_size: int) -> Any:
    """A function of a batch, applied to at most ``max_chunk_size`` of its elements at a time.

    Args:
        function: takes a batch and returns one; it treats each element by itself.
        batch: arrays with the batch along their first axis.
        max_chunk_size: elements. A batch that is no longer is one chunk, without a loop.

    Returns:
        What the function returns for the whole batch.
    """
    count = jax.tree.leaves(batch)[0].shape[0]
    if count <= max_chunk_size:
        return function(batch)
    # Chunks of one size, near the wanted one; the last is filled up with the last element.
    sizes = range(max_chunk_size, max_chunk_size // 2, -1)
    size = next((s for s in sizes if count % s == 0), max_chunk_size)
    chunks = -(-count // size)

    def fold(leaf: Array) -> Array:
        if chunks * size != count:
            last = jnp.repeat(leaf[-1:], chunks * size - count, axis=0)
            leaf = jnp.concatenate([leaf, last])
        return leaf.reshape(chunks, size, *leaf.shape[1:])

    done = jax.lax.map(function, jax.tree.map(fold, batch))
    return jax.tree.map(lambda leaf: leaf.reshape(chunks * size, *leaf.shape[2:])[:count], done)


def map_blocks(program: Callable[..., Any], size: int, *batch: Any) -> Any:
    """A compiled function of a batch of one size, applied to a batch of any other.

    Args:
        program: takes batches of ``size`` elements and returns one; it treats each by itself.
        size: elements. The last block is filled up with the last element.
        batch: arguments, with the batch along the first axis of their arrays.

    Returns:
        What the function returns for the whole batch, as NumPy arrays.

    Example:
        >>> map_blocks(jax.jit(jnp.add), 2, np.arange(3.0), np.ones(3)).tolist()
        [1.0, 2.0, 3.0]
    """
    count = len(jax.tree.leaves(batch)[0])
    blocks = []
    for start in range(0, count, size):
        chosen = np.minimum(np.arange(start, start + size), count - 1)
        block = jax.tree.map(lambda array, chosen=chosen: jnp.asarray(array[chosen]), batch)
        blocks.append(jax.tree.map(np.asarray, program(*block)))
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *blocks)
