"""Whole outlines behind layers, and second images in clear walls, beside brute-force rays."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import (
    Scene,
    clear_walls,
    find_outline_edges,
    find_second_images,
    find_second_outlines,
    name_bound,
    parse_scene,
)

from studies.oracles.layer_box import WALLS, Setting, edges, follow, random_setting
from tests.helpers import check_gradients

NEAR = 1e-9
"""Of a pad: how far an outline may lie from where rays find it."""

SLOPES = 1e-6
"""Relative: what central differences leave."""

NO_ANGLES = jnp.zeros(0)


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


def check_outlines(structure: int, count: int) -> tuple[int, float, set]:
    """Compare outlines in random scenes of one structure with rays; what there was to compare."""
    placed, stacked, lateral = settings(structure, count)
    find = jax.jit(jax.vmap(lambda scene, off: find_outline_edges(scene, NO_ANGLES, lateral=off)))
    found = jax.tree.map(np.asarray, find(stacked, lateral))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
    compared, worst, names = 0, 0.0, set()
    for i, path in np.argwhere(found.present[:, :, 0]):
        one = jax.tree.map(lambda leaf, i=i, path=path: leaf[i, path, 0], found)
        block = placed[i].setting.block
        slopes = placed[i].slopes(path, one.angle, one.slope)
        inner = slopes.reshape(-1, 2).mean(axis=0)
        between = (slopes[:, :-1] + slopes[:, 1:]) / 2
        outer = np.concatenate([slopes.reshape(-1, 2), between.reshape(-1, 2)])
        edge = edges(block, placed[i].eye(path), inner, outer)
        count = slopes[..., 0].size
        places = np.stack([one.along * block.length, one.beside], axis=-1).reshape(-1, 2)
        off = np.abs(edge.place[:count] - places) / block.length
        np.testing.assert_allclose(edge.part[:count], 1, atol=1e-8)
        worst = max(worst, float(off.max()))
        assert off.max() < NEAR, (structure, i, path, off.max())
        layout = parse_scene(placed[i].tables).layout
        wanted = [name_bound(layout, 0, int(level)) for level in one.level.ravel()]
        assert edge.name[count:].tolist() == wanted, (structure, i, path)
        compared += 1
        names |= set(wanted)
    return compared, worst, names


@pytest.mark.parametrize("structure", [2, 5])
def test_outlines_are_where_rays_end(structure):
    compared, _, names = check_outlines(structure, 12)
    assert compared > 8
    assert {"membrane", "wall"} <= names


def check_second_outlines(structure: int, count: int) -> tuple[int, float]:
    """The same of second images."""
    placed, stacked, lateral = settings(structure, count)
    layout = parse_scene(placed[0].tables).layout
    walls = [*clear_walls(layout), *clear_walls(layout, beside=True)]
    if not walls:
        return 0, 0.0
    find = jax.jit(jax.vmap(lambda scene, off: find_second_outlines(scene, NO_ANGLES, lateral=off)))
    second = jax.tree.map(np.asarray, find(stacked, lateral))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(second))
    compared, worst = 0, 0.0
    for i, path, number in np.argwhere(second.edges.present & second.total):
        one = jax.tree.map(lambda leaf, at=(i, path, number): leaf[at], second.edges)
        block, wall = placed[i].setting.block, walls[number]
        slopes = placed[i].slopes(path, one.angle, one.slope)
        mirror = wall.layer, WALLS.index(wall.side)
        # A second image is a bent strip: halfway to the opposite edge lies in it.
        inner = (slopes + slopes[[2, 3, 0, 1], ::-1]) / 2
        outer = slopes.reshape(-1, 2)
        edge = edges(block, placed[i].eye(path), inner.reshape(-1, 2), outer, mirror)
        # What is narrower than a ray's rounding has no inside.
        if np.ptp(one.along) < 1e-6 or np.ptp(one.beside) < 1e-6:
            continue
        places = np.stack([one.along * block.length, one.beside], axis=-1).reshape(-1, 2)
        off = float((np.abs(edge.place - places) / block.length).max())
        worst, compared = max(worst, off), compared + 1
        assert off < NEAR, (structure, i, path, number, off)
    return compared, worst


def check_second_images(structure: int, count: int) -> tuple[int, float]:
    """Second images in the section, beside all rays of a fan that a wall has reflected."""
    placed, _, _ = settings(structure, count)
    scenes = []
    for one in placed:
        one.setting.camera[1] = 0
        scenes.append(parse_scene(one.tables | {"mirrors": []}))
    walls = clear_walls(scenes[0].layout)
    if not walls:
        return 0, 0.0
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *scenes)
    find = jax.jit(jax.vmap(lambda scene: find_second_images(scene, NO_ANGLES, bounces=0)))
    found = jax.tree.map(np.asarray, find(stacked))
    compared, worst = 0, 0.0
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
            wanted = np.array([run for run in shown if abs(run[0][0] - run[1][0]) > 1e-6])
            assert len(ends) == len(wanted), (structure, i, number, ends, wanted)
            for run in wanted:
                run = run[np.argsort(run[:, 0])]
                nearest = np.argmin(np.abs(ends[:, 0] - run[0, 0]))
                off = np.abs(ends[nearest] - run[:, 0]).max()
                worst, compared = max(worst, float(off)), compared + 1
                assert off < NEAR, (structure, i, number, off)
                np.testing.assert_allclose(pixels[nearest], run[:, 1], atol=1e-7)
    return compared, worst


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


@pytest.mark.parametrize("structure", [2, 5])
def test_second_images_are_where_walls_reflect_rays(structure):
    assert check_second_outlines(structure, 12)[0] > 3
    assert check_second_images(structure, 12)[0] > 3
