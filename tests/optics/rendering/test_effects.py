"""Sizes of the effects and their grades."""

from __future__ import annotations

import dataclasses

import pytest

from optics.rendering import Effects
from optics.rendering.effects import TYPICAL, scaled

SIZES = [field.name for field in dataclasses.fields(Effects) if field.name != "gain"]


def test_by_default_all_is_off():
    assert dataclasses.asdict(Effects()) == {"gain": 1.0} | dict.fromkeys(SIZES, 0.0)


@pytest.mark.parametrize("severity", [0.0, 0.5, 1.0, 2.0])
def test_grades_are_multiples_of_a_typical_finger(severity):
    graded = Effects.graded(severity, gain=1.7)
    for name in SIZES:
        size = getattr(TYPICAL, name)
        assert size > 0
        assert getattr(graded, name) == pytest.approx(severity * size)
    assert graded.gain == 1.7


def test_without_severity_all_is_off():
    assert Effects.graded(0.0) == Effects()


@pytest.mark.parametrize("severity", [-0.1, 2.1, float("nan")])
def test_other_grades_are_refused(severity):
    with pytest.raises(ValueError, match=r"give 0 \(perfect\) to 2 \(poor\)"):
        Effects.graded(severity)


def test_scaling_leaves_the_gain():
    half = scaled(Effects(gain=3.0, blur=1.0, jpeg=8.0), 0.5)
    assert half == Effects(gain=3.0, blur=0.5, jpeg=4.0)
