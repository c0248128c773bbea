"""Plane vectors against complex numbers."""

import cmath

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from designopt.vectors import (
    Vector,
    direction_to_meeting,
    fold_angle,
    rotation,
    stack,
    vector,
    where,
)

ROUNDINGS = 1e-13  # a few hundred, in numbers of size 100

plane = st.complex_numbers(max_magnitude=10, allow_subnormal=False)


def plane_vector(number: complex) -> Vector:
    return vector(jnp.array([number.real, number.imag]))


def number_of(value: Vector) -> complex:
    return complex(*np.asarray(value.stacked()))


@given(plane, plane)
def test_vectors_calculate_as_complex_numbers_do(p, q):
    a, b = plane_vector(p), plane_vector(q)
    for found, wanted in (
        (number_of(a + b), p + q),
        (number_of(a - b), p - q),
        (number_of(-a), -p),
        (number_of(a.scaled(jnp.asarray(3.0))), 3 * p),
        (number_of(a.turned(b)), p * q),
        (number_of(a.conjugate()), p.conjugate()),
        (number_of(a.perpendicular()), 1j * p),
        (float(a.dot(b)), (p.conjugate() * q).real),
        (float(a.cross(b)), (p.conjugate() * q).imag),
        (float(a.squared()), abs(p) ** 2),
    ):
        assert abs(found - wanted) < ROUNDINGS


def test_vectors_are_indexed_as_arrays_are():
    numbers = np.arange(6.0).reshape(2, 3) * (1 - 2j)
    vectors = Vector(jnp.asarray(numbers.real), jnp.asarray(numbers.imag))
    for index in (1, (..., 0), (slice(None), np.array([2, 0]))):
        found = vectors[index]
        np.testing.assert_array_equal(
            np.asarray(found.x) + 1j * np.asarray(found.y), numbers[index]
        )


@pytest.mark.parametrize("number", [1, 3 + 4j, -2j, -5 + 1e-3j])
def test_length_and_angle(number):
    assert float(plane_vector(number + 0j).length()) == pytest.approx(abs(number))
    assert float(plane_vector(number + 0j).angle()) == pytest.approx(cmath.phase(number))


@pytest.mark.parametrize("angle", [0.0, 1.0, -2.5])
def test_rotation(angle):
    assert number_of(rotation(jnp.asarray(angle))) == pytest.approx(cmath.exp(1j * angle))


def test_the_zero_vector_has_no_slope():
    def total(x, y):
        zero = Vector(x, y)
        return zero.length() + zero.angle() + fold_angle(zero, zero)

    value, slopes = jax.value_and_grad(total, argnums=(0, 1))(0.0, 0.0)
    assert (float(value), *map(float, slopes)) == (0, 0, 0)


def test_line_to_where_two_lines_meet():
    point = 1 + 5j
    diagonal = plane_vector(0j), plane_vector(1 + 1j)
    upright = plane_vector(4 + 0j), plane_vector(4 + 1j)
    found = number_of(direction_to_meeting(plane_vector(point), diagonal, upright))
    assert abs((found.conjugate() * (4 + 4j - point)).imag) < ROUNDINGS
    parallel = plane_vector(3j), plane_vector(2 + 5j)
    far = number_of(direction_to_meeting(plane_vector(point), diagonal, parallel))
    assert abs((far.conjugate() * (1 + 1j)).imag) < ROUNDINGS


@pytest.mark.parametrize(
    ("degrees", "wanted"), [(0, 0), (30, 30), (90, 90), (120, 60), (180, 0), (-45, 45)]
)
def test_folded_angle(degrees, wanted):
    turned = rotation(jnp.radians(float(degrees)))
    found = float(jnp.rad2deg(fold_angle(plane_vector(1 + 0j), turned)))
    assert found == pytest.approx(wanted, abs=1e-12)


def test_chosen_takes_each_vector_by_its_condition():
    first, second = vector(jnp.arange(8.0).reshape(4, 2)), vector(-jnp.ones((4, 2)))
    condition = jnp.array([True, False, False, True])
    found = np.asarray(where(condition, first, second).stacked())
    np.testing.assert_array_equal(found, [[0, 1], [-1, -1], [-1, -1], [6, 7]])


def test_together_keeps_vectors_in_their_order():
    parts = [vector(jnp.asarray(pair)) for pair in ([1.0, 2.0], [3.0, 4.0], [5.0, 6.0])]
    np.testing.assert_array_equal(stack(*parts).stacked(), [[1, 2], [3, 4], [5, 6]])
