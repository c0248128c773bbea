"""Every dyad against complex arithmetic: the vectors it returns must close."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from designopt.vectors import Vector, vector
from kinematics.solve.dyads import apart, solve_rpr, solve_rrp, solve_rrr, solve_two_slides

number = st.floats(-10, 10).map(lambda x: x or 1.0)
plane = st.tuples(number, number).filter(lambda p: np.hypot(*p) > 1e-3)
side = st.sampled_from([1.0, -1.0])
CLOSED = 1e-13  # in units of vectors of size 10: a few hundred roundings


def plane_vector(point) -> Vector:
    return vector(jnp.asarray(point, float))


def number_of(value: Vector) -> complex:
    return complex(float(value.x), float(value.y))


def unit(point) -> Vector:
    return plane_vector(np.asarray(point) / np.hypot(*point))


jitted = {
    function: jax.jit(function) for function in (solve_rrr, solve_rrp, solve_rpr, solve_two_slides)
}


@given(plane, plane, plane, side)
def test_two_angles(e, a, b, sign):
    vectors = [plane_vector(v) for v in (e, a, b)]
    alpha, beta, margins = jitted[solve_rrr](*vectors, jnp.asarray(sign), unit((1, 0)))
    ends = [number_of(v) for v in vectors]
    lengths = [abs(end) for end in ends]
    assert float(margins[0]) == pytest.approx(lengths[1] + lengths[2] - lengths[0], abs=1e-12)
    assert float(margins[1]) == pytest.approx(lengths[0] - abs(lengths[1] - lengths[2]), abs=1e-12)
    if min(map(float, margins)) > 1e-6:
        alpha, beta = number_of(alpha), number_of(beta)
        assert abs(alpha * ends[1] + beta * ends[2] - ends[0]) < CLOSED * 10
        assert abs(abs(alpha) - 1) < CLOSED * 1e3 / min(1, lengths[1])
        assert np.sign((ends[0].conjugate() * alpha * ends[1]).imag) == sign


@given(plane, plane, plane, side)
def test_angle_and_slide(e, a, w, sign):
    alpha, slide, (margin,) = jitted[solve_rrp](
        plane_vector(e), plane_vector(a), unit(w), jnp.asarray(sign)
    )
    e, a, w = complex(*e), complex(*a), number_of(unit(w))
    assert float(margin) == pytest.approx(abs(a) - abs((w.conjugate() * e).imag), abs=1e-12)
    if float(margin) > 1e-6:
        turned = number_of(alpha) * a
        assert abs(turned + float(slide) * w - e) < CLOSED * 10
        assert np.sign((turned * w.conjugate()).real) == sign


@given(plane, plane, plane, side)
def test_angle_and_own_slide(e, a, u, sign):
    alpha, slide, (margin,) = jitted[solve_rpr](
        plane_vector(e), plane_vector(a), unit(u), jnp.asarray(sign), unit((1, 0))
    )
    e, a, u = complex(*e), complex(*a), number_of(unit(u))
    assert float(margin) == pytest.approx(abs(e) - abs((u.conjugate() * a).imag), abs=1e-12)
    if float(margin) > 1e-6:
        arm = a + float(slide) * u
        assert abs(number_of(alpha) * arm - e) < CLOSED * 10
        assert np.sign((arm * u.conjugate()).real) == sign


@given(plane, plane, plane, side)
def test_two_slides(e, v, w, sign):
    vectors = plane_vector(e), unit(v), unit(w)
    s, t, (margin,) = jitted[solve_two_slides](*vectors, jnp.asarray(sign))
    v, w = number_of(unit(v)), number_of(unit(w))
    assert float(margin) == pytest.approx(sign * (w.conjugate() * v).imag, abs=1e-12)
    if abs(float(margin)) > 1e-3:
        assert abs(float(s) * v + float(t) * w - complex(*e)) < CLOSED / abs(float(margin)) * 100


def test_coincident_pins_take_the_direction_they_are_given():
    zero, one = plane_vector((0, 0)), plane_vector((1, 0))
    for towards in ((0, 0.01), (3, 4), (-1, 0)):  # of any length
        alpha, beta, _ = jitted[solve_rrr](zero, one, one, jnp.asarray(1.0), plane_vector(towards))
        expected = complex(*towards) / abs(complex(*towards)) * 1j
        assert abs(number_of(alpha) - expected) < 1e-15
        assert abs(number_of(beta) + expected) < 1e-15


def test_only_what_has_no_direction_is_replaced():
    for dtype, small, smaller in (("float64", 1e-70, 1e-80), ("float32", 1e-8, 1e-10)):
        towards = vector(jnp.asarray([0.0, 1.0], dtype))
        kept = apart(vector(jnp.asarray([small, 0.0], dtype)), towards)
        assert (float(kept.x), float(kept.y)) == (float(np.asarray(small, dtype)), 0.0)
        replaced = apart(vector(jnp.asarray([smaller, 0.0], dtype)), towards)
        assert float(replaced.x) == 0.0
        assert 0 < float(replaced.y) < 10 * np.finfo(dtype).eps
        anywhere = apart(vector(jnp.zeros(2, dtype)), vector(jnp.zeros(2, dtype)))
        assert float(anywhere.x) > 0


def test_slopes_stay_finite_at_and_beyond_lockup():
    def total(lengths):
        e, a, b = (plane_vector((length, 0.0)) for length in lengths)
        alpha, beta, margins = solve_rrr(e, a, b, jnp.asarray(1.0), plane_vector((1, 0)))
        return alpha.x + beta.y + margins[0] + margins[1]

    lengths = np.array([(3.0, 1.0, 2.0), (4.0, 1.0, 2.0), (0.5, 1.0, 2.0), (0.0, 1.0, 1.0)])
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(total)))(lengths)
    assert np.all(np.isfinite(values))
    assert np.all(np.isfinite(slopes))
