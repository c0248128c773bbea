"""Conic arcs: the section equation, meetings with rays, foci."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.vectors import Vector, rotation
from optics.visibility.curves import Arc, arc_between

ROUNDING = 1e-12

CONICS = [
    pytest.param(5.0, 0.0, id="circle, centre left"),
    pytest.param(-5.0, 0.0, id="circle, centre right"),
    pytest.param(4.0, -1.0, id="parabola"),
    pytest.param(-6.0, -0.5, id="ellipse"),
    pytest.param(3.0, -2.0, id="hyperbola"),
    pytest.param(9.0, 0.7, id="oblate ellipse"),
]
START, END = (1.0, -2.0), (3.0, 3.5)


def vector(pair: tuple[float, float]) -> Vector:
    return Vector(jnp.asarray(pair[0]), jnp.asarray(pair[1]))


@jax.jit
def arc(radius: jax.Array, conic: jax.Array) -> Arc:
    return arc_between(vector(START), vector(END), radius, conic)


@jax.jit
def places(on: Arc, coordinates: jax.Array) -> jax.Array:
    """Points of an arc, shape (coordinates, 2)."""
    return on.place(coordinates).stacked()


@pytest.mark.parametrize(("radius", "conic"), CONICS)
def test_arc_joins_its_ends_and_obeys_the_conic_equation(radius: float, conic: float):
    found = arc(radius, conic)
    on = np.asarray(places(found, np.linspace(0, 1, 11)))
    np.testing.assert_allclose(on[[0, -1]], [START, END], atol=ROUNDING)
    # In complex numbers, about the vertex: the chord's direction is real, its left imaginary.
    along = complex(*END) - complex(*START)
    along /= abs(along)
    vertex = complex(float(found.vertex.x), float(found.vertex.y))
    local = (on @ [1, 1j] - vertex) / along
    x, z = local.real, local.imag
    np.testing.assert_allclose(x**2 + (1 + conic) * z**2, 2 * radius * z, atol=1e-11)
    assert np.all(z * radius >= -ROUNDING)  # it bends towards its centre


@jax.jit
def meet(arc: Arc, start: jax.Array, angle: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Distances at which a ray meets an arc, and which of them count."""
    position = arc.local(Vector(start[0], start[1]) - arc.vertex)
    return arc.meetings(position, arc.local(rotation(angle)), jnp.asarray(False))[:2]


@pytest.mark.parametrize(("radius", "conic"), CONICS)
def test_meetings_are_where_a_dense_polygon_is_crossed(radius: float, conic: float):
    found = arc(radius, conic)
    parts = np.linspace(0, 1, 200_001)
    polygon = np.asarray(places(found, parts))
    generator = np.random.default_rng(3)
    met = 0
    for _ in range(40):
        start, angle = generator.uniform(-6, 6, 2), generator.uniform(-np.pi, np.pi)
        heading = np.array([np.cos(angle), np.sin(angle)])
        across = (polygon - start) @ np.array([-heading[1], heading[0]])
        ahead = (polygon - start) @ heading
        crossed = np.flatnonzero(np.diff(np.sign(across)))
        expected = sorted(ahead[crossed][ahead[crossed] > 0])
        distances, on = meet(found, start, angle)
        np.testing.assert_allclose(sorted(distances[on]), expected, atol=2e-4)
        met += len(expected)
    assert met > 5
