"""Batches in blocks against the same function of the whole batch, and calls side by side."""

import threading
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import batching
from designopt.batching import map_blocks, map_in_chunks, side_by_side


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


def test_blocks_of_one_program_give_what_the_whole_batch_gives():
    batch = np.random.default_rng(0).normal(size=(23, 3)), np.arange(23.0)
    found = map_blocks(jax.jit(lambda *block: rows(block)), 4, *batch)
    for leaf, wanted in zip(found, rows(jax.tree.map(jnp.asarray, batch)), strict=True):
        np.testing.assert_allclose(leaf, wanted, rtol=1e-15)


def test_calls_run_at_the_same_time_and_return_in_their_order(monkeypatch):
    monkeypatch.setenv("NPROC", "3")
    together = threading.Barrier(3, timeout=10)

    def call(number: int) -> int:
        together.wait()
        return number

    assert side_by_side([partial(call, number) for number in range(3)]) == [0, 1, 2]
    assert side_by_side([]) == []


@pytest.mark.parametrize("doubled", [False, True])
def test_calls_have_the_float_type_of_their_caller(doubled):
    with jax.enable_x64(doubled):
        found = side_by_side([lambda: jnp.zeros(()).dtype] * 2)
    assert found == [jnp.dtype("float64" if doubled else "float32")] * 2


def test_what_a_call_raises_comes_out_once_those_that_have_begun_are_done(monkeypatch):
    monkeypatch.setenv("NPROC", "2")
    begun, done = threading.Event(), threading.Event()

    def fail() -> None:
        begun.wait(30)
        raise KeyError("this one")

    def other() -> None:
        begun.set()
        done.wait(0.1)
        done.set()

    with pytest.raises(KeyError, match="this one"):
        side_by_side([fail, other])
    assert done.is_set()


def test_an_interrupt_does_not_wait_for_what_has_begun(monkeypatch):
    monkeypatch.setenv("NPROC", "1")
    begun, release = threading.Event(), threading.Event()
    later = []

    def long() -> None:
        begun.set()
        release.wait(30)

    def interrupted(*_, **__) -> None:
        begun.wait(30)
        raise KeyboardInterrupt

    monkeypatch.setattr(batching, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        side_by_side([long, lambda: later.append(1)])
    assert not release.is_set()
    release.set()
    assert later == []


def test_there_are_as_many_threads_as_cores(monkeypatch):
    monkeypatch.delenv("NPROC", raising=False)
    monkeypatch.setattr(batching, "usable_cores", lambda: 3)
    together = threading.Barrier(3, timeout=10)
    side_by_side([together.wait] * 6)
    assert not together.broken
