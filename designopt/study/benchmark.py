"""Error against run time: every method at every setting on every workload, measured the same way.

A study names its methods as `BenchmarkMethod`s; `benchmark` times and checks them, and a
`designopt.Claim` states what they show and whether it holds in this run.
"""

from __future__ import annotations

import math
import os
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
from threadpoolctl import threadpool_limits

from designopt.study.results import PrecisionRow, PrecisionStudy

MIN_SAMPLE_SECONDS = 2e-3
"""A timed sample repeats its call until it lasts this long, so that the clock's grain is lost."""

BUDGET_SECONDS = 0.25
"""Once the samples of a method have taken this long, three of them are enough."""

THREADS = Path("/proc/self/task")


@dataclass(frozen=True)
class BenchmarkMethod:
    """One method at one setting on one workload.

    Attributes:
        method: its name, the same at every setting.
        setting: what is varied, such as ``"tolerance 1e-06"``.
        panel: the workload; methods are compared with each other on each of them.
        call: answers the workload; a JAX function is compiled beforehand (`compile_timed`).
        error: from the call's answer to its worst error against the reference.
        compile_seconds: what compiling it took, 0 where nothing is compiled.
        scale: workload over what ``call`` does of it, for a method so slow that a part has to
            represent the whole; its setting must name them.
    """

    method: str
    setting: str
    panel: str
    call: Callable[[], Any]
    error: Callable[[Any], float]
    compile_seconds: float = 0.0
    scale: float = 1.0


class Ratio(NamedTuple):
    """A run time over another one, each sampled once in every round with the other.

    What slows the machine down for a while slows both, so that it is steadier than a ratio of
    medians.

    Attributes:
        value: median over the rounds.
        low: least.
        high: largest.
    """

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, row: PrecisionRow, base: PrecisionRow) -> Ratio:
        """Run time of ``row`` over that of ``base``, of one `benchmark`."""
        ratios = [a / b for a, b in zip(row.samples, base.samples, strict=False)]
        return cls(statistics.median(ratios), min(ratios), max(ratios))


def compile_timed(function: Callable[..., Any], *args: Any) -> tuple[Callable[..., Any], float]:
    """``function`` compiled for arguments like ``args``, and the seconds that took.

    Example:
        >>> import jax.numpy as jnp
        >>> double, seconds = compile_timed(lambda x: 2 * x, jnp.array(3.0))
        >>> float(double(jnp.array(3.0))), seconds > 0
        (6.0, True)
    """
    start = time.perf_counter()
    compiled = jax.jit(function).lower(*args).compile()
    return compiled, time.perf_counter() - start


def compile_methods(
    name: str,
    panel: str,
    error: Callable[[Any], float],
    function: Callable[..., Any],
    *args: Any,
    settings: Mapping[str, Any] | None = None,
) -> list[BenchmarkMethod]:
    """A JAX function as a method, at each of its settings; one program serves them all.

    Args:
        name: of the method.
        panel: the workload.
        error: from an answer to its error.
        function: of ``args`` and, where there are settings, of one of their values at the end.
        args: the workload's arrays.
        settings: values by what is written for them.

    Example:
        >>> import jax.numpy as jnp
        >>> shift = {"by 1": jnp.array(1.0), "by 2": jnp.array(2.0)}
        >>> [one, two] = compile_methods(
        ...     "sum", "3", lambda y: float(y - 4), jnp.add, jnp.array(3.0), settings=shift
        ... )
        >>> two.setting, two.error(two.call())
        ('by 2', 1.0)
    """
    rows = [(word, (*args, value)) for word, value in (settings or {}).items()] or [("", args)]
    compiled, seconds = compile_timed(function, *rows[0][1])

    def call(given: tuple[Any, ...]) -> Callable[[], Any]:
        return lambda: compiled(*given)

    return [BenchmarkMethod(name, word, panel, call(given), error, seconds) for word, given in rows]


def benchmark(
    methods: Sequence[BenchmarkMethod], *, repeats: int, budget_seconds: float = BUDGET_SECONDS
) -> list[PrecisionRow]:
    """Time methods on one core, one sample of each in every round, and take their errors.

    Args:
        methods: what to time. A first call of each is not counted, unless it takes longer than the
            budget by itself.
        repeats: rounds.
        budget_seconds: see `BUDGET_SECONDS`.

    Returns:
        A row for each, with the median and the range of its samples. Seconds are per call, with
        the result waited for.

    Example:
        >>> import math
        >>> root = BenchmarkMethod("math", "", "", lambda: math.sqrt(2), lambda x: abs(x - 2**0.5))
        >>> [row] = benchmark([root], repeats=3)
        >>> row.method, row.error, row.seconds_low <= row.seconds
        ('math', 0.0, True)
    """
    with one_core():
        clocks = [_Clock(method, budget_seconds) for method in methods]
        for _ in range(repeats):
            for clock in clocks:
                clock.sample()
    return [clock.row() for clock in clocks]


class _Clock:
    """The samples of one method."""

    def __init__(self, method: BenchmarkMethod, budget_seconds: float) -> None:
        self.method, self.budget = method, budget_seconds
        start = time.perf_counter()
        answer = jax.block_until_ready(method.call())
        first = time.perf_counter() - start
        self.calls = max(1, math.ceil(MIN_SAMPLE_SECONDS / max(first, 1e-9)))
        self.samples = [first] if first > budget_seconds else []
        self.spent = 0.0
        self.error = method.error(answer)

    def sample(self) -> None:
        if len(self.samples) >= 3 and self.spent > self.budget:
            return
        start = time.perf_counter()
        for _ in range(self.calls):
            jax.block_until_ready(self.method.call())
        seconds = time.perf_counter() - start
        self.spent += seconds
        self.samples.append(seconds / self.calls)

    def row(self) -> PrecisionRow:
        samples = tuple(self.method.scale * one for one in self.samples)
        return PrecisionRow(
            method=self.method.method,
            setting=self.method.setting,
            panel=self.method.panel,
            error=self.error,
            seconds=statistics.median(samples),
            seconds_low=min(samples),
            seconds_high=max(samples),
            compile_seconds=self.method.compile_seconds,
            samples=samples,
        )


@contextmanager
def one_core() -> Iterator[bool]:
    """Keep every thread of the process on one core while the context lasts.

    XLA and BLAS have started their threads long before, and a thread's core is its own affair:
    each is pinned by its id. Threads and processes started inside inherit the core. BLAS computes
    with one thread: others would spin on the core of the one that works.

    Yields:
        Whether that was done; false where the system cannot do it.

    Example:
        >>> with one_core() as pinned:
        ...     cores = len(os.sched_getaffinity(0)) if pinned else 1
        >>> cores
        1
    """
    if not (hasattr(os, "sched_setaffinity") and THREADS.is_dir()):
        yield False
        return
    allowed = os.sched_getaffinity(0)
    before = {}
    for thread in _threads():
        with suppress(OSError):  # it has ended meanwhile
            before[thread] = os.sched_getaffinity(thread)
            os.sched_setaffinity(thread, {max(allowed)})
    try:
        with threadpool_limits(1, user_api="blas"):
            yield True
    finally:
        for thread in _threads():
            with suppress(OSError):
                os.sched_setaffinity(thread, before.get(thread, allowed))


def _threads() -> list[int]:
    return [int(entry.name) for entry in THREADS.iterdir()]


def find_dominating(row: PrecisionRow, rows: Iterable[PrecisionRow]) -> list[PrecisionRow]:
    """Rows of the same panel that are both faster (even in their slowest repeat) and closer.

    Example:
        >>> rows = [
        ...     PrecisionRow(name, "", "", error, time, time, time, 0.0)
        ...     for name, error, time in (("a", 1e-3, 2.0), ("b", 1e-6, 1.0))
        ... ]
        >>> [row.method for row in find_dominating(rows[0], rows)]
        ['b']
    """
    closer = (other for other in rows if other.panel == row.panel and other.error < row.error)
    return [other for other in closer if other.seconds_high < row.seconds_low]


def find_undominated(rows: Sequence[PrecisionRow], ours: str) -> tuple[list[str], bool]:
    """Whether no other method at any setting is both faster and closer than one.

    Args:
        rows: of all methods.
        ours: the method's name.

    Returns:
        A sentence for each workload with the nearest others, and whether it holds on all of them:
        the evidence of a `Claim`.

    Example:
        >>> rows = [
        ...     PrecisionRow(name, "", "sum", error, time, time, time, 0.0)
        ...     for name, error, time in (("ours", 1e-9, 1.0), ("theirs", 1e-6, 0.5))
        ... ]
        >>> find_undominated(rows, "ours")[1]
        True
    """
    evidence, beaten = [], []
    for row in (row for row in rows if row.method == ours):
        others = [other for other in rows if other.panel == row.panel and other.method != ours]
        beaten += find_dominating(row, others)
        text = f"{row.panel}: {ours}, {row.seconds:.2g} s, error {row.error:.1e}"
        near = [other for other in others if other.error <= 10 * row.error]
        for title, group in (
            ("fastest of those within ten times its error", near),
            ("fastest of all others", others),
        ):
            if group:
                best = min(group, key=lambda other: other.seconds)
                text += (
                    f"; {title} {best.method}, {best.setting}: {best.seconds / row.seconds:.2f} "
                    f"times its time, error {best.error:.1e}"
                )
        evidence.append(text)
    return evidence, not beaten


def timing(study: PrecisionStudy) -> str:
    """How the run times of a study were taken, in words."""
    once = all(row.seconds_low == row.seconds_high for row in study.rows)
    how = "of one run each" if once else "medians over repeats after a warm-up"
    return f"Run times are {how}, with the result waited for; compiling is counted apart."
