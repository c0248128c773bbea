"""Processes of this machine: all points finish, whatever becomes of a worker."""

import math
import multiprocessing
from multiprocessing.context import SpawnProcess
from typing import Any

import pytest

from designopt import UserError
from designopt.compilation_cache import VARIABLE
from designopt.sweep.evaluating import Task
from designopt.sweep.workers import run_locally


def tasks(*settings):
    return [Task("swept", (one,), 1, 0, "float64", {}) for one in settings]


def workers():
    return {one for one in multiprocessing.active_children() if "Spawn" in type(one).__name__}


def test_a_lost_worker_costs_its_own_point_only(installed, monkeypatch, tmp_path):
    """Workers keep what they compile for each other."""
    monkeypatch.setattr("designopt.sweep.workers.MOST_LOSSES", 2)
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setenv(VARIABLE, str(tmp_path / "programs"))
    once = ("fatal=1", f"marker={tmp_path / 'once'}")
    wanted = tasks(("x=1", *once), ("x=2", "fatal=2"), ("x=3",))
    before = workers()
    answers: dict[int, Any] = dict(run_locally(wanted, 2))
    assert sorted(answers) == [0, 1, 2]
    assert answers[1] is None  # lost twice
    for index in (0, 2):
        (outcome,) = answers[index]
        assert outcome.metrics[0].value == 2 * math.sin(index + 1) / (index + 1)
    assert (tmp_path / "once").is_file()
    assert list((tmp_path / "programs").iterdir())
    assert workers() == before


def test_an_interrupt_while_a_worker_starts_leaves_none_behind(installed, monkeypatch):
    start = SpawnProcess.start

    def interrupted(process):
        start(process)
        raise KeyboardInterrupt

    monkeypatch.setattr(SpawnProcess, "start", interrupted)
    before = workers()
    with pytest.raises(KeyboardInterrupt):
        next(run_locally(tasks(("x=1", "wait=1000")), 1))
    assert workers() == before


def test_a_process_that_cannot_be_started_is_told(installed, monkeypatch):
    def refused(process):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(SpawnProcess, "start", refused)
    with pytest.raises(UserError, match=r"--workers: .*temporarily unavailable.*ask for fewer"):
        next(run_locally(tasks(("x=1",)), 1))


def test_what_a_worker_does_not_find_is_told(installed):
    strange = Task("swept", (("x=1",),), 1, 0, "float64", {"jax": "0.0"})
    with pytest.raises(UserError, match=r"jax is .* the sweep was begun with 0\.0"):
        next(run_locally([strange], 1))


def test_closing_ends_the_workers_at_once(installed):
    before = workers()
    answers = run_locally(tasks(("x=1",), ("x=2", "wait=1000"), ("x=3", "wait=1000")), 2)
    assert next(answers)[0] == 0
    assert len(workers() - before) == 2
    answers.close()
    assert workers() == before
