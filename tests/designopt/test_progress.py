"""Progress: a display on a terminal, lines of the log elsewhere, and the time left."""

import io
import logging
import re
from functools import partial

import pytest
from rich.console import Console

from designopt import progress
from designopt.progress import StepDisplay, format_duration, point_display, step_display
from designopt.study.study import Context


def shown(display, use, terminal: bool) -> str:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=terminal, width=80)
    with display(console=console) as found:
        use(found)
    return stream.getvalue()


def fit(step):
    with step("Fitting"):
        pass


def render(step):
    is_done = step.count(12)
    for _ in range(9):
        is_done()


def point(show):
    show(True)
    show(False)


POINTS = partial(point_display, total=24, done=12, failed=1)


@pytest.fixture
def clock(monkeypatch):
    """A clock that goes on by four seconds each time that it is read."""
    times = iter(range(0, 4000, 4))
    monkeypatch.setattr(progress.time, "perf_counter", lambda: float(next(times)))


@pytest.mark.parametrize(
    ("display", "use", "words"),
    [
        (step_display, fit, ["Fitting"]),
        (step_display, render, ["9 of 12 done", "left"]),
        (POINTS, point, ["14 of 24 points done, 2 failed, about", "left"]),
    ],
)
def test_a_terminal_has_a_display_and_other_streams_nothing(display, use, words):
    written = shown(display, use, terminal=True)
    assert all(word in written for word in words)
    assert shown(display, use, terminal=False) == ""


@pytest.mark.parametrize("level", [logging.INFO, logging.ERROR])
def test_a_terminal_has_no_display_where_steps_are_logged_or_only_errors_wanted(caplog, level):
    caplog.set_level(level, logger="designopt.progress")
    assert shown(step_display, fit, terminal=True) == ""
    assert [record.message for record in caplog.records] == ["Fitting: 0.0 s"][: level < 30]


@pytest.mark.usefixtures("clock")
def test_a_step_is_logged_with_its_seconds(caplog):
    caplog.set_level(logging.DEBUG, logger="designopt.progress")
    fit(StepDisplay())
    logged = [(record.levelname, record.message) for record in caplog.records]
    assert logged == [("DEBUG", "Fitting ..."), ("INFO", "Fitting: 4.0 s")]


def test_a_step_that_ends_in_an_error_is_not_logged_as_done(caplog):
    caplog.set_level(logging.INFO, logger="designopt.progress")
    with pytest.raises(ZeroDivisionError), StepDisplay()("Fitting"):
        raise ZeroDivisionError
    assert caplog.records == []


@pytest.mark.usefixtures("clock")
def test_the_time_left_is_the_mean_time_of_those_that_are_done(caplog):
    """Of twelve, each takes eight seconds by this clock, which is read twice for each."""
    caplog.set_level(logging.INFO, logger="designopt.progress")
    render(StepDisplay())
    lines = [record.message for record in caplog.records]
    assert lines[0] == "2 of 12 done, about 1:00 min left"  # (4 + 8) s for two: 6 s each
    assert all(re.fullmatch(r"\d of 12 done, about [\d:.]+ (s|min) left", line) for line in lines)
    assert len(lines) == 4  # not more often than every ten seconds


def test_each_item_of_a_study_is_a_step_and_is_counted():
    steps, done = [], []

    def step(description):
        steps.append(description)
        return StepDisplay()(description)

    context = Context(0, "float64", step, lambda total: lambda: done.append(total))
    assert [*context.each([3, 4], lambda size: f"{size} px")] == [3, 4]
    assert (steps, done) == (["3 px", "4 px"], [2, 2])


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.04, "0.0 s"), (59.94, "59.9 s"), (59.96, "1:00 min"), (185, "3:05 min"), (4800, "1:20 h")],
)
def test_durations(seconds, text):
    assert format_duration(seconds) == text
