"""Corners of fingers out of the section, by rays that are followed forwards from their images."""

import dataclasses
import functools
import json
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import (
    Fabrication,
    Imaging,
    find_corners,
    find_outline_edges,
    find_outlines,
    parse_scene,
    perturb,
)
from optics.scene.scene import Scene
from optics.scene.writer import scene_tables
from optics.visibility.corners_in_space import (
    SIDES,
    find_corners_in_space,
    find_places_in_space,
    find_sides_in_space,
)
from optics.visibility.outlines import CORNERS
from tests.helpers import check_gradients
from tests.optics.extruded import POSES, WORDS, finger, looked
from tests.optics.scenes import posed

EXACT = 1e-8
"""mm, of ways of some 50 mm in double precision."""

WIDTH, ROWS = 20.0, 1080

PLATE = {"thickness": 3.0, "index": {"red": 1.489, "green": 1.494, "blue": 1.5}}

KINDS: dict[str, dict[str, Any]] = {
    "air": {},
    "black": {"layers": [PLATE]},
    "overhanging": {
        "layers": [PLATE | {"overhang": 1.0}, {"thickness": 2.0, "index": 1.41, "overhang": 0.5}]
    },
    "clear": {"layers": [PLATE | {"sides": "clear"}]},
    "bezel": {"layers": [PLATE | {"overhang": 1}], "bezel": {"lip": [1.5, 1], "height": 0.8}},
}

VIEWS = (((), 0), ((), 1), ((), 2), ((0,), 2), ((1,), 0))
"""Mirrors along the path, and the pad."""

GREEN, BLUE = 1, 2

SHIFT = [0.7, 0.05]


def tables_of(kind: str) -> dict[str, Any]:
    tables = json.loads(json.dumps(scene_tables(finger())))
    tables["pads"] = [pad | KINDS[kind] | {"width": WIDTH} for pad in tables["pads"]]
    return tables


@functools.cache
def made(kind: str, slides: bool = True) -> tuple[Scene, Fabrication]:
    """A finger with errors of all kinds, large ones; and these."""
    tables = tables_of(kind)
    if slides:
        tables["camera"]["pupil_shift"] = SHIFT
    scene = parse_scene(tables, "finger")
    mirrors, pads = len(scene.mirrors), len(scene.pads)
    layers = None if scene.layers is None else scene.layers.thickness.shape
    draw = np.random.default_rng(5).normal
    errors = Fabrication(
        camera=draw(0, 0.3, 2),
        lateral=draw(0, 0.5),
        tilt=draw(0, 0.03),
        mirror_tilt=draw(0, 0.02, mirrors),
        mirror_offset=draw(0, 0.3, mirrors),
        pad_tilt=draw(0, 0.01, pads),
        pad_offset=draw(0, 0.1, pads),
        pad_shift=draw(0, 0.1, pads),
        yaw=0.03,
        roll=-0.02,
        mirror_lean=draw(0, 0.02, mirrors),
        mirror_bow=np.array([0.15, -0.2]) if slides else None,
        pad_lean=draw(0, 0.02, pads),
        thickness=None if layers is None else draw(0, 0.1, layers),
        index=None if layers is None else draw(0, 0.01, layers),
        pupil=0.1 if slides else None,
    )
    return perturb(scene, errors), errors


@functools.cache
def compiled(kind: str, slides: bool, channel: int) -> Any:
    scene, errors = made(kind, slides)

    def corners(pose: jax.Array) -> jax.Array:
        imaging = Imaging.of(scene.camera)
        return find_corners_in_space(scene, pose, errors, imaging, WIDTH, VIEWS, channel=channel)

    return jax.jit(jax.vmap(corners))


def bare(scene: Scene) -> Scene:
    layout = dataclasses.replace(scene.layout, layers=(), bezels=())
    return dataclasses.replace(scene, layers=None, layout=layout)


def turned(one: np.ndarray, other: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    c, s = np.cos(angle), np.sin(angle)
    return c * one + s * other, c * other - s * one


def in_space(place: complex) -> np.ndarray:
    return np.array([place.real, place.imag, 0.0])


def refracted(way: np.ndarray, normal: np.ndarray, before: float, after: float) -> np.ndarray:
    """Snell's law for unit vectors; the normal points against the way."""
    cosine, ratio = -way @ normal, before / after
    inside = np.sqrt(1 - ratio**2 * (1 - cosine**2))
    return ratio * way + (ratio * cosine - inside) * normal


def number(error: Any, *entry: int) -> float:
    """An error that a finger has, or 0."""
    return 0.0 if error is None else float(np.asarray(error)[entry])


Z = np.array([0.0, 0.0, 1.0])


def followed(
    scene: Scene, errors: Fabrication, pose: np.ndarray, view: Any, place: np.ndarray, channel: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """From a place in the image: coordinates (along, across) at the levels, size of the membrane.

    ``None`` if the ray comes to the pad from behind.
    """
    section, (word, pad) = posed(bare(scene), pose), view
    camera, shift = scene.camera, scene.camera.pupil_shift
    axis = in_space(np.exp(1j * section.direction))
    up = np.cross(Z, axis)
    axis, across = turned(axis, Z, number(errors.yaw))
    up, across = turned(up, across, number(errors.roll))
    angle, slope = looked(place, float(camera.field_of_view) / 2, ROWS, ROWS * 4 // 3)
    way = np.cos(angle) * axis + np.sin(angle) * up + slope * across
    way /= np.linalg.norm(way)
    at = in_space(section.position) + float(errors.lateral) * Z
    if shift is not None:
        theta = np.arccos(way @ axis)
        at = at + (float(shift[0]) * theta**2 + float(shift[1]) * theta**4) * axis
    for mirror in word:
        first, last = section.ends[mirror]
        middle, half = in_space((first + last) / 2), abs(last - first) / 2
        along = in_space((last - first) / (2 * half))
        normal, _ = turned(np.cross(Z, along), Z, number(errors.mirror_lean, mirror))
        bow = number(errors.mirror_bow, mirror)
        u, v = ((at - middle) @ along, (at - middle) @ normal)
        du, dv = way @ along, way @ normal
        # v + t dv = bow (1 − ((u + t du) / half)²): the root nearest to that of the chord.
        square = bow * du**2 / half**2
        roots = np.roots([square, dv + 2 * bow * u * du / half**2, v - bow * (1 - u**2 / half**2)])
        time = roots[np.argmin(np.abs(roots + v / dv))].real
        at = at + time * way
        normal = normal + 2 * bow * (u + time * du) / half**2 * along
        normal /= np.linalg.norm(normal)
        way = way - 2 * (way @ normal) * normal
    first, last = section.ends[len(scene.mirrors) + pad]
    along = in_space((last - first) / abs(last - first))
    side = scene.layout.pads[pad].side
    left, across = turned(np.cross(Z, along), Z, number(errors.pad_lean, pad))
    normal, start = side * left, in_space(first)
    thickness = [] if scene.layers is None else np.asarray(scene.layers.thickness[pad])
    index = [
        1.0,
        *([] if scene.layers is None else np.asarray(scene.layers.index[pad, :, channel])),
    ]
    levels = np.append(np.cumsum(thickness[::-1])[::-1], 0.0)
    above = (at - start) @ normal - levels[0]
    if above < 0 or way @ normal > 0:
        return None
    met = []
    for layer, level in enumerate(levels):
        at = at + way * ((level - (at - start) @ normal) / (way @ normal))
        met.append([(at - start) @ along, (at - start) @ across])
        if level:
            way = refracted(way, normal, index[layer], index[layer + 1])
    return np.array(met), np.array([abs(last - first), WIDTH])


@pytest.mark.parametrize("slides", [True, False], ids=["sliding", "still"])
@pytest.mark.parametrize("kind", ["air", "black"])
def test_rays_through_imaged_corners_meet_the_corners(kind, slides):
    # Layers that end with the membrane: a corner is the membrane's, or the outermost surface's on a
    # side that hides the membrane's edge.
    for channel in (GREEN, BLUE) if kind == "black" and slides else (GREEN,):
        found = np.asarray(compiled(kind, slides, channel)(jnp.asarray(POSES)))
        assert np.isfinite(found).all()
        compared = 0
        for pose, view, corner in np.ndindex(len(POSES), len(VIEWS), 4):
            place = found[pose, view, corner]
            rays = followed(*made(kind, slides), POSES[pose], VIEWS[view], place, channel)
            if rays is not None:
                (met, size), (end, side) = rays, CORNERS[corner]
                room = np.array([2 * end - 1, side]) * (np.array([end, side / 2]) * size - met)
                np.testing.assert_allclose(room.min(axis=0), 0, atol=EXACT)
                compared += 1
        assert compared > 60


@pytest.mark.parametrize("kind", ["air", "black"])
def test_rays_through_imaged_places_meet_the_places(kind):
    scene, errors = made(kind)
    flat = np.array([[4.0, -6.0, 0.0], [12.0, 0.5, 0.0], [19.0, 7.0, 0.0]])
    heights = np.array([0.0, 0.2, 0.4])
    lifted = np.concatenate([flat + np.array([0, 0, height]) for height in heights])
    given = jnp.broadcast_to(jnp.asarray(lifted), (len(VIEWS), *lifted.shape))
    compared = 0
    for pose in POSES[:3]:
        found = np.asarray(
            find_places_in_space(
                scene, jnp.asarray(pose), errors, Imaging.of(scene.camera), WIDTH, VIEWS, given
            )
        ).reshape(len(VIEWS), len(heights), len(flat), 2)
        for view, place in np.ndindex(len(VIEWS), len(flat)):
            rays = [followed(scene, errors, pose, VIEWS[view], one, GREEN)
                    for one in found[view, :, place]]  # fmt: skip
            if None in rays:
                continue
            on, first, second = (one[0][-1] for one in rays if one is not None)
            np.testing.assert_allclose(on, flat[place, :2], atol=EXACT)
            # Rays to lifted places go on straight to the membrane.
            apart = float(np.linalg.norm(second - on))
            np.testing.assert_allclose(first, (on + second) / 2, atol=1e-3 + 0.05 * apart**2)
            compared += 1
    assert compared > 15


@pytest.mark.parametrize("kind", list(KINDS))
def test_without_errors_corners_are_those_of_the_section(kind):
    # Those of the membrane, or of the outline that levels bound in the section.
    tables = tables_of(kind)
    scene = parse_scene(tables, "finger")
    imaging, none = Imaging.of(scene.camera), Fabrication.none(scene.layout)
    names, pose = list(WORDS.values()), jnp.asarray(POSES[1])
    views = tuple((word, pad) for word in names for pad in range(3))
    found = jax.jit(find_corners_in_space, static_argnames="views")(
        scene, pose, none, imaging, WIDTH, views
    ).reshape(len(names), 3, 4, 2)
    if kind == "air":
        wanted = jax.jit(find_corners)(imaging, find_outlines(scene, pose), WIDTH)
    elif kind == "clear":
        # Seen from within, all walls mirror: the surface's own corners, as those of a bare pad.
        lines = [[pad[key] for key in ("from", "to")] for pad in tables["pads"]]
        up = np.array([0, tables["pads"][0]["layers"][0]["thickness"]])
        raised = [
            pad | {"from": one[0] + up, "to": one[1] + up}
            for pad, one in zip(tables["pads"], np.array(lines), strict=True)
        ]
        bare = [{k: v for k, v in pad.items() if k != "layers"} for pad in raised]
        top = parse_scene(json.loads(json.dumps(tables | {"pads": bare}, default=list)), "top")
        wanted = jax.jit(find_corners)(imaging, find_outlines(top, pose), WIDTH)
        found, wanted = found[0, 1], wanted[0, 1]
    else:
        edges = jax.jit(find_outline_edges)(scene, pose)
        wanted = edges.places(imaging)[..., 0, :]
        assert np.asarray(edges.present).all()
    np.testing.assert_allclose(found, wanted, atol=EXACT)


@pytest.mark.parametrize("kind", ["air", "black"])
def test_places_along_sides_lie_on_the_edges(kind):
    scene, errors = made(kind)
    shares, view = np.linspace(0, 1, 5), ((1,), 0)
    given = jnp.asarray(POSES[2]), errors, Imaging.of(scene.camera), WIDTH, (view,)
    places = np.asarray(find_sides_in_space(scene, *given, shares))[0]
    corners = np.asarray(find_corners_in_space(scene, *given))[0]
    # The line across a side is a place on the membrane for mirrors that are flat.
    near = EXACT if kind == "air" else 0.1
    np.testing.assert_allclose(places[:, 0], corners, atol=near)
    np.testing.assert_allclose(places[:, -1], np.roll(corners, -1, axis=0), atol=near)
    for side, point in np.ndindex(4, len(shares)):
        rays = followed(scene, errors, POSES[2], view, places[side, point], GREEN)
        assert rays is not None
        met, size = rays
        (axis, end), middle = SIDES[side], np.array([0.5, 0.0]) * size
        room = size[axis] / 2 - (2 * end - 1) * (met[:, axis] - middle[axis])
        assert abs(room.min()) < EXACT


def test_colors_are_imaged_at_their_own_scale():
    scene, errors = made("air")
    colored = dataclasses.replace(errors, lateral_color=np.array([-1e-3, 2e-3]))
    imaging = Imaging.of(scene.camera)
    find = jax.jit(find_corners_in_space, static_argnames=("views", "channel"))
    given = jnp.asarray(POSES[1]), colored, imaging, WIDTH, VIEWS
    red, green, blue = (np.asarray(find(scene, *given, channel=i)) for i in range(3))
    middle = np.array([1440, 1080]) / 2 - 0.5
    np.testing.assert_allclose(red - middle, (1 - 1e-3) * (green - middle), rtol=1e-12)
    np.testing.assert_allclose(blue - middle, (1 + 2e-3) * (green - middle), rtol=1e-12)


@pytest.mark.parametrize("kind", ["air", "black"])
def test_derivatives_by_errors_and_pose(kind):
    scene, errors = made(kind)
    weights = np.random.default_rng(0).uniform(-1, 1, (len(VIEWS), 4, 2)) / 1000
    scalars = ["lateral", "yaw", "roll"]
    arrays = ["mirror_lean", "mirror_bow", "pad_lean"]

    def weighed(design: list[jax.Array]) -> jax.Array:
        pip, dip, *numbers = design
        own = dict(zip(scalars + arrays, numbers, strict=True))
        own |= {name: getattr(errors, name).at[0].set(own[name]) for name in arrays}
        turned = dataclasses.replace(errors, **own)
        given = jnp.stack([pip, dip]), turned, Imaging.of(scene.camera), WIDTH, VIEWS
        return jnp.sum(weights * find_corners_in_space(scene, *given))

    rows = [[*pose, 0.4, 0.03, -0.02, 0.01, 0.1, -0.02] for pose in POSES[[1, 4]]]
    check_gradients(weighed, [*jnp.array(rows).T], rtol=1e-7, atol=1e-7)


def test_mirrors_with_layers_are_refused():
    tables = tables_of("air")
    sheet = {"layers": [{"thickness": 1.0, "index": 1.5}]}
    tables["mirrors"] = [mirror | sheet for mirror in tables["mirrors"]]
    scene = parse_scene(tables, "finger")
    none, imaging = Fabrication.none(scene.layout), Imaging.of(scene.camera)
    with pytest.raises(ValueError, match="flat mirrors without layers"):
        find_corners_in_space(scene, jnp.zeros(2), none, imaging, WIDTH, VIEWS)
