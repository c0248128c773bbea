"""Progress on a terminal, silence elsewhere."""

import io

from rich.console import Console

from designopt.progress import point_display, step_display


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


def shown_points(terminal):
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=terminal, width=80)
    with point_display(total=24, done=12, failed=1, console=console) as show:
        show(True)
        show(False)
    return stream.getvalue()


def test_points_are_counted_on_a_terminal():
    shown = shown_points(terminal=True)
    assert "14/24" in shown  # 12 of them before
    assert "2 failed" in shown
    assert "left" in shown


def test_no_point_is_counted_elsewhere():
    assert shown_points(terminal=False) == ""
