"""The study ``finger``: its lines, and the whole of it."""

import re
from contextlib import nullcontext
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from designopt.cli import run as command
from designopt.optimize import Optima, Starts
from designopt.study.runner import run_study
from designopt.study.study import Context
from studies.finger import designing
from studies.finger.advice import value_of, with_value
from studies.finger.spec import FingerSpec
from studies.models import Finger
from studies.models.finger import links_of, pins_of
from studies.models.linkage_design.analysis import LinkageDesign, layers_fit
from studies.models.linkage_design.judging import judged
from studies.models.linkage_design.searching import Round, Search, over
from studies.models.linkage_design.spec import FingerLinkageSpec
from studies.models.linkage_design.tolerance import least_angles
from studies.models.mirror_design import judging, yields
from studies.models.mirror_design.design import MirrorDesign, Trial
from studies.models.mirror_design.judging import Verdict
from studies.models.mirror_design.judging import judged as judge_mirrors
from studies.models.mirror_design.spec import MirrorSpec
from studies.models.mirror_design.yields import Yield
from tests.studies.fingers import finger_of, seeing_finger
from tests.studies.stopped import stopped_at


def test_degrees_of_freedom_by_kutzbach():
    """Paper B: seven links and eight revolute joints leave two."""
    assert designing.degrees_of_freedom(finger_of()) == 2


def unsearched_linkage(spec: FingerLinkageSpec, seed: int, near: object) -> LinkageDesign:
    """Design B in the body of the settings, judged in place of what a search would find."""
    finger, flexion = seeing_finger(thickness=spec.body.thickness), np.array([0.0, 1.5])
    pins = pins_of(finger)
    first = Round(over(finger, spec, flexion, flexion), Optima((stopped_at(pins, 0.4),), 0, 0))
    found = Search(finger, Starts(pins, 0.0, 0.0), (first,), ())
    verdict = judged(finger, spec.limits, spec.motor)
    width = layers_fit(spec.limits, links_of(finger))
    return LinkageDesign(finger, found, verdict, width, least_angles(finger, 0.1, spec.draws, seed))


def given_mirrors(finger: Finger, _: MirrorSpec, context: Context, starts: None) -> MirrorDesign:
    del context, starts
    finger = seeing_finger(thickness=float(finger.body.thickness))
    return MirrorDesign(finger, [], [judge_mirrors(finger)], [], 0)


FIRST, OTHERS, ALL = "first", "others", 4
"""Designs, by what they began with, and how many starts there are."""


@pytest.mark.parametrize(
    ("unmet", "coverages", "tried", "taken"),
    [
        (([], []), (1.0, 1.0), 1, FIRST),
        ((["membrane"], []), (1.0, 1.0), 1, FIRST),
        ((["yield", "px/mm"], ["yield"]), (1.0, 0.9), ALL, OTHERS),
        ((["yield"], ["coverage", "px/mm"]), (1.0, 0.9), ALL, FIRST),
        ((["coverage"], ["coverage"]), (0.8, 0.9), ALL, OTHERS),
    ],
)
def test_the_other_starts_are_tried_where_the_first_is_not_enough(
    monkeypatch, unmet, coverages, tried, taken
):
    begun, share = [], yields.Yield(0.5, 0.4, 0.6, 10, np.zeros((1, 3)))
    by_start: dict[str, Any] = {
        FIRST: (unmet[0], coverages[0]),
        OTHERS: (unmet[1], coverages[1]),
    }
    names: dict[int, str] = {}  # by a verdict's identity

    def search(finger, spec, context, starts):
        del spec, context
        begun.extend(starts)
        name = FIRST if len(starts) == 1 else OTHERS
        verdict = Mock(spec=Verdict)
        verdict.quality.return_value = (by_start[name][1], 2.5)
        names[id(verdict)] = name
        return MirrorDesign(finger, [], [verdict], [], 0)

    def missed(spec, found, given):
        assert given is share
        return by_start[names[id(found.verdict)]][0]

    monkeypatch.setattr(designing, "design_mirrors", search)
    monkeypatch.setattr(designing, "missed_by_mirrors", missed)
    monkeypatch.setattr(designing, "monte_carlo", lambda *_, **__: share)
    context = Context(0, "float64", lambda _: nullcontext())
    found, _ = designing.Designer(context)._designed(FingerSpec())
    assert names[id(found.verdict)] == taken
    assert len(begun) == tried


@pytest.mark.parametrize(
    ("setting", "linkage", "now", "then", "helps"),
    [
        # The linkage alone misses something, and the setting is of the mirrors, or not.
        ("mirrors.room.mount", ["angle"], ([], 1.0), ([], 1.0), False),
        ("linkage.limits.width", ["angle"], ([], 1.0), ([], 1.0), True),
        # The grasp alone, which the mirrors do not concern.
        ("mirrors.room.mount", [], ([], 1.0), ([], 1.0), False),
        ("linkage.limits.width", [], ([], 1.0), ([], 1.0), True),
        ("spring.preload", [], ([], 1.0), ([], 1.0), True),
        # The mirrors, and the setting is of the linkage alone.
        ("linkage.limits.width", [], (["coverage"], 0.9), ([], 1.0), False),
        # They come nearer, or do not.
        ("mirrors.room.mount", [], (["coverage"], 0.9), (["coverage"], 0.951), True),
        ("mirrors.room.mount", [], (["coverage"], 0.9), (["coverage"], 0.949), False),
        ("mirrors.room.mount", [], (["coverage", "yield"], 0.9), (["coverage"], 0.8), True),
        ("mirrors.room.mount", [], (["blur"], 1.0), (["blur"], 1.0), True),
        # Both, and the setting is of both.
        ("body.thickness", ["angle"], (["coverage"], 0.9), (["coverage"], 0.951), True),
        ("body.thickness", ["angle"], (["coverage"], 0.9), (["coverage"], 0.949), False),
        # How long membranes are is the body's.
        ("mirrors.room.mount", [], (["membrane"], 1.0), (["membrane"], 1.0), False),
        ("body.distal", [], (["membrane"], 1.0), ([], 1.0), True),
        # Those that were found meet what is asked with the other setting.
        ("mirrors.floor", [], (["px/mm"], 1.0), (["px/mm", "coverage"], 0.9), True),
    ],
)
def test_a_setting_could_help_that_brings_nearer_all_that_miss_something(
    monkeypatch, setting, linkage, now, then, helps
):
    spec = FingerSpec()
    other = with_value(spec, setting, value_of(spec, setting) + (-1 if "floor" in setting else 1))
    assert other is not None
    unmet = {}

    def searched(spec, starts):
        del spec
        name = "near" if starts == ["found"] else "found"
        missed, coverage = {"found": now, "near": then}[name]
        trial = Mock(spec=Trial, placement=name)
        verdict = Mock(spec=Verdict, worst_coverage=coverage)
        verdict.quality.return_value = (coverage, 2.5)
        unmet[verdict] = missed
        return MirrorDesign(finger_of(), [trial], [verdict], [], 0), Mock(spec=Yield, value=0.0)

    def missed(spec, mirrors, share):
        del share
        return [one for one in unmet[mirrors.verdict] if one != "px/mm" or spec.mirrors.floor > 2]

    designer = designing.Designer(Context(0, "float64", lambda _: nullcontext()))
    monkeypatch.setattr(designer, "linkage", lambda _: Mock(spec=LinkageDesign, finger=finger_of()))
    monkeypatch.setattr(designer, "_searched", searched)
    monkeypatch.setattr(designing, "missed_by_linkage", lambda *_: linkage)
    monkeypatch.setattr(designing, "missed_by_mirrors", missed)
    assert designer.could_help(spec, other) == helps
    # What was searched for it is not searched again.
    monkeypatch.setattr(designer, "_searched", None)
    assert designer.could_help(spec, other) == helps


@pytest.mark.slow
def test_a_finger_that_is_too_thin_names_what_gave_way(monkeypatch):
    """Nothing is searched: `test_main_job` has the whole of the study, and every degree."""
    for module in (judging, yields):
        monkeypatch.setattr(module, "whole_degrees", lambda end: np.arange(0.0, end + 1, 10.0))
    monkeypatch.setattr(designing, "design_linkage", unsearched_linkage)
    monkeypatch.setattr(designing, "design_mirrors", given_mirrors)
    limits = {"transmission_deg": 48, "clearance": 2.5}
    settings = {
        "body": {"thickness": 23},
        "linkage": {"limits": limits, "draws": 64},
        "yield_draws": 100,
        "advice": False,
        "spring": {"diameters": [40]},
    }
    results = run_study("finger", settings)
    metrics = {metric.name: metric for metric in results.metrics}
    lines = next(table for table in results.tables if table.name == "table_3_1").rows
    missed = [str(row[0]) for row in lines if row[-1] == "no"]
    assert metrics["requirements_missed"].value == len(missed)
    assert metrics["requirements_missed"].met is False
    assert metrics["min_transmission_angle_deg"].value < 48
    assert {"transmission angles", "links inside the phalanges, apart, away from lock-up"} <= {
        *missed
    }
    assert all(name in results.findings[0] for name in missed)
    assert not any("k₂ = -" in line for line in results.findings)


@pytest.mark.parametrize(
    "name",
    [
        "finger",
        "finger-linkage",
        "finger-mirrors",
        "finger-grasp",
        "object-size",
        "surface-profile",
    ],
)
def test_fewer_digits_are_refused_at_once(tmp_path, capsys, name):
    assert command(["run", name, "--dtype", "float32", "--out", str(tmp_path / "out")]) == 2
    assert "needs float64; leave --dtype out" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_mirrors_in_the_walls_are_refused(tmp_path, capsys):
    asked = ["run", "finger", "--set", "mirrors.room.clearance=1", "--out", str(tmp_path / "out")]
    assert command(asked) == 2
    words = r"mirrors\.room\.clearance \(1 mm\) puts mirrors into the walls .*; make it 1\.2 or"
    assert re.search(words, capsys.readouterr().err)
    # Without mirrors there is nothing to keep clear of walls.
    FingerSpec.model_validate({"mirrors": {"room": {"clearance": 1.0}, "phalanges": []}})
