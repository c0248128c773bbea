"""Verdicts on drawn fingers: what is drawn, what contradicts a verdict, and who gets advice."""

import importlib.util
import math
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from designopt.study.records import Records
from designopt.study.study import Context
from studies.finger import FingerSpec
from studies.finger.advice import Advice
from studies.finger.designing import FingerDesign
from studies.finger.verdicts import FingerVerdictsSpec
from studies.finger.verdicts import run as verdicts
from studies.models.checks import Check
from studies.models.finger_file import packaged_finger
from studies.models.linkage_design.clearances import find_free_meetings, name_of

CONTEXT = Context(0, "float64", lambda _: nullcontext())


def test_what_is_drawn_lies_within_bounds_and_covers_them():
    drawn = list(verdicts.draw(64, 3))
    numbers = {name: [one.numbers[name] for one in drawn] for name in verdicts.BOUNDS}
    for name, (low, high) in verdicts.BOUNDS.items():
        values = np.array(numbers[name])
        assert np.all((values >= low) & (values <= high)), name
        # A Sobol sequence has a point in every sixteenth of each coordinate.
        if name != "mirrors":
            parts = np.histogram(values, 16, (low, high))[0]
            assert np.all(parts >= 2), name
    assert {*numbers["mirrors"]} == {0.0, 1.0, 2.0, 3.0}
    assert [one.numbers for one in verdicts.draw(64, 3)] == [one.numbers for one in drawn]
    assert next(verdicts.draw(1, 4)).numbers != drawn[0].numbers
    for one in drawn:
        if one.spec is None:
            assert one.refusal
            continue
        body = one.spec.body
        assert body.ranges_deg == (one.numbers["pip_deg"], one.numbers["dip_deg"])
        assert body.thickness == one.numbers["thickness"]
        assert one.spec.mirrors.camera.fov_deg == one.numbers["fov_deg"]
        assert len(one.spec.mirrors.phalanges) == one.numbers["mirrors"]


@pytest.mark.parametrize(
    ("own", "other", "same"),
    [
        (0.52, 0.5199, True),
        (0.6, 0.7, False),
        (0.01, -0.2, False),
        (-0.1, -0.5, True),
        (math.inf, math.inf, True),
        (math.inf, 1.0, False),
    ],
)
def test_distances_are_the_same_or_both_overlaps(own, other, same):
    assert verdicts.same_distance(own, other) == same


@pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None, reason="needs the extra 'judge' (Mitsuba)"
)
@pytest.mark.parametrize(
    ("false", "agree"),
    [
        ({}, "yes"),
        ({"links": 0.4}, "no"),
        ({"pin": 3.1}, "no"),
        ({"assembles": False}, "no"),
        ({"optics": 0.9}, "no"),
        ({"seen": 0.9}, "no"),
    ],
)
def test_polygons_and_rays_contradict_a_false_verdict(monkeypatch, false, agree):
    """The packaged finger keeps 0.52 mm between bars, 1.4 mm at mirrors, and shows everything."""
    finger, spec = packaged_finger(), FingerVerdictsSpec(steps=7, postures=1)
    links = false.get("links", 0.52)
    checks = [Check(name_of(one), 0.5, links, "mm") for one in find_free_meetings(finger)]
    checks.append(Check("pin E inside the dorsal face", 3.2, false.get("pin", 3.22), "mm"))
    linkage = SimpleNamespace(assembles=false.get("assembles", True), checks=checks)
    worst = SimpleNamespace(coverage=[SimpleNamespace(pip_deg=90.0, dip_deg=45.0)])
    found = Mock(spec=FingerDesign, finger=finger, linkage=Mock(verdict=linkage), mirrors=Mock())
    found.mirrors.verdict = SimpleNamespace(worst=worst, worst_coverage=1.0)
    if "seen" in false:
        monkeypatch.setattr(verdicts, "coverage_of", lambda _, poses: np.full((len(poses), 3), 0.9))
    if "optics" in false:
        room = [Check("mirror", 0.0, false["optics"], "mm")] * 2
        monkeypatch.setattr(verdicts, "clearance_checks", lambda *_: room)
    judged = verdicts.judge(FingerSpec(), found, spec, 0)
    assert judged["agree"] == agree
    assert judged["polygons_mm"] == pytest.approx(0.52, abs=0.01)
    assert judged["optics_polygons_mm"] >= 1.0
    assert judged["links_mm"] == pytest.approx(min(links, false.get("pin", 3.22) - 2.7))


def test_those_that_miss_least_get_advice(monkeypatch):
    misses = {0: ["a", "b"], 1: [], 2: ["a"], 3: ["a", "b", "c"], 4: ["b"]}
    advised = []

    class Drawing:
        def __init__(self, context):
            assert context is CONTEXT

        def finger(self, spec):
            return spec

    def draw(count, seed):
        del seed
        for number in range(count):
            numbers = dict.fromkeys(verdicts.BOUNDS, 1.0) | {"mirrors": float(number % 2)}
            spec: Any = None if number == 5 else number
            yield verdicts.Drawn(numbers, spec, "refused")

    def advise(spec, designer):
        assert isinstance(designer, Drawing)
        advised.append(spec)
        return [Advice("body.thickness", "mm", 22.0, 24.5, 23.25, "a")] if spec == 4 else []

    def requirements(spec, found):
        assert spec == found
        lines = Records()
        for name in "abc":
            lines.add(requirement=name, met="no" if name in misses[spec] else "yes")
        return lines

    monkeypatch.setattr(verdicts, "Designer", Drawing)
    monkeypatch.setattr(verdicts, "draw", draw)
    monkeypatch.setattr(verdicts, "advise", advise)
    monkeypatch.setattr(verdicts, "requirements", requirements)
    monkeypatch.setattr(verdicts, "require_mitsuba", lambda _: None)
    monkeypatch.setattr(
        verdicts,
        "judge",
        lambda spec, *_: verdicts.nothing_judged() | {"agree": "no" if spec == 3 else "yes"},
    )
    results = verdicts.run(FingerVerdictsSpec(fingers=6, advised=2), CONTEXT)
    assert advised == [2, 4]
    metrics = {one.name: one.value for one in results.metrics}
    assert metrics == {"contradicted": 1, "infeasible": 5, "helped": 1}
    tables = {one.name: one.rows for one in results.tables}
    assert [row[:2] for row in tables["changes"]] == [(4, "body.thickness")]
    # Those of as many mirrors together.
    assert [row[0] for row in tables["fingers"]] == [0, 2, 4, 1, 3, 5]
    assert [row[-1] for row in tables["fingers"]] == ["yes"] * 4 + ["no", "yes"]
