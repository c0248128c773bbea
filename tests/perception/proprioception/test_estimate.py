"""An answer, and what stands for none."""

import math

from hypothesis import given
from hypothesis import strategies as st

from perception.proprioception import Estimate, make_undefined, select_defined


def test_only_finite_angles_are_defined():
    nothing = make_undefined("the pad is covered")
    assert math.isnan(nothing.angle)
    assert math.isinf(nothing.deviation)
    assert nothing.reason == "the pad is covered"
    assert not nothing.defined
    for angle, defined in ((math.inf, False), (-math.inf, False), (0.0, True), (1e-300, True)):
        assert Estimate(angle, 0.1, "found").defined is defined


@given(st.lists(st.booleans(), min_size=1, max_size=5))
def test_the_first_that_is_defined_counts_and_of_none_the_first(there):
    estimates = [
        Estimate(0.0, 1.0, str(i)) if defined else make_undefined(str(i))
        for i, defined in enumerate(there)
    ]
    expected = there.index(True) if any(there) else 0
    assert select_defined(*estimates) is estimates[expected]
