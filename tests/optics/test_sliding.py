"""Rays that slide, by a moving pupil or in sheets: beside brute-force rays and closed forms."""

import math
import tomllib
from dataclasses import replace

import equinox as eqx
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
    trace_rays,
    trace_views,
)
from optics.rendering.effects import Effects
from optics.rendering.renderer import Renderer
from optics.scene.layers import MirrorLayers
from optics.scene.scene import place
from optics.scene.writer import scene_tables
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


LAYERED = [ACRYLIC | {"overhang": 1}, GEL]

BARE_AND_LAYERED = [[], pytest.param(LAYERED, marks=pytest.mark.slow)]


def scene(*layers: dict, shift: tuple[float, float] | None = SHIFT, **more) -> Scene:
    file = tables(*layers, **more)
    return parse_scene(file if shift is None else with_shift(file, shift))


def with_shift(file: dict, shift: tuple[float, float] = SHIFT) -> dict:
    return file | {"camera": file["camera"] | {"pupil_shift": list(shift)}}


SHEET = {"thickness": 0.5, "index": 1.59}


def with_sheets(file: dict, *layers: dict) -> dict:
    return file | {"mirrors": [mirror | {"layers": list(layers)} for mirror in file["mirrors"]]}


def check_structure(structure: int, count: int, **parts: bool) -> None:
    rng = np.random.default_rng([structure, 7])
    assert_views_are_shown([sliding_scene(rng, structure, **parts) for _ in range(count)])


def test_random_scenes_show_what_rays_show():
    check_structure(2, 40, sheets=False, layers=False)


@pytest.mark.nightly
def test_random_layered_scenes_show_what_rays_show():
    check_structure(3, 40, sheets=False)


@pytest.mark.nightly
@pytest.mark.parametrize("structure", range(20))
def test_a_thousand_random_scenes(structure):
    check_structure(structure, 60)


@pytest.mark.parametrize("layers", BARE_AND_LAYERED, ids=["bare", "layered"])
def test_a_pupil_that_stays_is_none(layers):
    still, none = scene(*layers, shift=(0.0, 0.0)), scene(*layers, shift=None)
    assert_same_views(find(still), find(none), rtol=ROUNDING, atol=1e2 * ROUNDING)


@pytest.mark.parametrize(
    "layers", [[], pytest.param(LAYERED, marks=pytest.mark.nightly)], ids=["bare", "layered"]
)
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
        theta, ray = 0.0, place
        for _ in range(100):
            ray = place - pupil(theta) * axis
            theta = math.acos(ray @ axis / np.linalg.norm(ray))
        radius = 1000 / math.radians(170) * theta / math.hypot(ray @ up, ray[2])
        wanted = imaging.columns / 2 - 0.5 + radius * ray[2], 499.5 - radius * (ray @ up)
        np.testing.assert_allclose(corners[0, 0, corner], wanted, atol=1e-9)


@pytest.mark.parametrize("layers", BARE_AND_LAYERED, ids=["bare", "layered"])
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


def test_an_axis_beside_the_middle_is_written_and_read_again():
    moved = eqx.tree_at(
        lambda one: one.camera.axis_offset,
        scene(),
        jnp.array([3.5, -2.0]),
        is_leaf=lambda leaf: leaf is None,
    )
    again = parse_scene(tomllib.loads(format_scene(moved)))
    np.testing.assert_array_equal(again.camera.axis_offset, [3.5, -2.0])


def test_random_sheets_show_what_rays_show():
    check_structure(14, 40, layers=False)


@pytest.mark.parametrize(("degrees", "behind"), [(30.0, 0.29), (80.0, 0.07)])
def test_a_sheet_seems_to_reflect_behind_its_front(degrees, behind):
    """By t tan θ′ / tan θ, with n sin θ′ = sin θ; and so do traced rays."""
    angle = math.radians(degrees)
    inside = math.asin(math.sin(angle) / 1.59)
    depth = 0.5 * math.tan(inside) / math.tan(angle)
    assert depth == pytest.approx(behind, abs=0.005)
    # The front lies on y = 0; a ray from 10 mm over it meets a mirror on y = −depth.
    camera = {"position": [0.0, 10.0], "direction_deg": degrees - 90, "fov_deg": 90, "pixels": 100}
    mirror = {"name": "sheet", "from": [0.0, -0.5], "to": [200.0, -0.5], "side": "left"}
    pad = {"name": "wall", "from": [100.0, 0.5], "to": [100.0, 200.0], "side": "left"}
    file = {"camera": camera, "mirrors": [mirror | {"layers": [SHEET]}], "pads": [pad]}
    start, way = jnp.array([[0.0, 10.0]]), jnp.deg2rad(jnp.array([degrees - 90]))
    hits = trace_rays(parse_scene(file), NO_ANGLES, start, way, bounces=1)
    ahead = 10 * math.tan(angle) + 0.5 * math.tan(inside)
    np.testing.assert_allclose(hits.place[0, 0], [ahead, -0.5], atol=1e-12)
    np.testing.assert_allclose(hits.coordinate[0, 0] * 200, ahead, atol=1e-12)
    # The wall stands at x = 100, to which it goes as from a plain mirror at that depth.
    height = (100 - (10 + 2 * depth) * math.tan(angle)) / math.tan(angle)
    np.testing.assert_allclose(hits.place[0, 1], [100.0, height], atol=1e-12)
    air = (100 - 2 * 0.5 * math.tan(inside)) / math.sin(angle)
    np.testing.assert_allclose(hits.length[0, 1], air + 1 / math.cos(inside), atol=1e-12)


def test_a_sheet_of_air_is_no_sheet():
    file = tables(min_grazing_deg=2.0)
    air = parse_scene(with_sheets(file, *({"thickness": t, "index": 1.0} for t in (0.5, 0.2))))
    assert_same_views(find(air), find(parse_scene(file)), rtol=ROUNDING, atol=1e2 * ROUNDING)


@pytest.mark.slow
def test_slopes_of_views_in_sheets():
    file = with_sheets(tables(min_grazing_deg=3.0), SHEET)
    sheets = parse_scene(with_shift(file | {"pads": file["pads"][:1]}))
    view = find(sheets).value
    assert bool(jnp.any(view.present & (view.path == 1)))
    check_slopes(seen_numbers, sheets)


def test_entries_of_layers_that_mirrors_do_not_have_do_not_count():
    line = {"from": [-5.0, 0.0], "to": [5.0, 0.0], "side": "left"}
    under = [[], [SHEET], [SHEET, {"thickness": 0.3, "index": 1.4}]]
    mirrors = [line | {"name": f"m{len(own)}", "layers": own} for own in under]
    three = parse_scene(tables() | {"mirrors": mirrors})

    def numbers(layers: MirrorLayers) -> jax.Array:
        placed = place(replace(three, mirror_layers=layers), NO_ANGLES)
        weights = jnp.arange(1.0, 1 + placed.corners.x.size).reshape(placed.corners.x.shape)
        assert placed.sheets is not None
        corners = jnp.sum(weights * (placed.corners.x + 2 * placed.corners.y))
        return corners + jnp.sum(placed.sheets.thickness * placed.sheets.index)

    assert three.mirror_layers is not None
    value, slopes = jax.value_and_grad(numbers)(three.mirror_layers)
    there = np.array([[False, False], [True, False], [True, True]])
    for leaf in (slopes.thickness, slopes.index):
        assert np.array_equal(np.asarray(leaf) != 0, there)
    changed = jax.tree.map(lambda leaf: jnp.where(there, leaf, 1.3), three.mirror_layers)
    assert numbers(changed) == value
    written = scene_tables(replace(three, mirror_layers=changed))["mirrors"]
    assert [mirror.get("layers", []) for mirror in written] == under


def test_rays_from_behind_end_at_the_coat():
    file = {
        "camera": {"position": [0.0, 10.0], "direction_deg": -90, "fov_deg": 10, "pixels": 100},
        "mirrors": [
            {"name": "m", "from": [-5.0, 0.0], "to": [5.0, 0.0], "side": "right", "layers": [SHEET]}
        ],
    }
    way = jnp.deg2rad(jnp.array([-75.0]))
    hits = trace_rays(parse_scene(file), NO_ANGLES, jnp.array([[0.0, 10.0]]), way, bounces=1)
    aside = 10 * math.tan(math.radians(15))
    np.testing.assert_allclose(hits.place[0, 0], [aside, 0.0], atol=1e-12)
    assert float(hits.length[0, 0]) == pytest.approx(math.hypot(aside, 10), abs=1e-12)
    assert float(hits.coordinate[0, 0]) == pytest.approx(0.5 + aside / 10, abs=1e-12)


def test_traced_rays_end_where_views_in_sheets_do():
    file = with_sheets(tables(min_grazing_deg=3.0), SHEET, {"thickness": 0.3, "index": 1.4})
    sheets = parse_scene(file)
    view = find(sheets).value
    pieces = np.flatnonzero(view.present[0] & (view.path[0] == 1))
    assert pieces.size
    axis, start = math.radians(-80), jnp.array([[2.0, 12.0]])
    for piece in pieces.tolist():
        for end in range(2):
            inward = float(view.pixels[0, piece, 1 - end] - view.pixels[0, piece, end]) * 1e-9
            seen = sheets.camera.angle(view.pixels[0, piece, end] + inward)
            hits = trace_rays(sheets, NO_ANGLES, start, (axis + seen)[None], bounces=1)
            assert hits.surface[0].tolist() == [0, 1]
            at = (view.start, view.end)[end][0, piece]
            np.testing.assert_allclose(hits.coordinate[0, 1], at, atol=1e-7)
            np.testing.assert_allclose(
                hits.coordinate[0, 0], view.spans[0, piece, 0, end], atol=1e-7
            )
            np.testing.assert_allclose(hits.length[0, 1], view.distance[0, piece, end], atol=1e-5)


def test_corners_in_a_sheet_are_where_snells_law_puts_them():
    """The middle of a wide pad's side, traced through the sheet in three dimensions."""
    file = with_sheets(tables(), SHEET)
    sheets, plain = parse_scene(file), parse_scene(tables())
    imaging, width = Imaging.of(sheets.camera), 24.0
    outlines = jax.jit(find_outlines)(sheets, NO_ANGLES)
    corners = np.asarray(find_corners(imaging, outlines, width))[1, 0]
    coat = np.asarray(plain.mirrors[0])
    along = (coat[1] - coat[0]) / np.hypot(*(coat[1] - coat[0]))
    normal = np.array([along[1], -along[0], 0.0])  # to the right, where the mirror reflects
    front = np.append(coat[0], 0.0) + 0.5 * normal
    turn = math.radians(-80)
    axis, up = (np.array([math.cos(t), math.sin(t), 0.0]) for t in (turn, turn + math.pi / 2))
    for corner, (end, side) in enumerate(CORNERS):
        angle, slope = imaging.ray(jnp.asarray(corners[corner]))
        ray = math.cos(angle) * axis + math.sin(angle) * up + np.array([0.0, 0.0, slope])
        ray /= np.linalg.norm(ray)
        camera = np.array([2.0, 12.0, 0.0])
        meets = camera + ray * ((front - camera) @ normal / (ray @ normal))
        cosine = -ray @ normal
        level = ray + cosine * normal
        leaves = meets + 2 * 0.5 * level / math.sqrt(1.59**2 - level @ level)
        gone = ray + 2 * cosine * normal
        place = leaves - gone * leaves[1] / gone[1]
        np.testing.assert_allclose(place, [20.0 * end, 0.0, side * width / 2], atol=1e-8)


def test_sheets_are_written_and_read_again():
    file = with_sheets(tables(), SHEET, {"thickness": 0.3, "index": 1.4})
    first = parse_scene(file, "wide")
    again = parse_scene(tomllib.loads(format_scene(first)), "wide")
    assert again.layout == first.layout
    for one, other in zip(
        jax.tree.leaves(first.mirror_layers), jax.tree.leaves(again.mirror_layers), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_what_does_not_follow_sheets_refuses_them():
    file = with_sheets(tables(), SHEET)
    with pytest.raises(UserError, match="leave out 'layers' of the mirrors"):
        Renderer(parse_scene(file), 20.0, Effects())
    with pytest.raises(ValueError, match="mirrors have layers"):
        trace_views(parse_scene(file), NO_ANGLES)
    bent = {"name": "bent", "from": [0.0, 30.0], "to": [9.0, 30.0], "radius": 40.0}
    with pytest.raises(UserError, match="those with layers"):
        parse_scene(file | {"mirrors": [*file["mirrors"], bent]})


@pytest.mark.parametrize("thickness", [1.0, 4.0])
def test_a_limit_of_a_narrow_field_keeps_its_side_behind_a_thick_sheet(thickness):
    # Of the same parts as in the tests before, so that one program serves all.
    half = {"thickness": thickness / 2, "index": 1.5}
    table = with_sheets(tables(camera=(0.0, 0.0), direction=0.0), half, half)
    table["camera"]["fov_deg"] = 10.0
    table["mirrors"][0] |= {"from": [40.0, 20.0], "to": [0.0, -20.0]}
    table["pads"][0] |= {"from": [40.0, 8.0], "to": [-20.0, 8.0]}
    found = find(parse_scene(table))
    # The ray at an angle f meets the front, y = x - 20 + t √2, goes 2 t tan of the angle in the
    # glass along it, and leaves towards (sin f, cos f).
    places = []
    for degrees in (-5.0, 5.0):
        slope, depth = math.tan(math.radians(degrees)), thickness * math.sqrt(2)
        within = math.asin(math.sin(math.radians(45 + degrees)) / 1.5)
        x = (20 - depth) / (1 - slope)
        y, along = x - 20 + depth, depth * math.tan(within)
        places.append((40 - (x + along + (8 - y - along) * slope)) / 60)
    seen = found.value.present[0]
    assert seen.sum() == 1
    ends = [float(found.value.start[0, seen][0]), float(found.value.end[0, seen][0])]
    np.testing.assert_allclose(ends, sorted(places), atol=1e-12)
