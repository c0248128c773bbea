"""Verdicts on drawn fingers: what is drawn, what contradicts a verdict, and who gets advice."""

import functools
import importlib.util
import math
import tempfile
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from designopt.study.records import Records
from designopt.study.study import Context
from studies.finger.advice import Advice
from studies.finger.designing import FingerDesign
from studies.finger.spec import FingerSpec
from studies.finger.verdicts import FingerVerdictsSpec
from studies.finger.verdicts import run as verdicts
from studies.models.finger import Finger, pins_of
from studies.models.finger_file import packaged_finger, write_finger
from studies.models.linkage_design.judging import STEP_DEG
from studies.models.linkage_design.judging import judged as judged_linkage
from studies.models.linkage_design.problem import grids
from studies.models.linkage_design.spec import LimitsSpec, MotorSpec
from studies.models.mirror_design.clearances import clearance_checks
from studies.oracles.clearances import PolygonClearances, polygon_clearances

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
    ],
)
def test_distances_are_the_same_or_both_overlaps(own, other, same):
    assert verdicts.same_distance(own, other) == same


@pytest.mark.parametrize(("own", "side"), [(0.4, False), (0.6, True)])
def test_a_bound_may_be_less_but_not_short_of_what_is_asked(own, side):
    assert verdicts.no_more(own, 0.7)
    assert not verdicts.no_more(0.7, own)
    assert verdicts.same_side(own, 0.7, 0.5) == side
    # But for rounding.
    assert verdicts.same_side(0.4999, 0.5001, 0.5)
    assert verdicts.no_more(0.5001, 0.5)


@functools.cache
def measured(*, stretched: bool = False) -> tuple[Finger, Any, PolygonClearances]:
    """The packaged finger, its linkage judged, and polygons; or one that is straight in F-E-D."""
    finger = packaged_finger()
    pins = pins_of(finger)
    if stretched:
        middle = (np.asarray(pins.F) + np.asarray(pins.D)) / 2
        finger = finger.with_pins(replace(pins, E=middle + np.array([0.0, 0.5])))
    pip, dip = (np.rad2deg(angles) for angles in grids(finger.body, STEP_DEG))
    with tempfile.TemporaryDirectory() as folder:
        write_finger(finger, path := Path(folder) / "finger.toml")
        polygons = polygon_clearances(path, degrees=(pip, dip))
    return finger, judged_linkage(finger, LimitsSpec(), MotorSpec()), polygons


def designed(finger: Finger, linkage: Any = None, coverage: float = 1.0) -> Any:
    """A design with the verdicts that are compared."""
    worst = SimpleNamespace(coverage=[SimpleNamespace(pip_deg=90.0, dip_deg=45.0)])
    found = Mock(spec=FingerDesign, finger=finger, linkage=Mock(verdict=linkage), mirrors=Mock())
    found.mirrors.verdict = SimpleNamespace(worst=worst, worst_coverage=coverage)
    return found


def with_lines(verdict: Any, changed: dict[str, float]) -> Any:
    """The verdict with other numbers in some lines."""
    lines = [replace(one, achieved=changed.get(one.name, one.achieved)) for one in verdict.checks]
    return SimpleNamespace(assembles=verdict.assembles, checks=lines)


LEAST = 0.515012
"""What the bars of the packaged finger keep, by polygons, mm."""


@pytest.mark.parametrize(
    ("changed", "agree"),
    [
        ({}, True),
        # Neither of these two is the least.
        ({"rod from the coupler": 1.5}, False),
        ({"plate from the palmar face of the distal phalanx": 8.1}, False),
        ({"pin F inside the palmar face": 3.725}, True),
        ({"pin F inside the palmar face": 3.71}, True),
        ({"pin F inside the palmar face": 3.69}, False),
    ],
)
def test_polygons_contradict_a_false_verdict_on_bars(changed, agree):
    """The packaged finger keeps 0.515 mm, pin E from the back; F and G are 3.72 mm from a face."""
    finger, verdict, polygons = measured()
    found = designed(finger, with_lines(verdict, changed))
    compared = verdicts.compare_bars(FingerSpec(), found, polygons)
    assert compared.agree == agree
    assert compared.other == pytest.approx(LEAST, abs=1e-6)
    least = min(LEAST, changed.get("pin F inside the palmar face", 3.72) - 3.2)
    assert compared.own == pytest.approx(least, abs=1e-6)


def test_no_pin_is_farther_from_all_faces_than_polygons_find():
    finger, verdict, polygons = measured()
    edges = {one.name: 4.0 for one in verdict.checks if verdicts.INSIDE in one.name}
    found = designed(finger, with_lines(verdict, edges))
    assert not verdicts.compare_bars(FingerSpec(), found, polygons).agree


def test_polygons_contradict_postures_that_do_not_assemble():
    finger, verdict, polygons = measured()
    never = SimpleNamespace(assembles=False, checks=verdict.checks)
    compared = verdicts.compare_bars(FingerSpec(), designed(finger, never), polygons)
    assert not compared.agree
    apart, other_verdict, other = measured(stretched=True)
    assert not other_verdict.assembles
    compared = verdicts.compare_bars(FingerSpec(), designed(apart, other_verdict), other)
    assert compared.agree
    assert math.isnan(compared.own)
    assert math.isnan(compared.other)
    always = SimpleNamespace(assembles=True, checks=verdict.checks)
    assert not verdicts.compare_bars(FingerSpec(), designed(apart, always), other).agree


@pytest.mark.parametrize(
    ("changed", "agree"),
    [
        ({}, True),
        ({"distal mirror from the camera": 3.9}, False),
        ({"distal mirror from the proximal mirror": 9.0}, False),
        ({"distal mirror inside the dorsal face": 0.9}, False),
        ({"camera inside the wall of the back": 0.01}, False),
    ],
)
def test_polygons_contradict_a_false_verdict_on_mirrors(monkeypatch, changed, agree):
    finger, verdict, polygons = measured()
    found = designed(finger, verdict)
    lines = with_lines(
        SimpleNamespace(assembles=True, checks=clearance_checks(finger, 1.0)), changed
    )
    names = {one.name for one in lines.checks}
    monkeypatch.setattr(verdicts, "clearance_checks", lambda *_: lines.checks)
    compared = verdicts.compare_mirrors(FingerSpec(), found, polygons)
    assert names.issuperset(changed)
    assert compared.agree == agree
    assert compared.other >= 1.0


def test_without_mirrors_only_the_camera_is_compared():
    finger, verdict, polygons = measured()
    found = designed(replace(finger, mirrors=()), verdict)
    compared = verdicts.compare_mirrors(FingerSpec(), found, polygons)
    assert compared.agree
    assert math.isnan(compared.own)
    assert math.isnan(compared.other)


@pytest.mark.parametrize(
    ("own", "library", "rays", "agree"),
    [
        (1.0, 1.0, 0.9999, True),
        (0.7, 0.7, 0.7, True),
        (1.0, 0.9, 0.9, False),
        (1.0, 1.0, 0.9, False),
        (0.9, 0.95, 0.9, False),
    ],
)
def test_rays_contradict_a_false_verdict_on_what_is_seen(monkeypatch, own, library, rays, agree):
    monkeypatch.setattr(verdicts, "coverage_of", lambda _, poses: np.full((len(poses), 3), library))
    found = designed(packaged_finger(), coverage=own)
    seen = np.full((4, 3), library)
    seen[2] = rays
    compared = verdicts.compare_coverage(found, np.zeros((4, 2)), seen)
    assert (compared.agree, compared.own, compared.other) == (agree, own, rays)


@pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None, reason="needs the extra 'judge' (Mitsuba)"
)
def test_a_finger_is_judged_from_its_file():
    finger, verdict, _ = measured()
    found = designed(finger, verdict)
    both = verdicts.judge(FingerSpec(), found, FingerVerdictsSpec(postures=1), 0)
    assert [one.agree for one in both] == [True] * 3
    assert both[0].own == pytest.approx(LEAST, abs=1e-6)
    assert both[2].other == pytest.approx(1.0, abs=1e-4)


def test_those_that_miss_least_get_advice(monkeypatch):
    misses = {0: ["a", "b"], 1: [], 2: ["a"], 3: ["a", "b", "c"], 4: ["b"]}
    advised = []

    class Drawing:
        def __init__(self, context):
            assert context is CONTEXT

        def finger(self, spec):
            return spec

        def with_own_linkages(self):
            return self

    def draw(count, seed):
        del seed
        for number in range(count):
            numbers = dict.fromkeys(verdicts.BOUNDS, 1.0) | {"mirrors": float(number % 2)}
            spec: Any = None if number == 5 else number
            yield verdicts.Drawn(numbers, spec, "refused")

    def advise(spec, designer):
        assert isinstance(designer, Drawing)
        advised.append(spec)
        thickness = Advice("body.thickness", "mm", 22.0, 24.5, 23.25, "a")
        mirror = Advice(
            "mirrors.phalanges", "", ["distal"], ["distal", "proximal"], ["distal"], "b"
        )
        return [thickness, mirror] if spec == 4 else []

    def requirements(spec, found):
        assert spec == found
        lines = Records()
        for name in "abc":
            lines.add(requirement=name, met="no" if name in misses[spec] else "yes")
        return lines

    monkeypatch.setattr(verdicts, "Designer", Drawing)
    monkeypatch.setattr(verdicts, "draw", draw)
    monkeypatch.setattr(verdicts, "advise", advise)
    monkeypatch.setattr(verdicts, "with_value", lambda spec, *change: (spec, *change))
    monkeypatch.setattr(verdicts, "requirements", requirements)
    monkeypatch.setattr(verdicts, "require_mitsuba", lambda _: None)
    forgotten = []
    monkeypatch.setattr(verdicts, "forget_programs_if_many", lambda: forgotten.append(True))
    monkeypatch.setattr(
        verdicts,
        "judge",
        lambda spec, *_: (
            verdicts.NOTHING._replace(agree=spec not in (3, (4, "body.thickness", 24.5))),
            verdicts.NOTHING,
            verdicts.NOTHING,
        ),
    )
    results = verdicts.run(FingerVerdictsSpec(fingers=6, advised=2), CONTEXT)
    assert advised == [2, 4]
    assert len(forgotten) == 5
    metrics = {one.name: one.value for one in results.metrics}
    assert metrics == {"contradicted": 2, "infeasible": 5, "helped": 1}
    tables = {one.name: one.rows for one in results.tables}
    assert [(*row[:2], row[-1]) for row in tables["changes"]] == [
        (4, "body.thickness", "no"),
        (4, "mirrors.phalanges", "yes"),
    ]
    # Those of as many mirrors together.
    assert [row[0] for row in tables["fingers"]] == [0, 2, 4, 1, 3, 5]
    assert [row[-1] for row in tables["fingers"]] == ["yes"] * 4 + ["no", "yes"]
