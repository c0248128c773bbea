"""The thin lens against textbook cases and formulas."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import LensResult, ThinLens
from tests.helpers import central_differences

ROUNDING = 1e-12

LENS = ThinLens(4.0, 4.0 / 2.8, 4.3)


def test_depth_of_field_and_hyperfocal_distance_are_the_photographers_formulas():
    # S. F. Ray, Applied Photographic Optics: H = f²/(N c) + f, near = s (H − f)/(H + s − 2f),
    # far = s (H − f)/(H − s), for focus at s.
    focal, number, blur, focus = 50.0, 4.0, 0.03, 3000.0
    lens = ThinLens(focal, focal / number, 1 / (1 / focal - 1 / focus))
    hyperfocal = focal**2 / (number * blur) + focal
    np.testing.assert_allclose(lens.hyperfocal_distance(blur).value, hyperfocal, rtol=ROUNDING)
    np.testing.assert_allclose(1 / lens.focus_vergence().value, focus, rtol=1e-10)
    near, far = lens.depth_of_field(blur).value
    np.testing.assert_allclose(
        1 / near, focus * (hyperfocal - focal) / (hyperfocal + focus - 2 * focal), rtol=1e-10
    )
    np.testing.assert_allclose(
        1 / far, focus * (hyperfocal - focal) / (hyperfocal - focus), rtol=1e-10
    )


def test_blur_at_the_limits_is_the_accepted_one():
    for vergence in LENS.depth_of_field(0.01).value:
        found = LENS.image(1 / vergence).value.blur_diameter
        np.testing.assert_allclose(found, 0.01, rtol=1e-10)


@pytest.mark.parametrize(
    ("distance", "vergence", "blur"),
    [
        (np.inf, 1 / 4.0, (4.0 / 2.8) * (4.3 / 4.0 - 1)),  # the image lies in the focal plane
        (4.0, 0.0, 4.0 / 2.8),  # the image lies at infinity: the beam is as wide as the lens
        (1 / (1 / 4.0 - 1 / 4.3), 1 / 4.3, 0.0),  # in focus
    ],
)
def test_focus_focal_plane_and_infinity_are_finite(distance, vergence, blur):
    solved = LENS.image(distance)
    assert bool(solved.ok)
    np.testing.assert_allclose(solved.value.vergence, vergence, atol=1e-15)
    np.testing.assert_allclose(solved.value.blur_diameter, blur, atol=1e-15)
    slopes = jax.jacrev(lambda lens, u: lens.image(u).value, argnums=(0, 1))(
        LENS, jnp.asarray(distance)
    )
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(slopes))


@pytest.mark.parametrize(
    "quantity",
    [
        lambda lens: lens.image(25.0).value.vergence,
        lambda lens: lens.image(25.0).value.magnification,
        lambda lens: lens.image(25.0).value.blur_diameter,
        lambda lens: lens.depth_of_field(0.01).value[0],
        lambda lens: lens.depth_of_field(0.01).value[1],
        lambda lens: lens.hyperfocal_distance(0.01).value,
        lambda lens: lens.focus_vergence().value,
    ],
)
def test_gradients_are_central_differences(quantity):
    found = [float(leaf) for leaf in jax.tree.leaves(jax.grad(quantity)(LENS))]
    expected = central_differences(quantity, LENS)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("lens", "solve", "code"),
    [
        (ThinLens(0.0, 1.0, 5.0), lambda lens: lens.image(25.0), LensResult.no_lens),
        (ThinLens(-4.0, 1.0, 5.0), lambda lens: lens.hyperfocal_distance(0.01), LensResult.no_lens),
        (ThinLens(4.0, 1.0, 0.0), lambda lens: lens.focus_vergence(), LensResult.no_sensor),
        (ThinLens(4.0, 0.0, 5.0), lambda lens: lens.depth_of_field(0.01), LensResult.no_aperture),
        (ThinLens(4.0, 1.0, -5.0), lambda lens: lens.depth_of_field(0.01), LensResult.no_sensor),
        (LENS, lambda lens: lens.hyperfocal_distance(0.0), LensResult.no_blur),
        (LENS, lambda lens: lens.image(1e-160), LensResult.out_of_range),
        (LENS, lambda lens: lens.image(0.0), LensResult.behind_lens),
        (LENS, lambda lens: lens.image(-3.0), LensResult.behind_lens),
    ],
)
def test_what_is_no_lens_is_reported_and_stays_finite(lens, solve, code):
    solved = solve(lens)
    assert bool(solved.result == code), solved.messages()
    gradient = jax.grad(lambda lens: sum(map(jnp.sum, jax.tree.leaves(solve(lens).value))))(lens)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((solved.value, gradient)))
