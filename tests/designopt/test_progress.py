"""Progress on a terminal, silence elsewhere."""

import io
from functools import partial

import pytest
from rich.console import Console

from designopt.progress import point_display, step_display


def shown(display, use, terminal: bool) -> str:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=terminal, width=80)
    with display(console=console) as found:
        use(found)
    return stream.getvalue()


def fit(step):
    with step("Fitting"):
        pass


def count(show):
    show(True)
    show(False)


POINTS = partial(point_display, total=24, done=12, failed=1)


@pytest.mark.parametrize(
    ("display", "use", "words"),
    [(step_display, fit, ["Fitting"]), (POINTS, count, ["14/24", "2 failed", "left"])],
)
def test_progress_is_shown_on_a_terminal_and_nowhere_else(display, use, words):
    written = shown(display, use, terminal=True)
    assert all(word in written for word in words)
    assert shown(display, use, terminal=False) == ""
