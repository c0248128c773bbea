"""Images of fingers with errors out of the section, with layers, and with a moving pupil.

Against rays that are followed one by one, and against outlines found as they are imaged.
"""

import functools
import importlib.util
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import Fabrication, Imaging, parse_scene, perturb
from optics.rendering import Effects, Renderer, TactileImage
from optics.rendering.plates import meet_bare, plates_of
from optics.rendering.ways import Rays, legs_of, one_of
from optics.scene.scene import Scene, place
from optics.visibility.corners_in_space import (
    SpatialCamera,
    SpatialMirror,
    SpatialPad,
    find_sides_in_space,
)
from studies.oracles.judge.lens import Lens
from studies.oracles.judge.solids import motion_of
from studies.oracles.judge.tracing import Tracer, path_of
from tests.optics.extruded import POSES, looked
from tests.optics.rendering.test_renderer import alike
from tests.optics.scenes import posed
from tests.optics.test_corners_in_space import (
    GREEN,
    PLATE,
    VIEWS,
    WIDTH,
    Z,
    bare,
    followed,
    in_space,
    made,
    tables_of,
    turned,
)  # fmt: skip

EXACT = 5e-4
"""mm: rounding in float32 of rays of some 50 mm, and of the table of the lens."""

POSE = POSES[1]

ROWS = 240


@functools.cache
def arranged(kind: str, slides: bool) -> tuple[Any, ...]:
    """Camera, mirrors and pads in space, and what is above the membranes."""
    scene, errors = made(kind, slides)
    plain = bare(scene)
    placed = place(plain, jnp.asarray(POSE))
    body = SpatialPad.all_of(plain, placed, errors, jnp.asarray(WIDTH), GREEN)
    camera = SpatialCamera.of(plain, placed, errors)
    mirrors = SpatialMirror.all_of(plain.layout, placed, errors)
    return scene, errors, *jax.tree.map(np.asarray, (camera, mirrors, body))


@pytest.mark.parametrize("slides", [True, False], ids=["sliding", "still"])
@pytest.mark.parametrize("kind", ["air", "black"])
@pytest.mark.parametrize("view", VIEWS, ids=str)
def test_rays_of_pixels_reach_membranes_where_each_is_followed_to(kind, slides, view):
    scene, errors, camera, mirrors, bodies = arranged(kind, slides)
    word, pad = view
    body, rays = one_of(bodies, pad), Rays.of(Imaging.of(scene.camera))
    last = legs_of(camera, rays, mirrors, word)[-1]
    at = last.within(np.asarray(body.start), np.stack([body.along, body.across, body.normal]))
    plates = plates_of(scene, WIDTH)[pad]
    found = meet_bare(*at) if plates is None else plates.meet(*at)
    near = np.abs(found.along - body.size[0] / 2) < body.size[0] / 2 + 2
    near &= found.there & (np.abs(found.across) < WIDTH / 2 + 2)
    assert near.sum() > 500
    rows, columns = np.nonzero(near)
    for i in np.random.default_rng(0).integers(len(rows), size=40):
        at = rows[i], columns[i]
        traced = followed(scene, errors, POSE, view, np.array([columns[i], rows[i]]), GREEN)
        assert traced is not None
        met, _ = traced
        np.testing.assert_allclose([found.along[at], found.across[at]], met[-1], atol=EXACT)


@functools.cache
def pictured(kind: str, index: int = 1) -> TactileImage:
    scene, errors = designed(kind)
    return Renderer(scene, WIDTH, Effects(), errors=errors).render(POSES[index])


@functools.cache
def designed(kind: str) -> tuple[Scene, Fabrication]:
    """A finger as designed, and its errors."""
    tables, slides = tables_of(kind), kind == "air"
    if slides:
        tables["camera"]["pupil_shift"] = [0.7, 0.05]
    bow = np.array([0.15, -0.2])
    return parse_scene(tables, "finger"), replace(made(kind, slides)[1], mirror_bow=bow)


SHARES = np.linspace(0.1, 0.9, 9)

NEAR = 0.1
"""px: between edges of light and sides that are found."""


def light_along(image: TactileImage, places: np.ndarray) -> np.ndarray:
    """Light at places, between pixels."""
    light = image.pixels.astype(float).sum(axis=-1)
    column, row = np.floor(places).astype(int).T
    u, v = (places - np.floor(places)).T
    upper = (1 - u) * light[row, column] + u * light[row, column + 1]
    lower = (1 - u) * light[row + 1, column] + u * light[row + 1, column + 1]
    return (1 - v) * upper + v * lower


@pytest.mark.parametrize("kind", ["air", "overhanging", "clear"])
def test_sides_of_whole_views_are_imaged_where_they_are_found(kind):
    scene, errors = designed(kind)
    own, image = perturb(scene, errors), pictured(kind)
    off = []
    for view in image.views:
        if not view.complete or view.at_border:
            continue
        names = [mirror.name for mirror in scene.layout.mirrors]
        path = view.path.partition(":")[2]
        word = tuple(names.index(name) for name in path.split("+") if name)
        pad = [pad.name for pad in scene.layout.pads].index(view.pad)
        given = jnp.asarray(POSE), errors, Imaging.of(own.camera), WIDTH, ((word, pad),)
        sides = np.asarray(find_sides_in_space(own, *given, SHARES))[0]
        corners = view.corners
        middle = corners.mean(axis=0)
        for side in sides:
            along = side[-1] - side[0]
            normal = np.array([along[1], -along[0]]) / np.hypot(*along)
            normal *= np.sign((side[4] - middle) @ normal)
            steps = np.arange(-2, 2, 0.05) + 0.025
            for point in side:
                # What an edge leaves of a line across it, in parts of the light inside.
                light = light_along(image, point + steps[:, None] * normal)
                off.append(0.05 * light.sum() / light[:8].mean() - 2)
    assert len(off) >= 36
    assert np.abs(off).max() < NEAR
    assert abs(np.mean(off)) < NEAR / 5


def small(layer: dict[str, Any], effects: Effects) -> TactileImage:
    """The straight finger with one layer on every pad."""
    tables = tables_of("black")
    tables["camera"]["pixels"] = ROWS
    tables["pads"] = [pad | {"layers": [PLATE | {"index": 1.5} | layer]} for pad in tables["pads"]]
    return Renderer(parse_scene(tables, "finger"), WIDTH, effects).render(POSES[0])


def row_of(image: TactileImage, pad: str) -> tuple[np.ndarray, np.ndarray]:
    """Light and labels along the row through the middle of a pad's direct view."""
    view = image.view(pad, "direct")
    assert view is not None
    row = round(float(view.corners[:, 1].mean()))
    return image.pixels[row].astype(int), image.labels[row] == 1 + image.views.index(view)


def test_lamps_in_walls_are_saturated_strips_beside_the_membrane():
    lamp, dark = (
        small({"sides": {"beside": kind}}, Effects(lamps=4.0)) for kind in ("lamp", "black")
    )
    light, own = row_of(lamp, "intermediate")
    without, _ = row_of(dark, "intermediate")
    np.testing.assert_array_equal(light[own][2:-2], without[own][2:-2])
    columns = np.flatnonzero(own)
    for beside in (
        light[columns[0] - 4 : columns[0] - 1],
        light[columns[-1] + 2 : columns[-1] + 5],
    ):
        assert (beside.max(axis=-1) == 255).any()
    assert not without[: columns[0] - 1].any()


def test_clear_walls_show_the_membrane_without_a_seam_and_twice():
    clear, dark = (small({"sides": sides}, Effects()) for sides in ("clear", "black"))
    light, own = row_of(clear, "intermediate")
    _, narrower = row_of(dark, "intermediate")
    assert own.sum() >= narrower.sum() + 8
    inside = light[np.flatnonzero(own)[1:-1]]
    assert np.ptp(inside, axis=0).max() < 0.05 * inside.max()  # as Fresnel has it


def test_colors_are_shown_at_their_own_scale():
    scene = parse_scene(tables_of("air"), "finger")
    errors = replace(Fabrication.none(scene.layout), lateral_color=np.array([-2e-3, 3e-3]))
    plain, colored = (
        Renderer(scene, WIDTH, Effects(), errors=one).render(POSES[0]).pixels.astype(float)
        for one in (None, errors)
    )

    def spread(pixels: np.ndarray, channel: int) -> float:
        rows = np.arange(1080) - 539.5
        light = pixels[..., channel].sum(axis=1)
        return float((rows**2 * light).sum() / light.sum())

    np.testing.assert_array_equal(plain[..., 1], colored[..., 1])
    for channel, scale in ((0, 1 - 2e-3), (2, 1 + 3e-3)):
        grown = np.sqrt(spread(colored, channel) / spread(plain, channel))
        assert grown == pytest.approx(scale, abs=1e-4)


def test_whole_views_of_layered_pads_end_where_these_do():
    whole = {view.pad for view in small({}, Effects()).views if view.complete}
    assert whole == {"proximal", "intermediate", "distal"}
    through_ends = small({"sides": {"from": "clear", "to": "clear"}}, Effects())
    # The camera looks at clear ends of the outer pads from outside: these have no corners.
    assert [view.pad for view in through_ends.views if view.complete] == ["intermediate"]


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="Mitsuba is not there")
@pytest.mark.parametrize("kind", ["overhanging", "bezel"])
def test_every_pixel_shows_the_membrane_that_the_judge_reaches(kind):
    tables = tables_of(kind)
    tables["camera"]["pixels"] = ROWS
    scene = parse_scene(tables, "finger")
    renderer = Renderer(scene, WIDTH, Effects())
    names = [pad.name for pad in scene.layout.pads]
    compared = 0
    for pose in POSES:
        degrees = dict(zip(scene.angle_names, np.degrees(pose).tolist(), strict=True))
        lens = Lens.of(tables["camera"], motion_of(tables, degrees), 4 / 3)
        places = np.stack(np.meshgrid(np.arange(lens.columns), np.arange(ROWS)), axis=-1)
        tracer = Tracer(tables, degrees, lens.position)
        traced = tracer.trace(lens.rays(places.reshape(-1, 2)))
        image = renderer.render(pose)
        wanted = np.zeros(image.labels.shape, int)
        for label, view in enumerate(image.views, 1):
            here = traced.reached & (traced.pad == names.index(view.pad))
            paths = {w: path_of(tables, w) for w in np.unique(traced.word).tolist()}
            own = [w for w, path in paths.items() if path == view.path.partition(":")[2]]
            wanted[(here & np.isin(traced.word, own)).reshape(wanted.shape)] = label
        # Apart from outlines.
        clear = alike(wanted) & alike(image.labels)
        np.testing.assert_array_equal(image.labels[clear], wanted[clear])
        compared += (wanted[clear] > 0).sum()
        reached = alike(traced.reached.reshape(wanted.shape).astype(int)) & clear
        np.testing.assert_array_equal(
            traced.reached.reshape(wanted.shape)[reached], image.labels[reached] > 0
        )
    assert compared > 20_000


def nearest_hits(scene: Scene, errors: Fabrication, pose: np.ndarray) -> np.ndarray:
    """What the ray of each pixel meets first, over one mirror at most: 1 + pad + 10 · path, or 0.

    All surfaces go on across the section; mirrors lean and bow, and pads lean.
    """
    section, layout, camera = posed(scene, pose), scene.layout, scene.camera
    mirrors, pads = len(layout.mirrors), len(layout.pads)
    yaw, roll, mirror_lean, mirror_bow, pad_lean, shift = (
        np.asarray(part, float)
        for part in (
            errors.yaw, errors.roll, errors.mirror_lean, errors.mirror_bow, errors.pad_lean,
            camera.pupil_shift,
        )
    )  # fmt: skip
    places = np.stack(np.meshgrid(np.arange(ROWS * 4 // 3), np.arange(ROWS)), -1).reshape(-1, 2)
    axis = in_space(np.exp(1j * section.direction))
    up = np.cross(Z, axis)
    axis, across = turned(axis, Z, float(yaw))
    up, across = turned(up, across, float(roll))
    seen = looked(places.astype(float), float(camera.field_of_view) / 2, ROWS, ROWS * 4 // 3)
    angle, slope = seen[..., :1], seen[..., 1:]
    way = np.cos(angle) * axis + np.sin(angle) * up + slope * across
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    theta = np.arccos(np.clip(way @ axis, -1, 1))[:, None]
    at = in_space(section.position) + float(errors.lateral) * Z
    at = at + (shift[0] * theta**2 + shift[1] * theta**4) * axis
    label, path, live = np.zeros(len(way), int), np.zeros(len(way), int), np.ones(len(way), bool)
    for leg in range(2):
        best, met = np.full(len(way), np.inf), np.full(len(way), -1)
        normals, beside = np.zeros_like(way), np.zeros(len(way))
        for surface, (first, last) in enumerate(section.ends):
            middle, half = in_space((first + last) / 2), abs(last - first) / 2
            along = in_space((last - first) / (2 * half))
            lean = bow = 0.0
            if surface < mirrors:
                lean, bow = float(mirror_lean[surface]), float(mirror_bow[surface])
            elif surface < mirrors + pads:
                lean = float(pad_lean[surface - mirrors])
            normal, side = turned(np.cross(Z, along), Z, lean)
            u, v, du, dv = (a @ b for a in (at - middle, way) for b in (along, normal))
            time = -v / dv
            for _ in range(5):  # Newton's method from where the ray meets the chord
                height = v + time * dv - bow * (1 - ((u + time * du) / half) ** 2)
                time = time - height / (dv + 2 * bow * (u + time * du) * du / half**2)
            place = u + time * du
            here = (time > 1e-6) & (np.abs(place) <= half) & (time < best)
            one_way = layout.one_way[surface] and layout.sides[surface] != 0
            if one_way:
                here &= np.sign(-dv) == layout.sides[surface]
            best, met = np.where(here, time, best), np.where(here, surface, met)
            bent = normal + (2 * bow * place / half**2)[:, None] * along
            bent /= np.linalg.norm(bent, axis=1, keepdims=True)
            normals = np.where(here[:, None], bent, normals)
            beside = np.where(here, (at + time[:, None] * way - middle) @ side, beside)
        toward = np.sum(normals * way, axis=1)
        sides = layout.sides[met]
        front = (sides == 0) | (np.sign(-toward) == sides)
        pad = met - mirrors
        sensed = live & (pad >= 0) & (pad < pads) & front & (np.abs(beside) <= WIDTH / 2)
        label[sensed] = 1 + pad[sensed] + 10 * path[sensed]
        live &= (met >= 0) & (met < mirrors) & front
        path[live] = 1 + met[live]
        at = at + np.where(np.isfinite(best), best, 0)[:, None] * way
        way = way - 2 * toward[:, None] * normals
        if leg == 0:
            at = at + 1e-5 * way
    return label.reshape(ROWS, -1)


def test_edges_of_what_hides_pads_are_where_rays_in_space_pass_them():
    scene, errors = made("air", True)
    tables = tables_of("air")
    tables["camera"] |= {"pupil_shift": [0.7, 0.05], "pixels": ROWS}
    names = [pad.name for pad in scene.layout.pads]
    paths = ["direct", *(f"mirror:{mirror.name}" for mirror in scene.layout.mirrors)]
    renderer = Renderer(parse_scene(tables, "finger"), WIDTH, Effects(), errors=errors)
    differ = seen = 0
    for pose in POSES:
        image, wanted = renderer.render(pose), nearest_hits(scene, errors, pose)
        found = np.zeros_like(wanted)
        for label, view in enumerate(image.views, 1):
            code = 1 + names.index(view.pad) + 10 * paths.index(view.path)
            found[image.labels == label] = code
        clear = alike(wanted)
        differ += (found != wanted)[clear].sum()
        seen += (wanted > 0).sum()
    # What is of second order moves an edge by a pixel in places.
    assert seen > 40_000
    assert differ < 10
