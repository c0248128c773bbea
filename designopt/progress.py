"""What a study is doing, on a terminal's standard error; silent anywhere else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from rich import progress as bars
from rich.console import Console

REMEMBERED = 3600.0
"""Seconds over which the speed is measured, for the time left: points may take minutes."""


@contextmanager
def step_display(
    console: Console | None = None,
) -> Iterator[Callable[[str], AbstractContextManager[None]]]:
    """``step`` for a `Context`: each ``with step("Fitting"):`` is a line with its run time.

    Args:
        console: where to show it; standard error by default. Nothing is shown, not even at the
            end, where it is not a terminal.
    """
    console = console or Console(stderr=True)
    spinner = bars.SpinnerColumn(finished_text="✓")
    columns = (spinner, "{task.description}", bars.TimeElapsedColumn())
    with bars.Progress(*columns, console=console, disable=not console.is_terminal) as progress:

        @contextmanager
        def step(description: str) -> Iterator[None]:
            task = progress.add_task(description, total=1)
            yield
            progress.update(task, completed=1)

        yield step


@contextmanager
def point_display(
    total: int, done: int, failed: int, console: Console | None = None
) -> Iterator[Callable[[bool], None]]:
    """A bar over the points of a sweep, with the time left: call what is yielded for each point.

    Args:
        total: points of the sweep.
        done: those that were finished before.
        failed: those of them that failed.
        console: where to show it; standard error by default. Nothing is shown where it is not a
            terminal.

    Yields:
        A function that is called once per point with whether it failed.
    """
    console = console or Console(stderr=True)
    columns = (
        bars.MofNCompleteColumn(),
        "points",
        bars.BarColumn(),
        "{task.fields[failed]} failed",
        bars.TimeRemainingColumn(),
        "left",
    )
    with bars.Progress(
        *columns,
        console=console,
        disable=not console.is_terminal,
        speed_estimate_period=REMEMBERED,
    ) as progress:
        task = progress.add_task("", total=total, completed=done, failed=failed)

        def show(has_failed: bool) -> None:
            nonlocal failed
            failed += has_failed
            progress.update(task, advance=1, failed=failed)

        yield show
