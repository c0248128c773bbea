"""Projections and pixels against OpenCV, textbook formulas and central differences."""

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics.scene.camera import CLASSICAL, Camera, KannalaBrandt, Pinhole, Projection
from tests.helpers import check_gradients

ROUNDING = 1e-13
"""A few units of rounding of a few operations, relative."""

SLOPES = 1e-9
"""What central differences leave, of a function and a design of order one."""

COEFFICIENTS = [0.05, -0.012, 0.004, -0.0007]
PROJECTIONS = CLASSICAL | {"kannala-brandt": KannalaBrandt(jnp.array(COEFFICIENTS))}
ANGLES = np.radians([-89, -60, -1, -1e-6, 0, 1e-3, 10, 45, 80, 89])
WIDE = np.radians([-179, -120, -90, 90, 100, 179])

every_projection = pytest.mark.parametrize("projection", PROJECTIONS.values(), ids=PROJECTIONS)


def hemisphere(projection: Projection) -> bool:
    """Whether it images no more than what is before the camera."""
    return projection in (PROJECTIONS["pinhole"], PROJECTIONS["orthographic"])


def camera(projection: Projection, degrees: float = 120, pixels: float = 640) -> Camera:
    return Camera(np.array([3.0, 4.0]), 0.7, np.radians(degrees), pixels, projection)


def test_a_pinhole_images_by_similar_triangles():
    depth, side = 40.0, np.linspace(-300, 300, 41)
    heights = Pinhole().height(jnp.arctan2(side, depth))
    np.testing.assert_allclose(heights, side / depth, rtol=ROUNDING, atol=ROUNDING)


def test_kannala_brandt_is_the_fisheye_model_of_opencv():
    angles = ANGLES[np.abs(ANGLES) > 1e-5]  # OpenCV takes smaller ones for the axis itself
    points = np.stack([np.tan(angles), np.zeros_like(angles), np.ones_like(angles)], axis=-1)
    still = np.zeros(3)
    imaged, _ = cv2.fisheye.projectPoints(
        points[None], still, still, np.eye(3), np.array(COEFFICIENTS)
    )
    heights = PROJECTIONS["kannala-brandt"].height(jnp.asarray(angles))
    np.testing.assert_allclose(heights, imaged[0, :, 0], rtol=ROUNDING)


def test_kannala_brandt_is_its_polynomial_beyond_a_right_angle_too():
    powers = WIDE[:, None] ** [1, 3, 5, 7, 9]
    heights = PROJECTIONS["kannala-brandt"].height(jnp.asarray(WIDE))
    np.testing.assert_allclose(heights, powers @ [1, *COEFFICIENTS], rtol=ROUNDING)


HEIGHTS = {
    "pinhole": np.tan,
    "equidistant": lambda angle: angle,
    "equisolid": lambda angle: 2 * np.sin(angle / 2),
    "stereographic": lambda angle: 2 * np.tan(angle / 2),
    "orthographic": np.sin,
}
"""Heights in focal lengths, as F. Bettonvil (WGN 33, 2005) has them."""


@pytest.mark.parametrize("name", HEIGHTS)
def test_heights_are_those_of_the_textbook(name):
    angles = ANGLES if hemisphere(PROJECTIONS[name]) else np.append(ANGLES, WIDE)
    heights = PROJECTIONS[name].height(jnp.asarray(angles))
    np.testing.assert_allclose(heights, HEIGHTS[name](angles), rtol=ROUNDING)


@pytest.mark.parametrize(("name", "edge"), [("equisolid", 2.0), ("orthographic", 1.0)])
def test_what_lies_beyond_the_edge_of_an_image_has_the_angle_of_the_edge(name, edge):
    lens = PROJECTIONS[name]
    assert lens.edge == edge
    assert float(lens.height(jnp.asarray(lens.widest))) == edge
    angle, slope = jax.vmap(jax.value_and_grad(lens.angle))(edge * jnp.array([-9.0, -1, 1, 1.1]))
    np.testing.assert_allclose(angle, lens.widest * np.array([-1, -1, 1, 1]), rtol=ROUNDING)
    np.testing.assert_array_equal(slope, 0)


@every_projection
def test_slopes_are_those_of_heights(projection):
    angles = ANGLES if hemisphere(projection) else np.append(ANGLES, WIDE)
    step = np.finfo(float).eps ** (1 / 3) * np.cos(np.clip(np.abs(angles), 0, 1.5))
    ends = [projection.height(jnp.asarray(angles + move)) for move in (step, -step)]
    slopes = projection.slope(jnp.asarray(angles))
    np.testing.assert_allclose(slopes, (ends[0] - ends[1]) / (2 * step), rtol=SLOPES, atol=SLOPES)


@every_projection
def test_angles_invert_heights_and_pixels(projection):
    angles = ANGLES if hemisphere(projection) else np.append(ANGLES, [-1.9, 1.9])
    angles = jnp.asarray(angles)
    turned = jax.jit(lambda lens, angles: lens.angle(lens.height(angles)))
    np.testing.assert_allclose(turned(projection, angles), angles, atol=1e-12)
    eye, looked = camera(projection), jax.jit(Camera.angle)
    np.testing.assert_allclose(looked(eye, eye.pixel(angles)), angles, atol=1e-12)
    assert looked(eye, jnp.full(angles.shape, 320.0))[0] == 0


@pytest.mark.parametrize(
    "coefficients",
    # Of images that stop to grow: nearly stereographic ones, where Newton's method from r/f leads
    # elsewhere, one with a dip in its slope, and one that ends at half a right angle.
    [
        (1 / 12, 1 / 120, 0.0, -0.002),
        (0.0503, 0.0396, -0.0025, -0.0043),
        (0.0788, 0.0338, 0.0011, -0.0057),
        (-0.2, 0.09, -0.012, 0.0001),
        (-0.55, 0.0, 0.0, 0.0),
    ],
)
def test_angles_are_inside_the_image_of_a_lens_that_ends(coefficients):
    projection = KannalaBrandt(jnp.array(coefficients))
    widest = projection.widest
    angles = widest * np.concatenate([np.linspace(-1, 1, 81)[1:-1], [0.999, -0.9999]])
    heights = np.polynomial.Polynomial([1.0, *coefficients])(angles**2) * angles
    assert projection.angle(jnp.array(heights)) == pytest.approx(angles, abs=1e-11)
    beyond = projection.angle(jnp.array([1.01, -3.0]) * heights.max())
    assert np.abs(beyond) == pytest.approx(widest, abs=np.pi / 60)
    for angle, height in zip(angles[[3, 40, -4]], heights[[3, 40, -4]], strict=True):
        near = angle + np.array([-1e-6, 1e-6])
        low, high = np.polynomial.Polynomial([1.0, *coefficients])(near**2) * near
        assert jax.grad(projection.angle)(height) == pytest.approx(2e-6 / (high - low), rel=1e-6)


@every_projection
def test_the_field_of_view_fills_the_image(projection):
    """Pixels grow clockwise."""
    for degrees in (1, 179) if hemisphere(projection) else (1, 179, 359.9):
        eye = camera(projection, degrees, pixels=480)
        limits = jnp.radians(jnp.array([degrees / 2, 0, -degrees / 2]))
        np.testing.assert_allclose(eye.pixel(limits), [0, 240, 480], atol=480 * ROUNDING)


@every_projection
def test_pixels_per_radian_is_how_fast_pixels_fall(projection):
    eye, angles = camera(projection), jnp.linspace(-1, 1, 11)
    slopes = jax.vmap(jax.grad(eye.pixel))(angles)
    np.testing.assert_allclose(eye.pixels_per_radian(angles), -slopes, rtol=ROUNDING)


@every_projection
def test_derivatives_of_pixels_and_angles(projection):
    def both(design: list[jax.Array]) -> jax.Array:
        fov, pixels, angle, *coefficients = design
        lens = KannalaBrandt(jnp.stack(coefficients)) if coefficients else projection
        eye = Camera(jnp.zeros(2), 0.0, fov, 100 * pixels, lens)
        return eye.pixel(angle) / 100 + eye.angle(100 * angle)

    lens = COEFFICIENTS if isinstance(projection, KannalaBrandt) else []
    design = [jnp.array([number]) for number in (2.0, 6.4, 0.4, *lens)]
    check_gradients(both, design, atol=10 * SLOPES)


@every_projection
def test_derivatives_are_finite_even_without_a_field_of_view(projection):
    def results(design: tuple[jax.Array, jax.Array, Projection]) -> jax.Array:
        fov, angle, lens = design
        eye = Camera(jnp.zeros(2), 0.0, fov, 640.0, lens)
        pixel = eye.pixel(angle)
        return pixel + eye.pixels_per_radian(angle) + eye.angle(pixel)

    views, angles = jnp.array([0.0, 0.0, 2.0, 2.0]), jnp.array([0.0, 0.3, 0.0, 0.3])
    design = views, angles, jax.tree.map(lambda leaf: jnp.tile(leaf, (4, 1)), projection)
    for leaf in jax.tree.leaves(jax.jit(jax.vmap(jax.value_and_grad(results)))(design)):
        assert np.isfinite(leaf).all()
