"""Other people's numbers: a failure here means that the library disagrees with the literature.

The cases, with their sources and tolerances, stand in ``tests/data/optics.json``. Every one runs
through the public functions, and through ``designopt trace`` on a file wherever one can express it.
"""

import json
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.cli import run
from designopt.io.toml_writing import format_toml
from optics import (
    Scene,
    ThinLens,
    find_coverage,
    find_outlines,
    find_views,
    parse_scene,
    trace_rays,
)
from optics.scene.scene import place
from optics.visibility.unfolding import paths_of, unfold_all
from tests.helpers import close, published_cases

CASES = published_cases("optics.json")
STILL = jnp.zeros((1, 0))


def camera(position: Sequence[float], direction: float, fov: float = 100, **more: Any) -> Any:
    """A camera's table; a pinhole of 1000 pixels unless told otherwise."""
    table = {"position": position, "direction_deg": direction, "fov_deg": fov, "pixels": 1000}
    return {**table, "projection": "pinhole", **more}


def part(start: Sequence[float], end: Sequence[float], name: str = "a", **more: Any) -> Any:
    return {"name": name, "from": list(start), "to": list(end), **more}


class Tracer:
    """``designopt trace`` on tables; its document."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self.capsys = folder, capsys

    def __call__(self, tables: Any, *arguments: str) -> Any:
        path = self.folder / "scene.toml"
        path.write_text(format_toml(tables), encoding="utf-8")
        self.capsys.readouterr()
        assert run(["trace", str(path), *arguments]) == 0
        return json.loads(self.capsys.readouterr().out)

    def followed(self, tables: Any, rays: Any, leg: int, bounces: int) -> list[Any]:
        """Where rays (x, y, degrees) are after a leg, by the public function and by the command.

        Each is places, unit vectors, and the surfaces that every ray has met.
        """
        scene, given = parse_scene(tables), jnp.asarray(rays, float)
        turns = jnp.deg2rad(given[:, 2])
        hits = trace_rays(scene, scene.pose(), given[:, :2], turns, bounces=bounces)
        names = {i: f"mirror:{part.name}" for i, part in enumerate(scene.layout.mirrors)}
        met = [tuple(names[i] for i in ray) for ray in hits.surface[:, : leg + 1].tolist()]
        asked = [f"--ray={','.join(map(repr, ray))}" for ray in np.asarray(rays).tolist()]
        document = self(tables, *asked, "--bounces", str(bounces))
        shown = [ray["hits"][: leg + 1] for ray in document["rays"]]
        places = [[ray[leg]["x"], ray[leg]["y"]] for ray in shown]
        angles = np.radians([ray[leg]["direction_deg"] for ray in shown])
        return [
            (np.asarray(hits.place[:, leg]), np.asarray(hits.direction[:, leg]), met),
            (
                np.array(places),
                np.stack([np.cos(angles), np.sin(angles)], axis=-1),
                [tuple(hit["element"] for hit in ray) for ray in shown],
            ),
        ]


@pytest.fixture
def trace(tmp_path, capsys):
    return Tracer(tmp_path, capsys)


def on_axis(places: np.ndarray, directions: np.ndarray, y: float = 0.0) -> np.ndarray:
    """x at which rays cross a line along x."""
    return places[:, 0] + (y - places[:, 1]) * directions[:, 0] / directions[:, 1]


@partial(jax.jit, static_argnames="bounces")
def virtual_cameras(scene: Scene, bounces: int) -> tuple[jax.Array, jax.Array]:
    """Where the camera's images are by all paths, and whether all mirrors face them."""
    placed = place(scene, scene.pose())
    paths = unfold_all(scene.layout, placed, paths_of(scene.layout, bounces))
    return placed.absolute(paths.source).stacked(), ~jnp.any(paths.turned_away, axis=-1)


def test_image_of_a_point_in_a_plane_mirror(trace):
    inputs, expected, tolerance = CASES["plane_mirror_image"]
    target = expected["path_length_to"]
    tables = {
        "camera": camera(inputs["point"], -45),
        "mirrors": [part(*inputs["mirror"])],
        "pads": [part(target, [8, 2])],
    }
    scene = parse_scene(tables)
    close(virtual_cameras(scene, 1)[0][1], expected["image"], tolerance)
    outlines = jax.jit(find_outlines, static_argnames="bounces")(scene, scene.pose(), bounces=1)
    close(outlines.distance[1, 0, 0], expected["path_length"], tolerance)
    (pose,) = trace(tables)["poses"]
    image = pose["virtual_cameras"]["mirror:a"]
    close(image, expected["image"], tolerance)
    close(math.dist(image, target), expected["path_length"], tolerance)


def corner(mirrors: Sequence[Sequence[Sequence[float]]]) -> Any:
    """Two mirrors, to follow rays in."""
    named = [part(*ends, name=name) for ends, name in zip(mirrors, "ab", strict=True)]
    return {"camera": camera([50, 50], 0), "mirrors": named}


def test_two_mirrors_at_90_degrees_send_every_ray_back(trace):
    inputs, expected, tolerance = CASES["retroreflector_90deg_2d"]
    assert expected["exit_direction"].startswith("-d")
    tables = corner(inputs["mirrors"])
    # From 6 mm away, half a mm beside the corner, on either side.
    degrees = np.repeat(np.linspace(5, 85, 9), 2)
    along, beside = np.radians(degrees), np.tile([0.5, -0.5], 9)
    x = 6 * np.cos(along) - beside * np.sin(along)
    y = 6 * np.sin(along) + beside * np.cos(along)
    rays = np.stack([x, y, degrees + 180], axis=-1)
    sent = -np.stack([np.cos(along), np.sin(along)], axis=-1)
    for _, directions, orders in trace.followed(tables, rays, leg=1, bounces=2):
        assert {*orders} == {("mirror:a", "mirror:b"), ("mirror:b", "mirror:a")}
        close(directions, -sent, tolerance)
        turned = np.arccos(-np.sum(directions * -sent, axis=-1).clip(-1, 1))
        close(np.degrees(turned), expected["deviation_deg"], 1e-5)  # the root of rounding


def test_two_mirrors_turn_every_ray_by_twice_their_angle(trace):
    inputs, _, tolerance = CASES["two_mirror_deviation"]
    for angle in inputs["mirror_angle_rad"]:
        end = [10 * math.cos(angle), 10 * math.sin(angle)]
        tables = corner([[[0, 0], [10, 0]], [[0, 0], end]])
        # Up from (1, 0) on the first mirror towards the second, coming from 0.1 mm away.
        up = np.linspace(angle + 0.2, np.pi - 0.1, 7)
        sent = np.stack([np.cos(up), -np.sin(up)], axis=-1)
        rays = np.concatenate([[1, 0] - 0.1 * sent, np.degrees(-up)[:, None]], axis=-1)
        cosine, sine = math.cos(2 * angle), math.sin(2 * angle)
        wanted = sent @ np.array([[cosine, sine], [-sine, cosine]])
        for _, directions, orders in trace.followed(tables, rays, leg=1, bounces=2):
            assert {*orders} == {("mirror:a", "mirror:b")}
            close(directions, wanted, tolerance)


@pytest.mark.parametrize("name", ["image_count_90deg", "image_count_60deg"])
def test_number_of_images_in_a_kaleidoscope(name, trace):
    inputs, expected, tolerance = CASES[name]
    assert tolerance == 0
    angle = math.radians(inputs["angle_deg"])
    radius, polar = inputs["object_polar"]
    seen = [radius * math.cos(math.radians(polar)), radius * math.sin(math.radians(polar))]
    end = [10 * math.cos(angle), 10 * math.sin(angle)]
    tables = {**corner([[[0, 0], [10, 0]], [[0, 0], end]]), "camera": camera(seen, 0)}
    bounces = 6  # as many as the last image takes; one number for all, as a program is for one
    positions, faces = map(np.asarray, virtual_cameras(parse_scene(tables), bounces))
    images = positions[1:][faces[1:]].tolist()
    (pose,) = trace(tables, "--bounces", str(bounces))["poses"]
    for found in (images, pose["virtual_cameras"].values()):
        # Odd and even numbers of reflections meet in the last image.
        assert len(np.unique(np.round(list(found), 9) + 0.0, axis=0)) == expected["images"]


def bowl(radius: float, half: float, **more: Any) -> Any:
    """A mirror with its vertex in the origin that opens towards +x, and nothing else."""
    shape = 1 + more.get("conic", 0)
    depth = half**2 / (radius + math.sqrt(radius**2 - shape * half**2))
    mirror = part([depth, half], [depth, -half], radius=radius, **more)
    return {"camera": camera([radius, 0], 180), "mirrors": [mirror]}


def test_a_parabola_gathers_parallel_rays_in_its_focus(trace):
    inputs, expected, tolerance = CASES["parabola_focus_gallery"]
    (x, low), (_, high) = inputs["rim"]
    vertex = inputs["vertex"]
    radius = ((high - low) / 2) ** 2 / (2 * (x - vertex[0]))
    mirror = part([x, high], [x, low], radius=radius, conic=-1)
    tables = {"camera": camera([390, 340], 180), "mirrors": [mirror]}
    rays = [[390, y, 180] for y in (245, 300, 339, 341, 390, 435, vertex[1])]
    for places, directions, _ in trace.followed(tables, rays, leg=0, bounces=1):
        focus = on_axis(places[:-1], directions[:-1], vertex[1])
        close(focus, expected["focus"][0], tolerance)
        close(places[-1], vertex, tolerance)
        close(focus - places[-1, 0], expected["focal_length"], tolerance)
    assert vertex[1] == expected["focus"][1]


def test_a_circle_gathers_rays_near_its_axis_at_half_its_radius(trace):
    inputs, expected, tolerance = CASES["circle_paraxial_focus"]
    tables = bowl(inputs["radius"], 40)
    rays = [[90, height, 180] for height in inputs["ray_height"]]
    wanted = expected["focal_distance_from_vertex"]
    for places, directions, _ in trace.followed(tables, rays, leg=0, bounces=1):
        # Relative, as the file's own verification error is: at a height h the focus is
        # nearer by (h / R)² R / 4, that is 2.5e-7 mm at the greater one.
        close(on_axis(places, directions) / wanted, 1, tolerance)


def test_the_mirror_equation(trace):
    inputs, expected, tolerance = CASES["mirror_equation"]
    distance, height = inputs["object_distance"], 1e-3
    tables = bowl(inputs["radius"], 10)
    to_vertex = math.degrees(math.atan2(-height, -distance))
    rays = [[distance, 0, 180 - 1e-3], [distance, height, to_vertex], [distance, height, 180]]
    for places, directions, _ in trace.followed(tables, rays, leg=0, bounces=1):
        close(on_axis(places[:1], directions[:1]), [expected["image_distance"]], tolerance)
        # Two rays from a point beside the axis meet in its image.
        slopes = directions[:, 1] / directions[:, 0]
        starts = places[:, 1] - slopes * places[:, 0]
        x = (starts[2] - starts[1]) / (slopes[1] - slopes[2])
        close(x, expected["image_distance"], tolerance)
        close((starts[1] + slopes[1] * x) / height, expected["magnification"], tolerance)


def with_lens(focal_length: float, focus: float, f_number: float = 2.8) -> Any:
    lens = {"focal_length": focal_length, "f_number": f_number, "focus": focus}
    return camera([0, 0], 0, lens=lens)


def lens_image(focal: float, distance: float, sharp: float) -> tuple[float, float]:
    """Image distance, and magnification on a sensor in the sharp image, real or virtual."""
    image = ThinLens(focal, 1.0, sharp).image(distance).value
    return 1 / float(image.vergence), float(image.magnification)


def test_a_thin_lens_images_two_focal_lengths_onto_two(trace):
    inputs, expected, tolerance = CASES["thin_lens_2f"]
    wanted = [expected["image_distance"], expected["magnification"]]
    close(lens_image(inputs["f"], inputs["s"], wanted[0]), wanted, tolerance)
    tables = {"camera": with_lens(inputs["f"], inputs["s"]), "blockers": [part([9, 0], [9, 1])]}
    lens = trace(tables)["lens"]
    close([lens["sensor_distance_mm"], lens["magnification"]], wanted, tolerance)


def test_a_thin_lens_magnifies_what_is_within_its_focal_length():
    """No sensor catches a virtual image, so no file has such a camera."""
    inputs, expected, tolerance = CASES["thin_lens_virtual"]
    wanted = [expected["image_distance"], expected["magnification"]]
    close(lens_image(inputs["f"], inputs["s"], wanted[0]), wanted, tolerance)


def test_blur_of_what_is_out_of_focus(trace):
    inputs, expected, tolerance = CASES["blur_circle"]
    focal, number, focus = inputs["f"], inputs["f_number"], inputs["focus"]
    lens = ThinLens(focal, focal / number, 1 / (1 / focal - 1 / focus))
    blur = lens.image(inputs["object"]).value.blur_diameter
    close(blur, expected["blur_diameter"], tolerance)
    pad = part([inputs["object"], 0], [inputs["object"], 5])
    document = trace({"camera": with_lens(focal, focus, number), "pads": [pad]})
    (blurs,) = document["poses"][0]["pads"]["a"]["views"]["direct"]["blur_px"]
    close(blurs[0] * document["lens"]["pixel_mm"], expected["blur_diameter"], tolerance)


def pixels(tables: Any, trace: Tracer) -> list[np.ndarray]:
    """Where the ends of the only pad are imaged: by the public function, and by the command."""
    scene = parse_scene(tables)
    views = find_views(scene, STILL, bounces=0).value
    (pose,) = trace(tables)["poses"]
    (shown,) = pose["pads"]["a"]["views"]["direct"]["pixels"]
    return [np.asarray(views.pixels[0, 0, 0]), np.asarray(shown)]


def test_pinhole_projection(trace):
    inputs, expected, tolerance = CASES["pinhole_projection"]
    center, focal = inputs["centre_px"], inputs["focal_px"]
    fov = math.degrees(2 * math.atan(center / focal))
    x, y = inputs["point"]
    # Looking along +y, pixels grow clockwise, with x.
    eye = camera([0, 0], 90, fov, pixels=2 * center)
    for found in pixels({"camera": eye, "pads": [part([x, y], [x + 5, y])]}, trace):
        close(found[0], expected["pixel"], tolerance)
    pixel = parse_scene({"camera": eye, "pads": [part([0, 1], [1, 1])]}).camera.pixel
    close(pixel(jnp.asarray(-math.atan2(x, y))), expected["pixel"], tolerance)


def test_fisheye_projection(trace):
    inputs, expected, tolerance = CASES["fisheye_equidistant"]
    half = 480
    fov = math.degrees(2 * half / inputs["focal_px"])
    eye = camera([0, 0], 90, fov, pixels=2 * half, projection="equidistant")
    at = np.radians([inputs["theta_deg"], 80])
    ends = 10 * np.stack([np.sin(at), np.cos(at)], axis=-1)
    wanted = np.array([expected["r_px"], expected["at_theta_80deg"]])
    tables = {"camera": eye, "pads": [part(*ends.tolist())]}
    for found in pixels(tables, trace):
        close(found - half, wanted, tolerance)
    close(parse_scene(tables).camera.pixel(jnp.asarray(-at)) - half, wanted, tolerance)


def test_half_a_height_of_mirror_shows_a_whole_body(trace):
    inputs, expected, tolerance = CASES["half_height_mirror"]
    x, low, high = inputs["mirror_x"], -1, 3
    tables = {
        "camera": camera(inputs["eye"], 0),
        "mirrors": [part([x, low], [x, high])],
        "pads": [part(*inputs["body"])],
    }
    views = find_views(parse_scene(tables), STILL, bounces=1).value
    assert np.asarray(views.present[0, 0]).tolist()[:2] == [True, False]
    (pose,) = trace(tables)["poses"]
    assert pose["pads"]["a"]["coverage"] == 1
    assert list(pose["mirrors"]["a"]) == ["used"]
    (used,) = pose["mirrors"]["a"]["used"]
    wanted = [expected["mirror_from_y"], expected["mirror_to_y"]]
    for span in (np.sort(np.asarray(views.spans[0, 0, 0, 0])), np.array(used)):
        heights = low + (high - low) * span
        close(heights, wanted, tolerance)
        close(heights[1] - heights[0], expected["length"], tolerance)


def test_a_wall_through_a_window_that_is_a_mirror(trace):
    inputs, expected, tolerance = CASES["mirror_window_on_wall"]
    y = inputs["wall_y"]
    tables = {
        "camera": camera(inputs["camera"], -90),
        "mirrors": [part(*inputs["mirror"])],
        "pads": [part([-5, y], [5, y])],
    }
    scene = parse_scene(tables)
    views = find_views(scene, STILL, bounces=1).value
    (pose,) = trace(tables)["poses"]
    (shown,) = pose["pads"]["a"]["views"]["mirror:a"]["intervals"]
    for ends in ([float(views.start[0, 0, 0]), float(views.end[0, 0, 0])], shown):
        close(-5 + 10 * np.array(ends), expected["seen_interval_x"], tolerance)
    for source in (virtual_cameras(scene, 1)[0][1], pose["virtual_cameras"]["mirror:a"]):
        close(source, expected["virtual_camera"], tolerance)


def test_shadow_of_an_occluder(trace):
    inputs, expected, tolerance = CASES["occluder_shadow"]
    (left, y), (right, _) = inputs["occluder"]

    def tables(wider: float) -> Any:
        return {
            "camera": camera(inputs["camera"], -90),
            "blockers": [part([left - wider, y], [right + wider, y])],
            "pads": [part(*inputs["pad"])],
        }

    def coverage(scene: Scene, wider: jax.Array) -> jax.Array:
        ends = scene.blockers + wider * jnp.array([[[-1.0, 0], [1, 0]]])
        scene = eqx.tree_at(lambda scene: scene.blockers, scene, ends)
        return find_coverage(scene, STILL[0], bounces=0).value[0]

    scene = parse_scene(tables(0.0))
    found, slope = jax.jit(jax.value_and_grad(coverage, argnums=1))(scene, jnp.zeros(()))
    close(found, expected["coverage"], tolerance)
    close(slope, expected["d_coverage_d_occluder_half_width"], tolerance)
    views = find_views(scene, STILL, bounces=0).value
    shown = [trace(tables(wider))["poses"][0]["pads"]["a"] for wider in (0.0, 0.5)]
    before, after = shown[0]["views"]["direct"]["intervals"]
    exact = [float(views.end[0, 0, 0]), float(views.start[0, 0, 1])]
    for hidden in (exact, [before[1], after[0]]):
        close(-5 + 10 * np.array(hidden), expected["hidden_interval_x"], tolerance)
    close(shown[0]["coverage"], expected["coverage"], tolerance)
    # Coverage is linear in the width.
    slope = (shown[1]["coverage"] - shown[0]["coverage"]) / 0.5
    close(slope, expected["d_coverage_d_occluder_half_width"], tolerance)


def test_no_case_is_left_out():
    text = Path(__file__).read_text(encoding="utf-8")
    assert [name for name in CASES if f'"{name}"' not in text] == []
