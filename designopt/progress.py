"""What a command is doing: on a terminal a display on standard error, elsewhere lines of a log.

The lines are INFO records of the logger ``designopt.progress``. The command line shows them where
standard error is no terminal, and with ``--verbose``; a script shows them by
``logging.basicConfig(level="INFO")``.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich import progress as bars
    from rich.console import Console

LOG = logging.getLogger(__name__)

LOG_EVERY = 10.0
"""Least seconds between two lines on how many are done: there may be thousands."""


class StepDisplay:
    """``step`` and ``count`` of a `Context`: ``with display("Fitting"):`` shows it and its time.

    Args:
        bar: a started display on a terminal; without one there are only log records.
    """

    def __init__(self, bar: bars.Progress | None = None) -> None:
        self._bar = bar

    @contextmanager
    def __call__(self, description: str) -> Iterator[None]:
        """A step: it is shown while it lasts, and with its run time when it has ended."""
        start = time.perf_counter()
        LOG.debug("%s ...", description)
        task = None if self._bar is None else self._bar.add_task(description, total=1)
        yield
        LOG.info("%s: %s", description, format_duration(time.perf_counter() - start))
        if self._bar is not None and task is not None:
            self._bar.update(task, completed=1)

    def count(self, total: int) -> Callable[[], None]:
        """Show how many of so many are done, and the time left.

        Args:
            total: how many there are.

        Returns:
            What is called when one more is done.
        """
        # Of a single one the step itself shows as much.
        return Count(self._bar, "", total).advance if total > 1 else lambda: None


class Count:
    """How many are done of a known number, and the time left by the mean time of those so far.

    Args:
        bar: where it is shown on a terminal.
        what: is counted, in the plural.
        total: how many there are.
        done: how many were done before.
    """

    def __init__(self, bar: bars.Progress | None, what: str, total: int, done: int = 0) -> None:
        self._bar, self._what, self._total = bar, what, total
        self._before = self._done = done
        self._start = self._logged = time.perf_counter()
        self._lock = threading.Lock()  # steps may run side by side
        self._task = None if bar is None else bar.add_task(self._text(""), total=1)

    def advance(self, note: str = "") -> None:
        """Show that one more is done.

        Args:
            note: about all of them, such as how many have failed.
        """
        with self._lock:
            self._done += 1
            text, now = self._text(note), time.perf_counter()
            if now - self._logged >= LOG_EVERY:
                self._logged = now
                LOG.info("%s", text)
            if self._bar is not None and self._task is not None:
                is_last = self._done >= self._total
                self._bar.update(self._task, description=text, completed=int(is_last))

    def _text(self, note: str) -> str:
        parts = [f"{self._done} of {self._total} {self._what}".rstrip() + " done"]
        if note:
            parts.append(note)
        new = self._done - self._before
        if new > 0 and self._done < self._total:
            mean = (time.perf_counter() - self._start) / new
            parts.append(f"about {format_duration(mean * (self._total - self._done))} left")
        return ", ".join(parts)


@contextmanager
def step_display(console: Console | None = None) -> Iterator[StepDisplay]:
    """Steps, shown while the context lasts.

    Args:
        console: where to show them; standard error by default. Where it is no terminal, or steps
            are logged, nothing but the log is written.
    """
    with _bar(console) as bar:
        yield StepDisplay(bar)


@contextmanager
def point_display(
    total: int, done: int, failed: int, console: Console | None = None
) -> Iterator[Callable[[bool], None]]:
    """The points of a sweep, with the time left: call what is yielded for each point.

    Args:
        total: points of the sweep.
        done: those that were finished before.
        failed: those of them that failed.
        console: as for `step_display`.

    Yields:
        A function that is called once per point with whether it failed.
    """
    with _bar(console) as bar:
        count = Count(bar, "points", total, done)

        def show(has_failed: bool) -> None:
            nonlocal failed
            failed += has_failed
            count.advance(f"{failed} failed")

        yield show


def format_duration(seconds: float) -> str:
    """A time for people: ``4.2 s``, ``3:05 min`` or ``1:20 h``."""
    if seconds < 59.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes}:{rest:02} min"
    return f"{minutes // 60}:{minutes % 60:02} h"


@contextmanager
def _bar(console: Console | None) -> Iterator[bars.Progress | None]:
    """A display on a terminal, unless steps are logged, or nothing but errors is to be shown."""
    from rich import progress as bars
    from rich.console import Console

    console = console or Console(stderr=True)
    is_logged = LOG.isEnabledFor(logging.INFO)
    if not console.is_terminal or is_logged or not LOG.isEnabledFor(logging.WARNING):
        yield None
        return
    spinner = bars.SpinnerColumn(finished_text="✓")
    columns = (spinner, "{task.description}", bars.TimeElapsedColumn())
    # What is printed meanwhile is for standard output, wherever that goes.
    with bars.Progress(*columns, console=console, redirect_stdout=False) as bar:
        yield bar
