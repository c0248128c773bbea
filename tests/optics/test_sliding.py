"""Rays that slide: a moving entrance pupil, beside brute-force rays and closed forms."""

import math
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import UserError
from optics import (
    Imaging,
    Scene,
    find_corners,
    find_outlines,
    format_scene,
    parse_scene,
    trace_views,
)
from optics.rendering.effects import Effects
from optics.rendering.renderer import Renderer
from optics.visibility.outlines import CORNERS
from studies.oracles.layered_scenes import sliding_scene
from tests.optics.test_layers import (
    ACRYLIC,
    GEL,
    NO_ANGLES,
    ROUNDING,
    assert_same_views,
    assert_views_are_shown,
    check_slopes,
    find,
    seen_numbers,
    tables,
)

SHIFT = (0.35, 0.03)
"""Of a real fisheye: 0.8 mm at 80°."""


def scene(*layers: dict, shift: tuple[float, float] | None = SHIFT, **more) -> Scene:
    file = tables(*layers, **more)
    return parse_scene(file if shift is None else with_shift(file, shift))


def with_shift(file: dict, shift: tuple[float, float] = SHIFT) -> dict:
    return file | {"camera": file["camera"] | {"pupil_shift": list(shift)}}


def check_structure(structure: int, count: int, **parts: bool) -> None:
    rng = np.random.default_rng([structure, 7])
    assert_views_are_shown([sliding_scene(rng, structure, **parts) for _ in range(count)])


def test_random_scenes_show_what_rays_show():
    check_structure(2, 40, sheets=False, layers=False)


def test_random_layered_scenes_show_what_rays_show():
    check_structure(3, 40, sheets=False)


@pytest.mark.nightly
@pytest.mark.parametrize("structure", range(20))
def test_a_thousand_random_scenes(structure):
    check_structure(structure, 60)


@pytest.mark.parametrize("layers", [[], [ACRYLIC, GEL]], ids=["bare", "layered"])
def test_a_pupil_that_stays_is_none(layers):
    still, none = scene(*layers, shift=(0.0, 0.0)), scene(*layers, shift=None)
    assert_same_views(find(still), find(none), rtol=ROUNDING, atol=1e2 * ROUNDING)


@pytest.mark.parametrize("layers", [[], [ACRYLIC | {"overhang": 1}, GEL]], ids=["bare", "layered"])
def test_slopes_of_views(layers):
    file = with_shift(tables(*layers, min_grazing_deg=3.0))
    moving = parse_scene(file | {"pads": file["pads"][:1], "mirrors": []})
    assert bool(find(moving).value.present.any())
    check_slopes(seen_numbers, moving)


def test_rays_of_the_fan_show_the_same():
    moving = scene()
    exact, traced = find(moving).value, jax.jit(trace_views)(moving, NO_ANGLES).value
    for name in ("start", "end", "pixels", "px_per_mm", "distance"):
        first, second = (np.asarray(getattr(v, name))[v.present] for v in (exact, traced))
        np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-9, err_msg=name)


def pupil(theta: float) -> float:
    return SHIFT[0] * theta**2 + SHIFT[1] * theta**4


def test_corners_lie_on_rays_through_the_moved_pupil():
    moving, width, lateral = scene(), 24.0, 1.5
    imaging = Imaging.of(moving.camera)
    outlines = jax.jit(find_outlines)(moving, NO_ANGLES)
    corners = np.asarray(find_corners(imaging, outlines, width, lateral))
    turn = math.radians(-80)
    axis, up = (np.array([math.cos(t), math.sin(t), 0.0]) for t in (turn, turn + math.pi / 2))
    for corner, (end, side) in enumerate(CORNERS):
        place = np.array([20.0 * end - 2.0, -12.0, side * width / 2 - lateral])
        theta = 0.0
        for _ in range(100):
            ray = place - pupil(theta) * axis
            theta = math.acos(ray @ axis / np.linalg.norm(ray))
        radius = 1000 / math.radians(170) * theta / math.hypot(ray @ up, ray[2])
        wanted = imaging.columns / 2 - 0.5 + radius * ray[2], 499.5 - radius * (ray @ up)
        np.testing.assert_allclose(corners[0, 0, corner], wanted, atol=1e-9)


@pytest.mark.parametrize("layers", [[], [ACRYLIC, GEL]], ids=["bare", "layered"])
def test_outlines_end_where_views_do(layers):
    moving = scene(*layers)
    view, outlines = find(moving).value, jax.jit(find_outlines)(moving, NO_ANGLES)
    direct = int(np.flatnonzero(view.present[0] & (view.path[0] == 0) & (view.start[0] == 0))[0])
    pixel = moving.camera.pixel(outlines.angle[0, 0, 0])
    np.testing.assert_allclose(view.pixels[0, direct, 0], pixel, atol=1e-9)
    imaging = Imaging.of(moving.camera)

    def seen(width: jax.Array) -> jax.Array:
        return jnp.sum(find_corners(imaging, find_outlines(moving, NO_ANGLES), width)[0, 0])

    check_slopes(seen, jnp.asarray(24.0))


def test_a_moving_pupil_is_written_and_read_again():
    again = parse_scene(tomllib.loads(format_scene(scene())))
    np.testing.assert_array_equal(again.camera.pupil_shift, SHIFT)


def test_synthetic_images_refuse_a_moving_pupil():
    with pytest.raises(UserError, match="leave out 'pupil_shift'"):
        Renderer(scene(), 20.0, Effects())
