"""Advice: the smallest change with which everything is met, on requirements with a known answer."""

import math

import numpy as np
import pytest

from designopt.study.settings import spec_with
from studies.finger import advice
from studies.finger.advice import (
    LEAST,
    LEVERS,
    MIRRORS,
    UNTRIED,
    Lever,
    advise,
    changed,
    value_of,
)
from studies.finger.designing import Designer
from studies.finger.spec import FingerSpec
from studies.models.body import BodySpec


class Thresholds(Designer):
    """What designs fingers, for tests: every setting has a value from which on all is met."""

    def __init__(self, needed: dict[str, float], blind: float = 0.0):
        self.needed, self.blind, self.runs, self.designs = needed, blind, [], 0

    def met(self, spec: FingerSpec, late: float) -> bool:
        self.designs += 1
        return any(
            math.copysign(1, lever.step) * (np.sum(value_of(spec, name)) - self.needed[name])
            >= late
            for name, lever in levers.items()
            if name in self.needed
        )

    def missed(self, spec: FingerSpec) -> list[str]:
        self.runs.append(spec)
        return [] if self.met(spec, 0.0) else ["coverage"]

    def meets_near(self, spec: FingerSpec, start: FingerSpec) -> bool:
        return self.met(spec, self.blind)

    def with_own_linkages(self) -> Designer:
        return self

    def could_help(self, spec: FingerSpec, other: FingerSpec) -> bool:
        self.designs += 1
        return True


levers = {lever.setting: lever for lever in LEVERS}


@pytest.mark.parametrize("blind", [0.0, 0.6, -1.2])
def test_the_smallest_change_meets_everything_and_half_of_it_does_not(blind):
    """Also where designs nearby are found too late, or seem to be enough too early."""
    needed = {"body.thickness": 28.2, "linkage.limits.transmission_deg": 33.5}
    designer, spec = Thresholds(needed, blind), FingerSpec()
    found = {one.setting: one for one in advise(spec, designer)}
    assert set(found) == set(needed)
    thickness, angle = found["body.thickness"], found["linkage.limits.transmission_deg"]
    assert 28.2 <= thickness.needed <= 28.2 + 0.5 + max(blind, 0) + 0.5
    assert 33.5 >= angle.needed >= 33.5 - 1 - max(blind, 0) - 1
    for one in (thickness, angle):
        lever = levers[one.setting]
        steps = (one.needed - one.now) / lever.step
        with_it, with_half = changed(spec, lever, steps), changed(spec, lever, steps / 2)
        assert with_it is not None
        assert with_half is not None
        assert value_of(with_half, one.setting) == pytest.approx(one.half)
        assert designer.met(with_it, 0.0)
        assert not designer.met(with_half, 0.0)
        # Both were designed as a run designs them.
        assert with_it in designer.runs
        assert with_half in designer.runs
        assert one.fails == "coverage"
    assert thickness.words == f"body.thickness = {thickness.needed:g} mm instead of 25 mm"
    assert "°" in angle.words


def test_programs_are_forgotten_before_each_design(monkeypatch):
    asked, designer = [], Thresholds({"body.thickness": 28.2})
    monkeypatch.setattr(advice, "forget_programs_if_many", lambda: asked.append(designer.designs))
    assert advise(FingerSpec(), designer)
    # But for why half of the change fails, which is known by then.
    assert len(set(asked)) == len(asked) == designer.designs - 1


def test_less_than_a_step_is_found_too():
    [found] = advise(FingerSpec(), Thresholds({"body.thickness": 25.1}))
    assert 25.1 <= found.needed < 25.2
    assert found.half < 25.1


def test_layers_get_thinner_in_proportion():
    spec = FingerSpec.model_validate({"mirrors": {"pads": {"thickness": [3.0, 2.0]}}})
    [found] = advise(spec, Thresholds({"mirrors.pads.thickness": 4.1}))
    assert 4.1 >= sum(found.needed) > 4.1 - 0.05 * 5.0
    assert sum(found.half) > 4.1
    assert found.needed[0] / found.needed[1] == pytest.approx(1.5)
    first, second = found.needed
    words = f"mirrors.pads.thickness = [{first}, {second}] mm instead of [3.0, 2.0] mm"
    assert found.words == words
    assert found.row["now"] == "[3.0, 2.0]"


def test_a_mirror_more_is_tried_on_either_phalanx():
    class Mirrors(Thresholds):
        def met(self, spec: FingerSpec, late: float) -> bool:
            return value_of(spec, MIRRORS).count("proximal") > 0

    spec = FingerSpec.model_validate({"mirrors": {"phalanges": ["distal"]}})
    [found] = advise(spec, Mirrors({}))
    assert found.words == 'mirrors.phalanges = ["distal", "proximal"] instead of ["distal"]'
    assert (found.half, found.fails) == (["distal"], "coverage")
    # Its words are a setting of the command line.
    given = found.words.split(" instead")[0].replace(" = ", "=")
    with_it = spec_with(FingerSpec, [given], study="finger")
    assert isinstance(with_it, FingerSpec)
    assert value_of(with_it, MIRRORS) == found.needed
    # With three there is no room for another one.
    full = FingerSpec.model_validate({"mirrors": {"phalanges": ["distal"] * 3}})
    assert advise(full, Mirrors({})) == []


def test_every_lever_is_tried_as_far_as_it_is_accepted():
    """One step is enough, also where a lever's greatest change is refused."""
    for lever in LEVERS:
        kind = lever.kind or "six-bar"
        given = {"body": {"dip_range_deg": 90.0}, "linkage": {"kind": kind}}
        spec = FingerSpec.model_validate(given)
        if lever.setting == "mirrors.camera.fov_deg":
            spec = FingerSpec.model_validate({"mirrors": {"camera": {"fov_deg": 200.0}}})
        step = changed(spec, lever, 1)
        assert step is not None
        needed = float(np.sum(value_of(step, lever.setting)))
        assert len(advise(spec, Thresholds({lever.setting: needed}))) == 1, lever


def test_settings_of_another_kind_of_linkage_are_not_tried():
    """A coupled finger has neither pinch nor spring; the six-bar's axes stay where they are."""
    needed = {"spring.preload": 0.35, "body.axis_height": 4.5}
    for kind, name in (("six-bar", "spring.preload"), ("coupled", "body.axis_height")):
        spec = FingerSpec.model_validate({"linkage": {"kind": kind}})
        [found] = advise(spec, Thresholds(needed))
        assert (found.setting, found.needed) == (name, needed[name])


def test_where_half_meets_everything_too_it_is_stated():
    """The least change that is tried: half of it is not designed by the search for it."""
    [found] = advise(FingerSpec(), Thresholds({"body.thickness": 25.001}))
    assert found.needed - found.now == pytest.approx(0.5 * LEAST)
    assert found.fails == UNTRIED


def test_a_change_counts_if_a_run_by_itself_meets_everything():
    class Others(Thresholds):
        def with_own_linkages(self) -> Designer:
            return Thresholds({"body.thickness": 28.2 + 0.6})

    assert advise(FingerSpec(), Others({"body.thickness": 28.2})) == []


def test_what_does_not_help_is_not_advised():
    assert advise(FingerSpec(), Thresholds({"body.thickness": 99.0})) == []


def test_settings_that_are_refused_are_no_advice():
    """A distal phalanx that leaves no room for its pad."""
    lever = Lever("body.distal", -10.0, 4)
    assert changed(FingerSpec(), lever, 3) is None
    shorter = changed(FingerSpec(), lever, 1)
    assert shorter is not None
    assert shorter.body == BodySpec(distal=22.0)


def test_every_lever_is_a_setting():
    """But for those that have no value by default."""
    unset = {"mirrors.camera.fov_deg", "body.dip_range_deg"}
    for lever in LEVERS:
        if value_of(FingerSpec(), lever.setting) is None:
            assert lever.setting in unset
        else:
            assert changed(FingerSpec(), lever, 0.0) == FingerSpec()
