"""The image of a camera against directions in space, and central differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics.scene.camera import Camera, Equidistant, KannalaBrandt, Projection
from optics.scene.imaging import Imaging
from tests.helpers import check_gradients
from tests.optics.extruded import direction_of, imaged
from tests.optics.test_camera import COEFFICIENTS, HEIGHTS, PROJECTIONS, hemisphere

ROUNDING = 1e-12
"""Of a few operations, relative; an arc cosine near the axis loses two digits of them."""

SLOPES = 1e-8
"""What central differences leave, of a function and a design of order one."""

SINGLE = 5e-7
"""A few units of rounding in float32, of unit vectors; the table behind them errs by 1e-8."""

NEAR_EDGE = 3e-5
"""What the table errs by a tenth of a pixel from the edge of an orthographic image, where the angle
grows ever faster."""

POLYNOMIAL = [1, 0, *np.ravel([[k, 0] for k in COEFFICIENTS])]
"""θ + k₁ θ³ + … over θ, by falling importance of its powers."""

LENSES = HEIGHTS | {
    "kannala-brandt": lambda angle: angle * np.polyval(POLYNOMIAL[::-1], angle),
}
HALF_VIEW = np.radians(70)
ROWS, COLUMNS = 101, 134

COUNT = 200
"""Rays and places at a time: a program for every number of them would be compiled anew."""

every_lens = pytest.mark.parametrize("name", PROJECTIONS)


def imaging(projection: Projection) -> Imaging:
    return Imaging(
        Camera(np.array([3.0, 4.0]), 0.7, 2 * HALF_VIEW, ROWS, projection), ROWS, COLUMNS
    )


place = eqx.filter_jit(Imaging.place)
ray = eqx.filter_jit(Imaging.ray)


def rays(seed: int, name: str) -> np.ndarray:
    """Section angles and lateral slopes; up to 120° from the axis where the lens can."""
    rng = np.random.default_rng(seed)
    widest = 80 if hemisphere(PROJECTIONS[name]) else 120
    slopes = np.sinh(rng.uniform(-2.5, 2.5, COUNT))
    return np.stack([np.radians(rng.uniform(-widest, widest, COUNT)), slopes], axis=-1)


@every_lens
def test_rays_are_imaged_where_their_direction_in_space_says(name):
    angle, slope = rays(0, name).T
    places = place(imaging(PROJECTIONS[name]), jnp.asarray(angle), jnp.asarray(slope))
    wanted = imaged(angle, slope, LENSES[name], HALF_VIEW, ROWS, COLUMNS)
    np.testing.assert_allclose(places, wanted, rtol=ROUNDING, atol=ROWS * ROUNDING)


@every_lens
def test_rays_invert_places(name):
    given, eye = rays(3, name), imaging(PROJECTIONS[name])
    found = ray(eye, place(eye, *jnp.asarray(given.T)))
    # Across the axis a slope is as large as the ray's direction is badly told by it.
    np.testing.assert_allclose(
        direction_of(*np.asarray(found).T), direction_of(*given.T), atol=ROUNDING
    )
    np.testing.assert_allclose(found, given, rtol=1000 * ROUNDING)


@every_lens
def test_the_map_of_rays_holds_the_ray_of_every_pixel(name):
    eye = imaging(PROJECTIONS[name])
    rng = np.random.default_rng(4)
    column, row = rng.integers(0, COLUMNS, COUNT), rng.integers(0, ROWS, COUNT)
    column[:5] = 0, 0, COLUMNS - 1, COLUMNS - 1, COLUMNS // 2
    row[:5] = 0, ROWS - 1, 0, ROWS - 1, ROWS // 2
    if (lit := eye.lit()) is not None:  # beyond its edge there is no ray
        column, row = (place[lit[row, column]] for place in (column, row))
    found = eye.ray_map()
    assert found.shape == (ROWS, COLUMNS, 2)
    assert found.dtype == np.float32
    wanted = ray(eye, jnp.asarray(np.stack([column, row], axis=-1), float))
    np.testing.assert_allclose(
        direction_of(*found[row, column].astype(float).T),
        direction_of(*np.asarray(wanted).T),
        atol=NEAR_EDGE if name == "orthographic" else SINGLE,
    )


@every_lens
def test_rays_in_the_section_are_imaged_on_the_line_of_the_camera(name):
    angle = jnp.asarray(rays(5, name)[:, 0])
    eye = imaging(PROJECTIONS[name])
    places = place(eye, angle, jnp.zeros(COUNT))
    np.testing.assert_allclose(places[:, 0], (COLUMNS - 1) / 2, rtol=ROUNDING)
    wanted = eye.camera.pixel(angle) - 0.5
    np.testing.assert_allclose(places[:, 1], wanted, rtol=ROUNDING, atol=ROWS * ROUNDING)


@every_lens
def test_an_axis_beside_the_middle_moves_the_whole_image(name):
    offset = np.array([4.25, -3.5])
    eye = imaging(PROJECTIONS[name])
    moved = eqx.tree_at(
        lambda one: one.camera.axis_offset, eye, jnp.asarray(offset), is_leaf=lambda x: x is None
    )
    given = jnp.asarray(rays(6, name).T)
    places = np.asarray(place(eye, *given))
    np.testing.assert_allclose(place(moved, *given), places + offset, atol=1e-9)
    found = ray(moved, jnp.asarray(places + offset))
    np.testing.assert_allclose(found, ray(eye, jnp.asarray(places)), rtol=1e-9, atol=1e-12)
    angle, pixel = jnp.asarray(0.3), jnp.asarray(20.0)
    np.testing.assert_allclose(moved.camera.pixel(angle), eye.camera.pixel(angle) - 3.5, atol=1e-12)
    np.testing.assert_allclose(moved.camera.angle(pixel), eye.camera.angle(pixel + 3.5), atol=1e-12)
    if eye.lit() is None:
        found, pixels = moved.ray_map(), np.array([[0, 0], [COLUMNS - 1, ROWS - 1], [60, 50]])
        wanted = np.asarray(ray(moved, jnp.asarray(pixels, float)))
        directions = direction_of(*found[tuple(pixels.T[::-1])].astype(float).T)
        np.testing.assert_allclose(directions, direction_of(*wanted.T), atol=SINGLE)


def test_an_image_is_as_high_as_the_line_and_a_third_wider():
    eye = Imaging.of(Camera(np.zeros(2), 0.0, 1.0, 1080.0, Equidistant()))
    assert eye.shape == (1080, 1440)
    eye = Imaging.of(Camera(np.zeros(2), 0.0, 1.0, 120.0, Equidistant()), aspect=2.0)
    assert eye.shape == (120, 240)
    assert (eye.rows, eye.columns) == (120, 240)


@every_lens
def test_derivatives_of_places_and_rays(name):
    projection = PROJECTIONS[name]

    def both(design: list[jax.Array]) -> jax.Array:
        angle, slope, column, row, fov, *coefficients = design
        lens = KannalaBrandt(jnp.stack(coefficients)) if coefficients else projection
        eye = Imaging(Camera(jnp.zeros(2), 0.0, fov, ROWS, lens), ROWS, COLUMNS)
        place = eye.place(angle, slope) / ROWS
        ray = eye.ray(jnp.stack([COLUMNS * column, ROWS * row]))
        return place[0] + 0.7 * place[1] + ray[0] + 0.7 * ray[1]

    # The axis, the section, a plane across it through the axis, and beside both; beyond 90° too.
    angles, slopes = [0.0, 0.5, 0.0, -0.6], [0.0, 0.0, 0.4, 0.3]
    if not hemisphere(projection):
        angles, slopes = [*angles, np.pi / 2, 1.9], [*slopes, 0.5, -0.4]
    count = len(angles)
    columns, rows = np.linspace(0.3, 0.8, count), np.linspace(0.9, 0.2, count)
    lens = COEFFICIENTS if isinstance(projection, KannalaBrandt) else []
    constants = [np.full(count, number) for number in (2.0, *lens)]
    designs = [jnp.asarray(part) for part in (angles, slopes, columns, rows, *constants)]
    check_gradients(both, designs, atol=10 * SLOPES)


@every_lens
def test_derivatives_of_places_are_finite_next_to_the_axis(name):
    eye = imaging(PROJECTIONS[name])
    angles, slopes = jnp.array([0.0, 1e-9, 0.0, 1e-200]), jnp.array([0.0, 0.0, 1e-9, 1e-200])
    columns = jax.jit(jax.vmap(jax.grad(lambda *ray: eye.place(*ray)[0], (0, 1))))(angles, slopes)
    rows = jax.jit(jax.vmap(jax.grad(lambda *ray: eye.place(*ray)[1], (0, 1))))(angles, slopes)
    focal = ROWS / 2 / LENSES[name](HALF_VIEW)
    for found, wanted in zip([*columns, *rows], [0, focal, -focal, 0], strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-6 * focal)


@every_lens
def test_derivatives_of_rays_are_those_of_the_lens_on_the_axis(name):
    eye = imaging(PROJECTIONS[name])
    middle = jnp.array([(COLUMNS - 1) / 2, (ROWS - 1) / 2])
    focal = ROWS / 2 / LENSES[name](HALF_VIEW)
    wanted = [[0, -1 / focal], [1 / focal, 0]]
    np.testing.assert_allclose(jax.jacobian(eye.ray)(middle), wanted, rtol=ROUNDING)
