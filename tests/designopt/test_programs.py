"""Programs, and what answers for them until they are compiled."""

from __future__ import annotations

import math
import os
import threading

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from designopt.compilation_cache import Store
from designopt.optimize import Evaluation, Minimizer, Problem
from designopt.programs import (
    LEAST_PACKED,
    MOST_PACKED,
    Program,
    Prompt,
    QuickJit,
    known_options,
)
from tests.commands import python


def made(function=None, **given):
    """A program, and how often its function was traced."""
    traced = []

    def counted(*args, **kwargs):
        traced.append(args)
        return (function or jnp.sin)(*args, **kwargs)

    return Program(counted, **given), traced


def test_results_are_those_of_jax_whatever_their_types():
    def several(x):
        own = {"sum": x.sum(), "same": x, "whole": jnp.arange(3), "any": x > 0, "none": None}
        return own | {"more": [n + x for n in range(LEAST_PACKED)]}

    x = np.linspace(-1.0, 1.0, 5)
    wanted = jax.jit(several)(x)
    found = Program(several)(x)
    assert jax.tree.structure(found) == jax.tree.structure(wanted)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        assert isinstance(one, np.ndarray)
        assert (one.shape, one.dtype) == (other.shape, other.dtype)
        np.testing.assert_array_equal(one, other)


def test_large_results_are_not_copied_into_one():
    program = Program(lambda x: [n * x for n in range(LEAST_PACKED)])
    small, large = np.ones(3), np.ones(MOST_PACKED)
    for numbers, results in ((small, 1), (large, LEAST_PACKED)):
        assert len(program.compiled(numbers).arrays) == results
        np.testing.assert_array_equal(program(numbers)[5], 5 * numbers)
    few = Program(lambda x: (x, 2 * x))
    assert len(few.compiled(small).arrays) == 2


def test_a_program_is_traced_by_jax_like_any_function():
    program, _ = made(lambda x: jnp.sum(x**3))
    slope = jax.grad(program)(jnp.array([1.0, 2.0]))
    np.testing.assert_allclose(slope, [3.0, 12.0])
    with Prompt().answering():
        np.testing.assert_allclose(jax.jit(program)(jnp.array([1.0, 2.0])), 9.0)


def test_static_arguments_have_programs_of_their_own():
    program = Program(lambda x, *, power: x**power, static_argnames=["power"])
    prompt = Prompt()
    with prompt.answering():
        assert float(program(3.0, power=2)) == 9.0
        assert float(program(3.0, power=3)) == 27.0
        assert float(program(2.0, power=2)) == 4.0
    assert len(prompt._calls) == 2


def test_nothing_is_compiled_before_it_is_asked_for():
    program, traced = made()
    prompt, numbers = Prompt(), np.array([0.3, 0.4])
    assert not prompt.is_behind
    with prompt.answering():
        assert program.when_compiled(numbers) is None
        assert not traced
        np.testing.assert_allclose(program(numbers), np.sin(numbers), rtol=1e-15)
        np.testing.assert_allclose(program(2 * numbers), np.sin(2 * numbers), rtol=1e-15)
    assert len(traced) == 1
    assert prompt.is_behind
    assert not program.compiled.compiled_count
    prompt.compile()
    assert not prompt.is_behind
    assert program.compiled.compiled_count == 1
    with prompt.answering():
        np.testing.assert_allclose(program.when_compiled(numbers), np.sin(numbers), rtol=1e-15)
        program(3 * numbers)
    assert len(traced) == 1  # for NumPy and for XLA


def test_arguments_of_another_shape_are_compiled_next():
    program, _ = made()
    prompt = Prompt()
    with prompt.answering():
        program(np.zeros(2))
        prompt.compile()
        program(np.zeros(3))
        assert prompt.is_behind
        program.expect(np.zeros(4))
        prompt.compile()
        assert program.when_compiled(np.zeros(4)) is not None
    program.expect(np.zeros(5))  # of no prompt
    assert not prompt.is_behind
    np.testing.assert_array_equal(program.when_compiled(np.zeros(5)), np.zeros(5))


def test_a_prompt_answers_in_its_own_thread_only():
    program, _ = made()
    prompt, found = Prompt(), []
    with prompt.answering():
        other = threading.Thread(target=lambda: found.append(program.when_compiled(np.zeros(2))))
        other.start()
        other.join()
    assert found[0] is not None
    assert not prompt.is_behind


def test_what_cannot_be_compiled_is_answered_still():
    program, other = made()[0], made(jnp.cos)[0]
    prompt = Prompt()
    with prompt.answering():
        program(1.0)
        other(1.0)

    def refused(*_):
        raise ValueError("no such thing")

    program.compiled = refused
    prompt._calls[next(iter(prompt._calls))].run = refused
    with pytest.raises(ValueError, match="no such thing"):
        prompt.compile()
    assert not prompt.is_behind
    prompt.compile()  # it is not tried again
    with prompt.answering():
        assert float(program(1.0)) == pytest.approx(math.sin(1.0))
        assert float(other.when_compiled(1.0)) == pytest.approx(math.cos(1.0))


def test_options_unknown_to_xla_are_left_out(monkeypatch):
    known = {"xla_cpu_use_fusion_emitters": False}
    monkeypatch.setattr("designopt.programs.QUICK", known | {"xla_no_such_option": True})
    before = jax.config.values["jax_disable_most_optimizations"]
    try:
        for without, expected in ((True, {}), (False, known)):
            jax.config.update("jax_disable_most_optimizations", without)
            known_options.cache_clear()
            assert known_options() == expected
    finally:
        jax.config.update("jax_disable_most_optimizations", before)
        known_options.cache_clear()


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setattr("designopt.compilation_cache.STORES", [Store(tmp_path)])
    monkeypatch.setattr("designopt.programs.PACKAGES", ("tests",))
    return tmp_path


class Waves(eqx.Module):
    """What a kept program is given and returns."""

    height: Array
    kind: str = eqx.field(static=True)


CALLS = []


def raised(waves, by, *, times=1):
    CALLS.append(times)
    return Waves(waves.height * times + by["more"], waves.kind), None


def of_another_process(function):
    """The same program, as a process finds it that has not compiled it."""
    return QuickJit(function, ["times"])


@pytest.mark.usefixtures("store")
def test_a_compiled_program_is_kept_and_not_traced_again():
    CALLS.clear()
    for height in (1.0, 2.0):
        raise_ = of_another_process(raised)
        waves, by = Waves(jnp.array([height, 5.0]), "high"), {"more": 0.5}
        for _ in range(2):
            found, nothing = raise_(waves, by, times=3)
            assert (found.height.tolist(), found.kind) == ([3 * height + 0.5, 15.5], "high")
            assert nothing is None
    assert CALLS == [3]
    # Other static arguments, kinds and types are other programs.
    assert raise_(waves, by, times=2)[0].height.tolist() == [4.5, 10.5]
    assert raise_(Waves(waves.height, "low"), by, times=3)[0].kind == "low"
    single = raise_(Waves(waves.height.astype(jnp.float32), "high"), by, times=3)[0]
    assert single.height.dtype == jnp.float32
    strong = raise_(Waves(waves.height, "high"), {"more": jnp.array(0.5)}, times=3)[0]
    assert strong.height.dtype == jnp.float64
    assert CALLS[:4] == [3, 2, 3, 3]


def test_a_function_within_another_one_is_not_kept(store):
    def local(value):
        return 2 * value

    assert QuickJit(local)(jnp.array(1.0)) == 2
    assert not list(store.iterdir())
    assert QuickJit(local, name="the double")(jnp.array(1.0)) == 2
    assert list(store.iterdir())


def test_a_function_of_somebody_else_is_not_kept(store, monkeypatch):
    monkeypatch.setattr("designopt.programs.PACKAGES", ("designopt",))
    waves, by = Waves(jnp.ones(2), "high"), {"more": 0.5}
    assert QuickJit(raised, ["times"])(waves, by, times=7)[0].height.tolist() == [7.5, 7.5]
    assert not list(store.iterdir())


@pytest.mark.usefixtures("store")
def test_within_another_program_it_is_a_part_of_that():
    double = QuickJit(raised)
    slope = jax.grad(lambda x: jnp.sum(double(Waves(x, "high"), {"more": x})[0].height))
    np.testing.assert_allclose(slope(jnp.ones(3)), [2.0] * 3)
    found = jax.vmap(lambda x: double(Waves(x, "high"), {"more": x})[0].height)(jnp.ones((2, 3)))
    np.testing.assert_allclose(found, np.full((2, 3), 2.0))


@pytest.mark.usefixtures("store")
def test_a_program_of_numpy_is_kept_and_not_traced_again():
    CALLS.clear()
    for _ in range(2):
        with Prompt().answering():
            program = Program(raised, ["times"])
            found, _ = program(Waves(jnp.ones(2), "high"), {"more": 0.5}, times=4)
        assert found.height.tolist() == [4.5, 4.5]
    assert CALLS == [4]


@pytest.mark.usefixtures("store")
def test_problems_are_compiled_once_for_all_of_their_name():
    traced = []

    def named(name):
        def terms(x, goal):
            traced.append(name)
            return Evaluation(objective=jnp.sum((x - goal) ** 2), inequalities={"high": x - 1})

        return Problem(
            terms, jnp.zeros(2), jnp.full(2, 9.0), data=(jnp.array([2.0, 0.5]),), name=name
        )

    starts = jnp.full((2, 2), 4.0)
    for name, is_new in (("squares", True), ("squares", False), ("", True), ("", True)):
        traced.clear()
        compiled = Minimizer(named(name), 2, "bfgs")
        count = len(traced)
        best = compiled.solve(starts).best
        np.testing.assert_allclose(best.parameters, [2.0, 1.0], atol=1e-6)
        assert best.solution.ok
        if name:
            # What solves is kept; shapes are asked for all the same.
            assert (count > 3) == is_new


AGAIN = """
import sys
import jax
from designopt.compilation_cache import STORES, keep_programs

keep_programs()
if sys.argv[1] == "jax":
    STORES.clear()
import jax.numpy as jnp
from designopt.programs import QuickJit

def waves(x):
    matrix = jnp.outer(x, x) + jnp.eye(100)
    return jnp.sort(jnp.sin(x)) @ jnp.linalg.solve(matrix, jnp.cos(jnp.arange(100.0)))

print(float(QuickJit(waves, name="waves")(jnp.arange(100.0))))
"""


@pytest.mark.parametrize("foreign", [False, True])
def test_what_jax_has_read_is_not_kept_as_compiled(tmp_path, foreign):
    """XLA cannot write again what it has read; such a program would fail when it is run."""
    ours = ("DESIGNOPT_CACHE", "JAX_COMPILATION_CACHE_DIR")
    env = {name: value for name, value in os.environ.items() if name not in ours}
    env |= {"DESIGNOPT_CACHE": str(tmp_path / "kept")}
    if foreign:
        env |= {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "jax")}
        env |= {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    found = [python("-c", AGAIN, who, env=env) for who in ("jax", "both", "both")]
    assert [done.stderr for done in found] == ["", "", ""]
    assert len({done.stdout for done in found}) == 1
