"""The linkage's judgement and search beside `studies.oracles.finger_search`."""

from dataclasses import replace

import numpy as np
import pytest

from studies.finger_linkage.front import ELSEWHERE, PLAIN, bounded
from studies.models import packaged_finger
from studies.models.linkage_design.judging import judged
from studies.models.linkage_design.problem import SYMBOLS, ends_of, with_motor_pin
from studies.models.linkage_design.searching import search
from studies.models.linkage_design.spec import FingerLinkageSpec
from studies.models.pins import Pins, pin_name
from studies.oracles.finger_search import Asked, find_design, improve, measure

DRIVEN = Asked(motor=(8.0, 0.0, 12.0), pinch=(5.0, 20.0, 9.0), tip=(5.0, 53.5, 500.0))
"""What the default settings ask for; `Asked()` is that without motor and forces."""

ALLOWANCE = FingerLinkageSpec().search.allowance
SAME_DEG = 0.3
"""How near to each other both searches are asked to come."""


def coordinates(finger):
    return np.concatenate([np.asarray(getattr(finger.pins, pin)) for pin in "FEDCGH"])


def driven():
    """The packaged finger with its pin K where it was before it was rounded."""
    finger = packaged_finger()
    return with_motor_pin(finger, 12.0, ends_of(finger.body))


def undriven(moved_mm, seed):
    """The packaged finger with errors, and without its motor."""
    errors = np.random.default_rng(seed).normal(0.0, moved_mm, 12)
    places = (coordinates(packaged_finger()) + errors).reshape(6, 2)
    return replace(
        packaged_finger(), motor=None, pins=Pins(**dict(zip("FEDCGH", places, strict=True)))
    )


FINGERS = {"packaged": (driven(), DRIVEN)}
FINGERS |= {f"moved {n}": (undriven(0.3 * n, n), Asked()) for n in (1, 2, 3)}


@pytest.mark.parametrize(("finger", "asked"), FINGERS.values(), ids=FINGERS)
def test_judgements_agree(finger, asked):
    spec = FingerLinkageSpec()
    verdict = judged(finger, spec.limits, spec.motor)
    found = measure(coordinates(finger), asked, 91)
    assert verdict.assembles
    for name, values in found.angles_deg.items():
        np.testing.assert_allclose(values[0], verdict.angles_deg[SYMBOLS[name]], atol=1e-6)
    assert found.least_deg[0] == pytest.approx(verdict.least_deg, abs=1e-6)
    np.testing.assert_allclose(found.ratio[0], verdict.ratio, atol=1e-4)
    np.testing.assert_allclose(found.crank_deg[0], verdict.crank_deg, atol=1e-6)
    slack = {check.name: check.slack for check in verdict.checks}
    axles = {"A": "PIP axle", "B": "DIP axle"}
    names = {"|AF|": "|AF|", "|EF|": "|EF|", "range of the crank": "range of the crank"}
    for name in found.margins:
        one, _, other = name.partition(" from ")
        if other:
            pairs = f"{one} from the {axles.get(other, other)}", f"{other} from the {one}"
            (names[name],) = slack.keys() & set(pairs)
        if name.endswith(" apart"):
            pins = map(pin_name, name.removesuffix(" apart").split("-"))
            names[name] = "pins {} and {} apart".format(*pins)
    for pin, side in found.inside:
        names[f"{pin} inside the {side}"] = f"pin {pin_name(pin)} inside the {side}"
    for theirs, ours in names.items():
        assert found.margins[theirs].min() == pytest.approx(slack[ours], abs=1e-6), ours
    # All lengths but those to palmar faces and from lock-up, which the parallelogram has too.
    left = {name for name in slack if " from " in name or "apart" in name or "inside" in name}
    left = {name for name in left - set(names.values()) if "palmar face of" not in name}
    assert left <= {"dyads from lock-up", "transmission from the motor"}


def test_the_packaged_finger_is_an_optimum_of_other_code_too():
    found = improve(coordinates(packaged_finger()), replace(DRIVEN, allowance=ALLOWANCE), 7)
    coarse = measure(np.array([coordinates(packaged_finger()), found]), DRIVEN, 7)
    assert coarse.worst.max() < 0
    assert coarse.least_deg[1] == pytest.approx(coarse.least_deg[0], abs=0.1)


@pytest.mark.nightly
@pytest.mark.parametrize("bound", ELSEWHERE)
def test_searches_agree(bound):
    spec = bounded(FingerLinkageSpec.model_validate(PLAIN), bound)
    found = search(spec, 0)
    verdict = judged(found.finger, spec.limits, spec.motor)
    assert all(check.met for check in verdict.checks)
    assert verdict.least_deg == pytest.approx(ELSEWHERE[bound], abs=SAME_DEG)


@pytest.mark.nightly
@pytest.mark.parametrize("bound", ELSEWHERE)
def test_recorded_angles_are_those_of_the_independent_search(bound):
    found = find_design(Asked(ratio=bound, allowance=ALLOWANCE, shell=0.7), 0)
    assert found.worst < 1e-3
    assert found.least_deg == pytest.approx(ELSEWHERE[bound], abs=0.01)
