"""Sizes of the effects of both renderers and their grades."""

import dataclasses

import pytest

from optics.rendering import ChamberEffects, Effects, chamber_effects, effects

KINDS = {Effects: effects, ChamberEffects: chamber_effects}
KEPT = {"gain": 1.0, "gamma": 1.0, "falloff": 1.0}
"""What is no fault of a picture, as it is by default."""

SEPARATE = {"lamps", "shadows", "strips", "walls", "flare", "defocus"}
"""What has severities of its own, as it is not in every light."""

every_kind = pytest.mark.parametrize("kind", KINDS)


@every_kind
def test_by_default_all_is_off(kind):
    assert kind.graded(0.0) == kind()
    assert all(size == KEPT.get(name, 0.0) for name, size in dataclasses.asdict(kind()).items())


@every_kind
@pytest.mark.parametrize("severity", [0.5, 1.0, 2.0])
def test_grades_are_multiples_of_a_typical_finger(kind, severity):
    graded = dataclasses.asdict(kind.graded(severity, gain=1.7))
    assert graded.pop("gain") == 1.7
    for name, size in graded.items():
        typical = getattr(KINDS[kind].TYPICAL, name)
        assert typical > 0
        wanted = severity * typical * (name not in SEPARATE)
        assert size == pytest.approx(typical if name in KEPT else wanted)


@every_kind
@pytest.mark.parametrize("severity", [-0.1, 2.1, float("nan")])
def test_other_grades_are_refused(kind, severity):
    with pytest.raises(ValueError, match=r"severity.* give 0 \(perfect\) to 2 \(poor\)"):
        kind.graded(severity)


def test_effects_have_severities_of_their_own():
    chosen = Effects.of({"lamps": 2.0, "jpeg": 0.5}, gain=1.2, gamma=2.2)
    assert chosen == Effects(gain=1.2, gamma=2.2, lamps=8.0, jpeg=4.0)
    with pytest.raises(ValueError, match="severity is 3"):
        Effects.of({"lamps": 3.0})


def test_scaling_leaves_the_gain():
    half = effects.scaled(Effects(gain=3.0, blur=1.0, jpeg=8.0), 0.5)
    assert half == Effects(gain=3.0, blur=0.5, jpeg=4.0)
