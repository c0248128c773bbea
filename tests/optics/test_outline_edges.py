"""Whole outlines behind layers, and second images in clear walls, beside brute-force rays."""

import itertools
import json
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.path import Path as PolygonPath

from designopt.cli import run
from optics import (
    Imaging,
    Scene,
    clear_walls,
    find_coverage,
    find_outline_edges,
    find_second_images,
    find_second_outlines,
    format_scene,
    name_bound,
    parse_scene,
    read_scene,
)
from optics.visibility.boundary_codes import FIRST_PAD_END, SECOND_PAD_END
from optics.visibility.outline_edges import EDGES
from studies.oracles.layer_box import WALLS, Setting, edges, follow, random_setting
from tests.helpers import SCENES
from tests.optics.test_layers import GEL, NO_ANGLES, check_slopes

NEAR = 1e-9
"""Of a pad: how far an outline may lie from where rays find it."""


class Placed:
    """A setting somewhere in the section, as a scene with a mirror, and its rays.

    The pad is seen from the camera directly, and over the mirror from the setting's camera: it
    lies in the middle between both, at right angles to their line.
    """

    def __init__(self, setting: Setting, rng: np.random.Generator, structure: int) -> None:
        self.setting = setting
        side = (1, -1)[structure % 2]
        self.along = np.exp(2j * np.pi * rng.uniform())
        self.up = 1j * side * self.along
        self.start = complex(*rng.uniform(-50, 50, 2))
        image = self.at(setting.camera[[0, 2]])
        self.camera = image + self.up * rng.uniform(5, 40) + self.along * rng.uniform(-40, 40)
        self.axis = np.exp(2j * np.pi * rng.uniform())
        line = (self.camera - image) / abs(self.camera - image) * 1j
        middle = (self.camera + image) / 2
        self.fold = line / np.conj(line)
        length = setting.block.length
        put = {"from": pair(self.start), "to": pair(self.start + length * self.along)}
        ends = {"from": pair(middle - 100 * line), "to": pair(middle + 100 * line)}
        self.tables = {
            "scene": {"bounces": 1},
            "camera": {
                "position": pair(self.camera),
                "direction_deg": math.degrees(np.angle(self.axis)),
                "fov_deg": 300.0,
                "pixels": 1000,
            },
            "mirrors": [{"name": "m", **ends}],
            "pads": [{"name": "p", "side": "left" if side > 0 else "right", **put, **setting.pad}],
        }

    def at(self, place) -> complex:
        return self.start + self.along * place[0] + self.up * place[1]

    def eye(self, path: int) -> np.ndarray:
        """The camera or its image in the pad's own axes."""
        toward = (self.camera - self.start) / self.along
        here = np.array([toward.real, self.setting.camera[1], abs(toward.imag)])
        return self.setting.camera if path else here

    def slopes(self, path: int, angle: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Along and across per height of rays in the pad's own axes."""
        ray = self.axis * np.exp(1j * angle)
        ray = (self.fold * np.conj(ray) if path else ray) / self.along
        down = -ray.imag * np.sign((self.up / self.along).imag)
        return np.stack([ray.real / down, slope / down], axis=-1)


def pair(place: complex) -> list[float]:
    return [float(place.real), float(place.imag)]


def settings(structure: int, count: int) -> tuple[list[Placed], Scene, jax.Array]:
    rng = np.random.default_rng([structure, 11])
    placed = [Placed(random_setting(rng, structure), rng, structure) for _ in range(count)]
    scenes = [parse_scene(one.tables) for one in placed]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *scenes)
    return placed, stacked, jnp.array([one.setting.camera[1] for one in placed])


def within(slopes: np.ndarray) -> np.ndarray:
    """From the points of an outline, which may be a bent strip, a little into it."""
    inward = (slopes[[2, 3, 0, 1], ::-1] - slopes) / 2
    before, after = np.roll(slopes[:, -2], 1, axis=0), slopes[:, 1]
    inward[:, 0] = (before + after) / 2 - slopes[:, 0]
    inward[:, -1] = np.roll(inward[:, 0], -1, axis=0)
    return slopes + 1e-3 * inward


def check_inside(placed: Placed, path: int, slopes: np.ndarray) -> None:
    """Rays that see the pad directly are those inside of the outline, but for its chords' bulge."""
    outline = slopes[:, :-1].reshape(-1, 2)
    rng = np.random.default_rng(5)
    rays = rng.uniform(outline.min(axis=0), outline.max(axis=0), (400, 2))
    ends = follow(placed.setting.block, placed.eye(path), np.insert(rays, 2, -1, axis=1))
    seen = ends.sensed & (ends.wall < 0)
    assert np.mean(seen != PolygonPath(outline).contains_points(rays)) < 0.05


def check_outlines(structure: int, count: int) -> tuple[int, set, int]:
    """Compare outlines in random scenes of one structure with rays; what there was to compare."""
    placed, stacked, lateral = settings(structure, count)
    find = jax.jit(jax.vmap(lambda scene, off: find_outline_edges(scene, NO_ANGLES, lateral=off)))
    found = jax.tree.map(np.asarray, find(stacked, lateral))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
    compared, names, turns = 0, set(), 0
    for i, path in np.argwhere(found.present[:, :, 0]):
        one = jax.tree.map(lambda leaf, i=i, path=path: leaf[i, path, 0], found)
        block = placed[i].setting.block
        slopes = placed[i].slopes(path, one.angle, one.slope)
        check_inside(placed[i], path, slopes)
        inner, outer = (part.reshape(-1, 2) for part in (within(slopes), slopes))
        edge = edges(block, placed[i].eye(path), inner, outer)
        np.testing.assert_allclose(edge.part, 1, atol=1e-8)
        places = np.stack([one.along * block.length, one.beside], axis=-1).reshape(-1, 2)
        off = np.abs(edge.place - places) / block.length
        assert off.max() < NEAR, (structure, i, path, off.max())
        layout = parse_scene(placed[i].tables).layout
        bounds = [[name_bound(layout, 0, int(level)) for level in of] for of in one.level]
        wanted = np.array(bounds)
        # Corners and turns are between two bounds.
        same = wanted[:, 1:] == wanted[:, :-1]
        found_names = edge.name.reshape(one.along.shape)[:, 1:-1]
        assert np.array_equal(found_names[same], wanted[:, 1:][same]), (structure, i, path)
        compared += 1
        names |= set(wanted.ravel().tolist())
        turns += int(np.sum(np.diff(one.level)[:, 1:] != 0))
    return compared, names, turns


@pytest.mark.parametrize("structure", [0, pytest.param(2, marks=pytest.mark.nightly)])
def test_outlines_are_where_rays_end(structure):
    compared, names, turns = check_outlines(structure, 12)
    assert compared > 8
    assert {"membrane", "wall"} <= names
    assert turns


@pytest.mark.nightly
@pytest.mark.parametrize("structure", range(12))
def test_outlines_and_second_images_of_many_scenes(structure):
    check_outlines(structure, 45)
    check_second_outlines(structure, 45)
    check_second_images(structure, 45)


def check_second_outlines(structure: int, count: int) -> int:
    """The same of second images; how many there were."""
    placed, stacked, lateral = settings(structure, count)
    layout = parse_scene(placed[0].tables).layout
    walls = [*clear_walls(layout), *clear_walls(layout, beside=True)]
    if not walls:
        return 0
    find = jax.jit(jax.vmap(lambda scene, off: find_second_outlines(scene, NO_ANGLES, lateral=off)))
    second = jax.tree.map(np.asarray, find(stacked, lateral))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(second))
    compared = 0
    for i, path, number in np.argwhere(second.edges.present & second.total):
        one = jax.tree.map(lambda leaf, at=(i, path, number): leaf[at], second.edges)
        block, wall = placed[i].setting.block, walls[number]
        slopes = placed[i].slopes(path, one.angle, one.slope)
        mirror = wall.layer, WALLS.index(wall.side)
        inner, outer = (part.reshape(-1, 2) for part in (within(slopes), slopes))
        edge = edges(block, placed[i].eye(path), inner, outer, mirror)
        # What is narrower than a ray's rounding has no inside.
        if np.ptp(one.along) < 1e-6 or np.ptp(one.beside) < 1e-6:
            continue
        known = np.isfinite(edge.part)
        assert known.mean() > 0.9, (structure, i, path, number)
        places = np.stack([one.along * block.length, one.beside], axis=-1).reshape(-1, 2)
        off = float((np.abs(edge.place - places) / block.length)[known].max())
        compared += 1
        assert off < NEAR, (structure, i, path, number, off)
    return compared


def check_second_images(structure: int, count: int) -> int:
    """The same in the section, beside all rays of a fan that a wall has reflected."""
    placed, _, _ = settings(structure, count)
    scenes = []
    for one in placed:
        one.setting.camera[1], one.axis = 0, -one.up
        lens = one.tables["camera"] | {"direction_deg": math.degrees(np.angle(one.axis))}
        scenes.append(parse_scene(one.tables | {"mirrors": [], "camera": lens}))
    walls = clear_walls(scenes[0].layout)
    if not walls:
        return 0
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *scenes)
    find = jax.jit(jax.vmap(lambda scene: find_second_images(scene, NO_ANGLES, bounces=0)))
    found = jax.tree.map(np.asarray, find(stacked))
    compared = 0
    for i, one in enumerate(placed):
        for number, wall in enumerate(walls):
            mirror = wall.layer, WALLS.index(wall.side)
            shown = fan_of(one, mirror)
            there = found.present[i, number]
            ends = np.stack([found.start, found.end], axis=-1)[i, number][there]
            pixels = found.pixels[i, number][there]
            if one.setting.pad["layers"][wall.layer]["bevel_deg"][mirror[1]]:
                assert not there.any()
                continue
            wide = np.ptp(ends, axis=1) > 1e-6
            ends, pixels = ends[wide], pixels[wide]
            wanted = [part[np.argsort(part[:, 0])] for part in shown if np.ptp(part[:, 0]) > 1e-6]
            assert len(ends) == len(wanted), (structure, i, number, ends, wanted)
            for part in wanted:
                nearest = np.argmin(np.abs(ends[:, 0] - part[0, 0]))
                off = np.abs(ends[nearest] - part[:, 0]).max()
                compared += 1
                assert off < NEAR, (structure, i, number, off)
                np.testing.assert_allclose(pixels[nearest], part[:, 1], atol=1e-7)
    return compared


def fan_of(one: Placed, mirror: tuple[int, int]) -> list[np.ndarray]:
    """Runs of rays in the section that a wall reflects: pad coordinate and pixel at both ends."""
    block, eye = one.setting.block, one.eye(0)

    def seen(tilt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rays = np.stack([np.sin(tilt), np.zeros_like(tilt), -np.cos(tilt)], axis=-1)
        ends = follow(block, eye, rays)
        shown = ends.sensed & (ends.layer == mirror[0]) & (ends.wall == mirror[1])
        return shown, ends.place[:, 0] / block.length

    tilts = np.linspace(-np.pi / 2, np.pi / 2, 20_001)[1:-1]
    shown, _ = seen(tilts)
    runs = []
    for change in np.flatnonzero(shown[1:] != shown[:-1]):
        inside, outside = tilts[[change, change + 1]][:: 1 if shown[change] else -1]
        for _ in range(60):
            middle = (inside + outside) / 2
            there = seen(np.array([middle]))[0][0]
            inside, outside = (middle, outside) if there else (inside, middle)
        ray = (one.up * -np.cos(inside) + one.along * np.sin(inside)) / one.axis
        pixel = 500 - np.angle(ray) * 1000 / np.radians(300)
        runs.append([seen(np.array([inside]))[1][0], pixel])
    return [np.array(pair) for pair in zip(runs[::2], runs[1::2], strict=True)]


@pytest.mark.parametrize("structure", [0, pytest.param(3, marks=pytest.mark.nightly)])
def test_second_images_are_where_walls_reflect_rays(structure):
    assert check_second_outlines(structure, 12) > 3
    assert check_second_images(structure, 12) > 3


ACRYLIC = {"thickness": 3.0, "index": 1.49, "sides": "clear", "overhang": 0.5}


def tables(*layers: dict, camera=(4.0, 20.0), **pad) -> dict:
    """A camera over a pad of 20 mm."""
    own = {"name": "p", "from": [0.0, 0.0], "to": [20.0, 0.0], "side": "left"}
    lens = {"position": list(camera), "direction_deg": -80.0, "fov_deg": 170.0, "pixels": 1000}
    return {"camera": lens, "pads": [own | {"layers": list(layers)} | pad]}


def test_slopes_of_outlines_and_second_images():
    # The upper edge of the acrylic bounds one part of an edge, the membrane the other.
    cut = ACRYLIC | {"bevel_deg": [22.2, 0.0]}
    seat = {"lip": [0.0, 0.5], "height": 0.7}
    gel = GEL | {"overhang": 0.3}
    scene = parse_scene(tables(cut, gel, width=18.0, bezel=seat, min_transmission=0.0))
    weights = np.random.default_rng(3).uniform(0.5, 1, 1000)

    def number(scene: Scene) -> jax.Array:
        imaging = Imaging(scene.camera, 1000, 1333)
        edges = find_outline_edges(scene, NO_ANGLES, lateral=1.5)
        mirrored = find_second_outlines(scene, NO_ANGLES, lateral=1.5).edges
        second = find_second_images(scene, NO_ANGLES)
        parts = [edges.places(imaging), edges.along, edges.beside, mirrored.places(imaging)]
        parts += [second.pixels, second.start, second.end, second.px_per_mm, second.distance]
        shown = [*[True] * 3, mirrored.present[..., None, None, None], *[True] * 5]
        flat = [jnp.where(there, x, 0.0).ravel() for x, there in zip(parts, shown, strict=True)]
        joined = jnp.concatenate(flat) / 100
        return jnp.dot(jnp.resize(jnp.asarray(weights), joined.shape), joined)

    assert bool(find_second_images(scene, NO_ANGLES).present.any())
    level = np.asarray(jax.jit(find_outline_edges)(scene, NO_ANGLES, lateral=1.5).level)
    assert np.diff(level).any()
    # Without its right angle the wall at `to` has no second image.
    bevel = jnp.arange(2) == 0

    def freed(scene: Scene) -> Scene:
        assert scene.layers is not None
        cut = jnp.where(bevel[None, None], scene.layers.bevel, 0.0)
        return eqx.tree_at(lambda scene: scene.layers.bevel, scene, cut)

    check_slopes(lambda scene: number(freed(scene)), scene)


def test_second_images_leave_coverage_as_it_is():
    """What only total reflection shows is not seen: the coverage is that of black ends."""
    camera = {"camera": (10.0, 12.0)}
    both = [parse_scene(tables(ACRYLIC | {"sides": s}, GEL, **camera)) for s in ("clear", "black")]
    clear, black = (float(find_coverage(scene, NO_ANGLES).value[0]) for scene in both)
    assert clear == black
    assert bool(find_second_images(both[0], NO_ANGLES).present.any())


def test_a_wall_of_little_index_leaks():
    """Above 45° in the layer light is reflected for n = √2 and more; n = 1 reflects nothing."""
    images = [
        find_second_images(parse_scene(tables(GEL | {"index": n, "sides": "clear"})), NO_ANGLES)
        for n in (1.0, 1.41)
    ]
    assert [bool(found.present.any()) for found in images] == [False, True]


def test_trace_names_bounds_and_second_images(tmp_path, capsys):
    table = tables(ACRYLIC, GEL, width=18.0, bezel={"lip": [4.0, 0.5], "height": 0.7})
    scene, path = parse_scene(table), tmp_path / "pad.toml"
    path.write_text(format_scene(scene), encoding="utf-8")
    assert run(["trace", str(path)]) == 0
    shown = capsys.readouterr()
    (pose,) = json.loads(shown.out)["poses"]
    view = pose["pads"]["p"]["views"]["direct"]
    edges, imaging = jax.jit(find_outline_edges)(scene, NO_ANGLES), Imaging.of(scene.camera)
    places = np.asarray(edges.places(imaging))[0, 0]
    for edge, name in enumerate(EDGES):
        parts = view["outline"][name]
        ends = [parts[0]["places"][0], parts[-1]["places"][-1]]
        np.testing.assert_allclose(ends, places[edge, [0, -1]], atol=1e-9)
        for before, after in itertools.pairwise(parts):
            assert before["bound"] != after["bound"]
            assert before["places"][-1] == after["places"][0]
        bounds = [name_bound(scene.layout, 0, int(level)) for level in edges.level[0, 0, edge]]
        assert [part["bound"] for part in parts] == [b for b, _ in itertools.groupby(bounds)]
    # Down the middle column the edge at `from` is where the view ends.
    middle = places[EDGES.index("from"), 8]
    assert middle[1] == pytest.approx(view["pixels"][0][0] - 0.5, abs=1e-9)
    assert "bezel" in view["ends"][0][0]
    second = find_second_images(scene, NO_ANGLES)
    wanted = np.asarray(second.pixels)[np.asarray(second.present)]
    found = [image for image in pose["pads"]["p"]["second_images"] if "pixels" in image]
    np.testing.assert_allclose(np.concatenate([one["pixels"] for one in found]), wanted)
    # The bezel's lip, 4 mm wide beside the section too, covers the walls there.
    assert {one["wall"] for one in pose["pads"]["p"]["second_images"]} == {"layer 1 at 'to'"}
    assert "a second image of it appears in layer 1 at 'to'" in shown.err


@pytest.mark.parametrize(
    ("find", "table", "message"),
    [
        (find_outline_edges, tables(GEL), "a 'width'"),
        (find_second_images, tables(GEL, width=10.0), "no end of a layer is clear"),
        (find_second_outlines, tables(GEL, width=10.0), "no side wall of a layer is clear"),
    ],
)
def test_what_has_no_outlines_or_second_images_is_refused(find, table, message):
    with pytest.raises(ValueError, match=message):
        find(parse_scene(table), NO_ANGLES)


def test_second_images_that_end_with_the_membrane_name_its_end():
    scene = read_scene(SCENES / "layered-pad.toml")
    images = jax.tree.map(np.asarray, find_second_images(scene, NO_ANGLES))
    for place, labels, wanted in (
        (images.start == 0, images.start_label, FIRST_PAD_END),
        (images.end == 1, images.end_label, SECOND_PAD_END),
    ):
        found = labels[images.present & place]
        assert found.size == 0 or set(found.tolist()) == {wanted}
    assert (images.present & (images.end == 1)).any()
