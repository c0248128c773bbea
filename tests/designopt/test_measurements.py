"""Error against run time, stability and what was left out, on problems with known answers."""

import os
import threading
import time
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from threadpoolctl import threadpool_info

from designopt import (
    BenchmarkMethod,
    Family,
    PrecisionRow,
    PrecisionStudy,
    Ratio,
    Results,
    Solution,
    assess,
    benchmark,
    count_operations,
    find_dominating,
    find_undominated,
    one_core,
)
from designopt.study.page import measurements


class Outcome(eqx.Enumeration):
    successful = ""
    negative = "The argument is negative."


def row(method, panel, error, seconds):
    return PrecisionRow(method, "", panel, error, seconds, 0.9 * seconds, 1.1 * seconds, 0.0)


@pytest.mark.parametrize(("repeats", "budget", "count"), [(4, 60.0, 5), (9, 0.005, 3)])
def test_a_sleeping_call_is_timed_as_it_sleeps(repeats, budget, count):
    """After a warm-up; a call beyond the budget is its own, and has three samples."""
    calls = []

    def call():
        calls.append(1)
        time.sleep(0.01)
        return 3.0

    method = BenchmarkMethod("m", "s", "p", call, lambda answer: answer - 2.5, 7.0, scale=50.0)
    [found] = benchmark([method], repeats=repeats, budget_seconds=budget)
    assert (found.error, found.compile_seconds, len(calls)) == (0.5, 7.0, count)
    assert 0.5 <= found.seconds_low <= found.seconds <= found.seconds_high


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system pins no threads")
def test_one_core_holds_every_thread_and_lets_go():
    release, ids = threading.Event(), []

    def wait():
        ids.append(threading.get_native_id())
        release.wait(30)

    thread = threading.Thread(target=wait)
    thread.start()
    while not ids:
        time.sleep(1e-3)
    before = os.sched_getaffinity(ids[0])
    try:
        with one_core() as pinned:
            assert pinned
            assert len(os.sched_getaffinity(ids[0])) == 1
            threads = [one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"]
            assert set(threads) == {1}
            assert os.sched_getaffinity(ids[0]) == os.sched_getaffinity(0)
        assert os.sched_getaffinity(ids[0]) == before
    finally:
        release.set()
        thread.join()


def test_a_ratio_is_of_times_taken_in_turn():
    def sleeping(seconds, scale):
        return BenchmarkMethod("", "", "", lambda: time.sleep(seconds), lambda _: 0.0, scale=scale)

    fast, slow = benchmark([sleeping(4e-3, 1.0), sleeping(4e-3, 50.0)], repeats=3)
    ratio = Ratio.of(slow, fast)
    assert ratio.low <= ratio.value <= ratio.high
    assert 10 < ratio.value < 250  # scaled by 50, with a sleep's own inaccuracy


def test_dominating_rows_are_faster_and_closer_in_the_same_panel():
    ours = row("closed", "a", 1e-10, 1.0)
    faster_and_closer = row("x", "a", 1e-12, 0.5)
    others = [
        faster_and_closer,
        row("slower", "a", 1e-12, 2.0),
        row("coarser", "a", 1e-8, 0.5),
        row("within the spread", "a", 1e-12, 0.95),
        row("elsewhere", "b", 1e-12, 0.5),
    ]
    assert find_dominating(ours, others) == [faster_and_closer]


def test_the_claim_that_no_other_method_is_better_can_be_proved_wrong():
    def holds(*others):
        return find_undominated([row("ours", "p", 1e-15, 1.0), *others], "ours")[1]

    assert holds(row("x", "p", 1e-16, 2.0), row("y", "p", 1e-14, 0.1), row("z", "q", 0.0, 0.1))
    assert not holds(row("x", "p", 1e-16, 0.1))


def test_precision_figure_has_a_panel_per_workload_and_a_line_per_method():
    rows = [row("m", "a", 0.0, 1.0), row("n", "a", 1e-3, 2.0), row("n", "b", 1e-4, 3.0)]
    study = PrecisionStudy(rows, "error of y", "the truth", ())
    [part] = measurements(Results([], [], precision=study))
    drawing = part.figures[0].drawing
    titles = [axis.get_title() for axis in drawing.axes]
    assert titles == ["a", "b"]
    assert {axis.get_xscale() for axis in drawing.axes} == {"log"}
    assert [len(axis.containers) for axis in drawing.axes] == [2, 1]
    assert {text.get_text() for text in drawing.legends[0].get_texts()} == {"m", "n"}
    [table] = part.tables
    assert [record[:3] for record in table.rows] == [["a", "m", ""], ["a", "n", ""], ["b", "n", ""]]


def successful(value, margin):
    code = Outcome.where(margin == margin, Outcome.successful, Outcome.negative)
    return Solution(value, margin, jnp.zeros_like(margin), code)


def good_root(x):
    safe = jnp.where(x > 0, x, 1.0)
    result = Outcome.where(x > 0, Outcome.successful, Outcome.negative)
    return Solution(jnp.where(x > 0, jnp.sqrt(safe), 0.0), x, jnp.zeros_like(x), result)


def wrong_gradient(x):
    value = good_root(x).value
    # It stays, and its slope doubles.
    return replace(good_root(x), value=2 * value - jax.lax.stop_gradient(value))


def off_by_a_millionth(x):
    return replace(good_root(x), value=good_root(x).value * (1 + 1e-6))


def never_fails(x):
    return successful(jnp.sqrt(jnp.abs(x)), x)


def not_a_number(x):
    return replace(good_root(x), value=jnp.sqrt(x))


def nan_called_ok(x):
    return replace(good_root(x), value=jnp.where(x > 1, jnp.nan, good_root(x).value))


def family(solve):
    powers = 10.0 ** np.linspace(-12, 12, 9)
    inputs = {"x": np.concatenate([powers, [-1.0, -2.0]])}
    return Family("roots", inputs, solve, mpmath.sqrt, lambda x: x)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_good_solver_passes(dtype):
    [found] = assess(family(lambda x: good_root(x)), (dtype,))
    assert (found.cases, found.infeasible, found.failures, found.non_finite) == (11, 2, 0, 0)
    rounding = np.finfo(dtype).eps
    assert found.worst_error < rounding
    assert found.worst_gradient_error < 2 * rounding


@pytest.mark.parametrize(
    ("solve", "failures", "non_finite"),
    [
        (wrong_gradient, 9, 0),
        (off_by_a_millionth, 9, 0),
        (never_fails, 2, 0),
        (nan_called_ok, 4, 4),
        (not_a_number, 0, 4),  # two values and two gradients, of the cases reported as failed
    ],
)
def test_a_bad_solver_is_found_out(solve, failures, non_finite):
    [found] = assess(family(solve), ("float64",))
    assert (found.failures, found.non_finite) == (failures, non_finite)


def test_an_input_of_zero_is_still_judged():
    inputs = {"x": np.array([0.0]), "y": np.array([2.0])}
    for fault, failures in ((0.0, 0), (1e-3, 1)):

        def solve(x, y, fault=fault):
            return successful(x * y + fault * x, x + 1)

        zero = Family("zero", inputs, solve, lambda x, y: x * y, lambda x, y: x + 1)
        [found] = assess(zero, ("float64",))
        assert found.failures == failures


def test_stability_figure_names_families_without_an_answer():
    rows = assess(family(good_root), ("float64", "float32"))
    hopeless = Family("hopeless", {"x": np.array([-1.0])}, good_root, mpmath.sqrt, lambda x: x)
    rows += assess(hopeless, ("float64",))
    [part] = measurements(Results([], [], stability=rows))
    drawing = part.figures[0].drawing
    labels = [label.get_text() for label in drawing.axes[0].get_yticklabels()]
    assert labels == ["roots", "hopeless"]
    assert [text.get_text() for text in drawing.axes[0].texts] == ["no case has an answer"]
    assert len(part.tables[0].rows) == 3


def test_operations_are_counted_and_unused_ones_left_out():
    x = jnp.linspace(0.0, 1.0, 6)
    one = count_operations(jnp.sin, x)
    assert one == 1
    assert count_operations(lambda x: jnp.sin(x) * jnp.cos(x) + jnp.tan(x), x) == 5
    assert count_operations(lambda x: (jnp.sin(x), jnp.cos(x))[0], x) == one
