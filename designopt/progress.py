"""What a study is doing, on a terminal's standard error; silent anywhere else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn


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
    columns = (
        SpinnerColumn(finished_text="✓"),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:

        @contextmanager
        def step(description: str) -> Iterator[None]:
            task = progress.add_task(description, total=1)
            yield
            progress.update(task, completed=1)

        yield step
