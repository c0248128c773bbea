"""Long batches chunk by chunk, so that what is computed stays in cache; and calls side by side."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from designopt.cores import usable_cores

T = TypeVar("T")


def side_by_side(calls: Sequence[Callable[[], T]]) -> list[T]:
    """What calls return that do not depend on each other, each in a thread of its own.

    Of the calls as many run at a time as there are cores; within a worker of a sweep, one. Compiled
    programs run beside each other, what Python does in turn. Calls that need the same program
    should find it compiled: where two compile it at the same time, both do. After an interrupt
    nothing new begins; what has begun goes on until the process ends.

    Args:
        calls: each with the float type of the thread that calls this.

    Returns:
        What they return, in their order.

    Raises:
        Exception: what one of them raises, once those that had begun before are done.

    Example:
        >>> side_by_side([lambda: 1, lambda: 2])
        [1, 2]
    """
    doubled = jnp.result_type(float) == jnp.float64

    def run(call: Callable[[], T]) -> T:
        with jax.enable_x64(doubled):
            return call()

    cores = int(os.environ.get("NPROC") or usable_cores())  # as XLA counts its threads
    pool = ThreadPoolExecutor(max(min(len(calls), cores), 1))
    try:
        found = [pool.submit(run, call) for call in calls]
        failed = [one for one in wait(found, return_when=FIRST_EXCEPTION).done if one.exception()]
        if failed:
            pool.shutdown(cancel_futures=True)
        return [one.result() for one in failed or found]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


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

    def block(start: int) -> Any:
        chosen = np.minimum(np.arange(start, start + size), count - 1)
        given = jax.tree.map(lambda array: jnp.asarray(array[chosen]), batch)
        return jax.tree.map(np.asarray, program(*given))

    first = block(0)  # alone, for it compiles
    others = side_by_side([partial(block, start) for start in range(size, count, size)])
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:count], first, *others)
