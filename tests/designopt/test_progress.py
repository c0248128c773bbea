"""Progress on a terminal, silence elsewhere."""

import io

from rich.console import Console

from designopt.progress import step_display


def shown(terminal: bool) -> str:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=terminal, width=80)
    with step_display(console) as step, step("Fitting"):
        pass
    return stream.getvalue()


def test_steps_are_shown_on_a_terminal():
    assert "Fitting" in shown(terminal=True)


def test_nothing_is_written_elsewhere():
    assert shown(terminal=False) == ""
