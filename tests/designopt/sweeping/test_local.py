"""Processes of this machine: all points finish, whatever becomes of a worker."""

import math
import multiprocessing
from typing import Any

from designopt.sweeping.evaluating import Task
from designopt.sweeping.local import MOST_LOSSES, run_locally


def tasks(*settings):
    return [Task("swept", (one,), 1, 0, "float64", {}) for one in settings]


def workers():
    return {one for one in multiprocessing.active_children() if "Spawn" in type(one).__name__}


def test_a_lost_worker_costs_its_own_point_only(installed, tmp_path):
    once = ("fatal=1", f"marker={tmp_path / 'once'}")
    wanted = tasks(("x=1", *once), ("x=2", "fatal=2"), ("x=3",))
    before = workers()
    answers: dict[int, Any] = dict(run_locally(wanted, 2))
    assert sorted(answers) == [0, 1, 2]
    assert answers[1] is None  # lost MOST_LOSSES times
    assert MOST_LOSSES == 3
    for index in (0, 2):
        (outcome,) = answers[index]
        assert outcome.metrics[0].value == 2 * math.sin(index + 1) / (index + 1)
    assert (tmp_path / "once").is_file()
    assert workers() == before


def test_closing_ends_the_workers_at_once(installed):
    before = workers()
    answers = run_locally(tasks(("x=1",), ("x=2", "wait=1000"), ("x=3", "wait=1000")), 2)
    assert next(answers)[0] == 0
    assert len(workers() - before) == 2
    answers.close()
    assert workers() == before
