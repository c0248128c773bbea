"""An answer, and what stands for none."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.proprioception import Estimate, make_undefined, select_defined


def test_undefined_is_never_a_number():
    nothing = make_undefined("the pad is covered")
    assert not nothing.defined
    assert math.isnan(nothing.angle)
    assert math.isinf(nothing.deviation)
    assert nothing.reason == "the pad is covered"


@pytest.mark.parametrize("angle", [math.nan, math.inf, -math.inf])
def test_what_is_no_finite_angle_is_undefined(angle):
    assert not Estimate(angle, 0.1, "found").defined


@pytest.mark.parametrize("angle", [0.0, -1.5, 1e-300])
def test_every_finite_angle_is_defined_even_zero(angle):
    assert Estimate(angle, 0.1, "found").defined


@given(st.lists(st.booleans(), min_size=1, max_size=5))
def test_the_first_that_is_defined_counts_and_of_none_the_first(there):
    estimates = [
        Estimate(0.0, 1.0, str(i)) if defined else make_undefined(str(i))
        for i, defined in enumerate(there)
    ]
    expected = there.index(True) if any(there) else 0
    assert select_defined(*estimates) is estimates[expected]
