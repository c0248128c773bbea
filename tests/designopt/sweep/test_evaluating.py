"""What a worker makes of its points, here in this process."""

import dataclasses
import json
import math

import jax
import pytest

from designopt import UserError
from designopt.study.results import Metric, Target
from designopt.sweep import evaluating
from designopt.sweep.evaluating import Task, evaluate, version_of
from designopt.sweep.outcomes import failed, found, from_json, to_json
from tests.designopt.sweep.plugin import BATCHED


def task(study, *settings, width=1, **changes):
    given = {"seed": 7, "dtype": "float64", "versions": {"jax": version_of("jax")}} | changes
    return Task(study, tuple((text,) for text in settings), width, **given)


def test_every_point_has_its_metrics_or_its_reason(installed):
    good, refused, broken = evaluate(task("swept", "x=2", "x=-1", "x=0"))
    assert {one.name: one.value for one in good.metrics[:3]} == {
        "sine_mm": math.sin(2.0),
        "seed": 7,
        "bytes": 8,
    }
    assert good.device.startswith("cpu")
    assert (refused.failure, refused.final) == ("x: a length is not negative; make it larger", True)
    assert (broken.failure, broken.final) == ("ZeroDivisionError: float division by zero", False)


def test_programs_are_forgotten_between_tasks_where_there_are_many(installed, monkeypatch):
    asked = []
    monkeypatch.setattr(evaluating, "forget_programs_if_many", lambda: asked.append(True))
    evaluate(task("swept", "x=2", "x=3"))
    assert asked == [True]


def test_the_float_type_is_the_one_asked_for(installed):
    (single,) = evaluate(task("swept", "x=2", dtype="float32"))
    assert single.metrics[2].value == 4
    assert jax.numpy.zeros(()).dtype == "float64"  # as the tests have it


def test_a_batch_is_filled_and_its_filling_left_out(installed):
    outcomes = evaluate(task("batched", "x=2", "x=-1", "x=3", width=8))
    assert [bool(one.failure) for one in outcomes] == [False, True, False]
    assert outcomes[0].metrics[-1].value == 8


def test_a_batch_that_raises_is_run_point_by_point(installed):
    good, broken = evaluate(task("batched", "x=2", "x=0", width=2))
    assert good.metrics[0].value == math.sin(2.0)
    assert broken.failure.startswith("ZeroDivisionError")


@pytest.mark.parametrize("raised", [KeyboardInterrupt, SystemExit, MemoryError, UserError])
def test_whatever_a_study_raises_is_the_reason_of_its_point(installed, monkeypatch, raised):
    def broken(*_):
        raise raised

    monkeypatch.setattr(math, "sin", broken)
    for study in ("swept", "batched"):
        (outcome,) = evaluate(task(study, "x=2"))
        wanted = "no reason is given" if raised is UserError else raised.__name__
        assert (outcome.failure, outcome.final) == (wanted, raised is UserError)


def test_a_batch_that_answers_for_other_points_is_run_point_by_point(installed, monkeypatch):
    monkeypatch.setattr(
        evaluating, "load_study", lambda name: dataclasses.replace(BATCHED, batch=lambda *_: [])
    )
    (outcome,) = evaluate(task("batched", "x=2", versions={"numpy": version_of("numpy")}))
    assert outcome.metrics[0].value == 2 * math.sin(2.0) / 2


def test_other_versions_are_refused(installed):
    with pytest.raises(UserError, match=r"jax is .* the sweep was begun with 0\.0"):
        evaluate(task("swept", "x=1", versions={"python": version_of("python"), "jax": "0.0"}))


def test_outcomes_survive_their_file():
    metric = Metric("a", 0.1 + 0.2, "mm", "a sum", target=Target("=", 0.3, 1e-9))
    many = found([metric, Metric("n", 3, "", "")], 1.5, "cpu")
    assert from_json(to_json(many)) == many
    assert to_json(many)["metrics"][1]["value"].__class__ is int
    endless = found([Metric("a", math.inf, "", ""), Metric("b", -math.inf, "", "")], 0, "")
    assert from_json(json.loads(json.dumps(to_json(endless), allow_nan=False))) == endless
    lost = failed("a\n b", final=False, seconds=2.0, device="cpu")
    assert lost.failure == "a b"
    assert from_json(to_json(lost)) == lost
    assert from_json(to_json(lost._replace(final=True))).final
