"""Pictures of a finger that has been made, with real light, and what is truly in them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.ndimage

from studies.oracles.judge.capture import Capture, expose
from studies.oracles.judge.contacts import Contacts
from studies.oracles.judge.fabrication import CHANNELS, Errors, fabricated, of_channel
from studies.oracles.judge.frames import ASPECT, sources
from studies.oracles.judge.keeping import kept_arrays
from studies.oracles.judge.lens import Lens
from studies.oracles.judge.light import COLORS, MembraneLight, light_membranes
from studies.oracles.judge.solids import Pose, Tables, motion_of
from studies.oracles.judge.tracing import NUDGE, Traced, Tracer, Walls
from studies.oracles.judge.truth import ViewTruth, find_view_truths

BOUNCES = 3
"""By mirrors: light does not stop after as many as a scene's file counts."""

COARSE = 4
"""Step of the grid of rays that finds what is the same all around, px."""

SAMPLES, LATTICE = 21, 13
"""Rays for a pixel at an edge, of a Fibonacci lattice: evenly spaced in both directions."""

SPREAD = 2
"""Edges in red and blue light are no farther from those in green, px."""

CHUNK = 150_000
"""Rays at a time."""

WALL_STEP, WALL_RAYS, WALL_SPREAD = 16, 64, 1.5
"""Light on walls: px between places, rays from each, and spread over places of its smoothing."""


class Photograph(NamedTuple):
    """A picture and its truth.

    Attributes:
        pixels: 8 bits, shape (rows, columns, 3), red first.
        shown: each pad by each path that shows anything of it.
    """

    pixels: np.ndarray
    shown: list[ViewTruth]


def photograph(
    tables: Tables,
    errors: Errors | None,
    pose: Pose,
    capture: Capture,
    seed: int,
    folder: Path | None = None,
) -> Photograph:
    """Take a picture.

    Args:
        tables: of the scene as designed.
        errors: of fabrication, if there are any.
        pose: joint angles, degrees; those not named are 0.
        capture: light, exposure and the like.
        seed: of noise.
        folder: where pictures are kept, if they are.
    """
    if folder is not None:

        def taken() -> dict[str, object]:
            photo = photograph(tables, errors, pose, capture, seed)
            return {"pixels": photo.pixels, "shown": json.dumps(photo.shown)}

        asked = [tables, errors, pose, dataclasses.asdict(capture), seed]
        key = sources() + json.dumps(asked, sort_keys=True).encode()
        kept = kept_arrays(folder, key, taken)
        shown = [ViewTruth(*one) for one in json.loads(str(kept["shown"]))]
        return Photograph(kept["pixels"], shown)
    made = dict(fabricated(tables, errors or {}))
    made["scene"] = made.get("scene", {}) | {"bounces": BOUNCES}
    light, distance = trace_light(made, pose, capture)
    pixels = expose(light, distance, capture, np.random.default_rng(seed))
    return Photograph(pixels, find_view_truths(made, pose, capture))


def lens_of(tables: Tables, pose: Pose) -> Lens:
    """The camera of a scene in a pose."""
    camera = tables["camera"]
    return Lens.of(camera, motion_of(tables, pose, camera.get("body", "world")), ASPECT)


def trace_light(tables: Tables, pose: Pose, capture: Capture) -> tuple[np.ndarray, np.ndarray]:
    """Light that reaches every pixel, full scales, and how far away what is seen is, mm.

    Args:
        tables: of a finger that has been made.
        pose: joint angles, degrees.
        capture: light and walls.
    """
    lights, unit = light_membranes(tables, capture)
    by_channel = [of_channel(tables, channel) for channel in CHANNELS]
    green = _Image(by_channel[1], pose, capture, lights, unit)
    light, distance, edge = green.take()
    for i in (0, 2):
        if by_channel[i] != by_channel[1]:
            other = _Image(by_channel[i], pose, capture, lights, unit, green)
            light[..., i] = other.retake(light, edge)[..., i]
    return light, distance


class _Image:
    """Rays of one color's light through the pixels of an image."""

    def __init__(
        self,
        tables: Tables,
        pose: Pose,
        capture: Capture,
        lights: list[MembraneLight],
        unit: float,
        green: _Image | None = None,
    ) -> None:
        self._capture, self._lights, self._scale = capture, lights, unit * capture.exposure
        self._lens, lit = lens_of(tables, pose), capture.light == "lamps"
        self._contacts = Contacts(tables, capture.contacts)
        self._tracer = Tracer(
            tables, pose, self._lens.position, lamps=lit, housing=True,
            contacts=self._contacts if capture.contacts else None,
        )  # fmt: skip
        self._coupling: Walls = capture.coupling
        faces = self._tracer.faces
        self._lamp = np.array([face.lamp if face.kind == "lamp" else -1 for face in faces])
        self._wall = np.array([face.kind in ("blocker", "body", "lamp") for face in faces])
        edges = np.array([face.corners for face in faces])
        self._normals = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
        self._normals /= np.linalg.norm(self._normals, axis=-1, keepdims=True)
        self._shape = self._lens.rows, self._lens.columns
        # Walls are smooth: in red and blue they are where they are in green light.
        self._numbers: dict[int, int] = green._numbers if green else {}
        self._wall_maps: dict[int, np.ndarray] = green._wall_maps if green else {}

    def take(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Light, shape (rows, columns, 3), distance, and which pixels are at edges."""
        rows, columns = self._shape
        grid = np.stack(
            np.meshgrid(np.arange(0, columns, COARSE), np.arange(0, rows, COARSE)), axis=-1
        )
        coarse = grid.shape[:2]
        labels, distance = np.zeros(coarse, int), np.full(coarse, np.inf)
        lit = np.zeros(coarse, bool)
        for part, traced in self._trace(grid.reshape(-1, 2)):
            labels.flat[part], distance.flat[part] = self._label(traced), self._far(traced)
            lit.flat[part] = self._radiance(traced).any(axis=-1)
        self._light_walls()
        # Rays go through the pixels of blocks that show a membrane, or not the same all around.
        mixed = scipy.ndimage.maximum_filter(labels, 3) != scipy.ndimage.minimum_filter(labels, 3)
        fine = np.kron(mixed | lit, np.ones((COARSE, COARSE), bool))[:rows, :columns]
        fine = np.roll(fine, (-COARSE // 2, -COARSE // 2), (0, 1)) | fine
        labels, distance = (
            np.kron(one, np.ones((COARSE, COARSE), one.dtype))[:rows, :columns].copy()
            for one in (labels, distance)
        )
        light = np.zeros((rows, columns, 3))
        if self._walls_lit:
            rest = np.argwhere(~fine)[:, ::-1]
            light[~fine] = self._scale * self._wall_light(labels[~fine], rest.astype(float))
        places = np.argwhere(fine)
        for part, traced in self._trace(places[:, ::-1].astype(float)):
            i, j = places[part].T
            labels[i, j], distance[i, j] = self._label(traced), self._far(traced)
            light[i, j] = self._radiance(traced, places[part][:, ::-1].astype(float))
        edge = _edges(labels) & fine
        self._sample(light, edge)
        return light, distance, edge

    def retake(self, light: np.ndarray, edge: np.ndarray) -> np.ndarray:
        """The light where only what is near edges is not where it is in another's."""
        light, labels = light.copy(), np.zeros(self._shape, int)
        near = scipy.ndimage.maximum_filter(edge, 2 * SPREAD + 1)
        places = np.argwhere(near)
        for part, traced in self._trace(places[:, ::-1].astype(float)):
            i, j = places[part].T
            labels[i, j] = self._label(traced)
            light[i, j] = self._radiance(traced, places[part][:, ::-1].astype(float))
        self._sample(light, _edges(labels) & scipy.ndimage.minimum_filter(near, 3))
        return light

    def _sample(self, light: np.ndarray, edge: np.ndarray) -> None:
        """Means over pixels at edges, written into the light."""
        places, order = np.argwhere(edge), np.arange(SAMPLES)
        within = np.stack([order + 0.5, order * LATTICE % SAMPLES + 0.5], -1) / SAMPLES
        spread = (places[:, None, ::-1] + within - 0.5).reshape(-1, 2)
        sums = np.zeros((len(places), 3))
        for part, traced in self._trace(spread):
            np.add.at(sums, part // SAMPLES, self._radiance(traced, spread[part]))
        light[tuple(places.T)] = sums / SAMPLES

    def _trace(self, places: np.ndarray) -> Iterator[tuple[np.ndarray, Traced]]:
        """What rays through places of the image meet, some of them at a time."""
        for part in np.array_split(np.arange(len(places)), len(places) // CHUNK + 1):
            sight = self._lens.sight(places[part])
            yield part, self._tracer.trace(*sight, walls=self._coupling)

    def _label(self, traced: Traced) -> np.ndarray:
        """A number for everything that ends at the same face by the same way."""
        end = np.where(traced.reached, len(self._wall) + traced.pad, traced.end)
        glows = (traced.glow > 0) @ [1, 2, 4]
        key = glows
        for one in (traced.word, traced.entrance, traced.turns, end):
            key = 1000 * key + one + 10
        found, inverse = np.unique(key, return_inverse=True)
        own = [self._numbers.setdefault(one, len(self._numbers)) for one in found.tolist()]
        return np.array(own)[inverse]

    def _far(self, traced: Traced) -> np.ndarray:
        return np.where(traced.distance > 0, traced.distance, np.inf)

    def _radiance(self, traced: Traced, places: np.ndarray | None = None) -> np.ndarray:
        """What rays bring, full scales, shape (rays, 3); of walls where places are given."""
        found = np.zeros((len(traced.end), 3))
        if self._capture.light == "lamps":
            found = traced.glow @ COLORS
        for pad, light in enumerate(self._lights):
            mine = np.flatnonzero(traced.reached & (traced.pad == pad))
            values = light.at(traced.along[mine], traced.across[mine])
            found[mine] += traced.transmission[mine, None] * values
        met = np.flatnonzero(~traced.reached & (traced.end >= 0))
        shines = met[self._lamp[traced.end[met]] >= 0]
        face = traced.end[shines]
        front = np.sum(self._normals[face] * traced.way[shines], axis=-1) < 0
        share = front * traced.transmission[shines]
        found[shines] += share[:, None] * COLORS[self._lamp[face]]
        if places is not None and self._walls_lit:
            found += self._wall_light(self._label(traced), places)
        return self._scale * found

    @property
    def _walls_lit(self) -> bool:
        return self._capture.walls > 0

    def _light_walls(self) -> None:
        """Radiance of walls on a coarse grid, by what they are: each smoothed by itself."""
        if not self._walls_lit:
            return
        rows, columns = self._shape
        grid = np.stack(
            np.meshgrid(np.arange(0, columns, WALL_STEP), np.arange(0, rows, WALL_STEP)), axis=-1
        )
        places = grid.reshape(-1, 2).astype(float)
        sight = self._lens.sight(places)
        traced = self._tracer.trace(*sight, walls=self._coupling)
        labels = self._label(traced)
        opaque = self._wall[np.maximum(traced.end, 0)]
        wall = np.flatnonzero(~traced.reached & (traced.end >= 0) & opaque)
        normal = self._normals[traced.end[wall]]
        # The side that is seen is the one that the last stretch of the way comes from.
        normal *= -np.sign(np.sum(normal * traced.way[wall], axis=-1, keepdims=True))
        generator = np.random.default_rng(0)
        shifts = generator.random((2, len(wall), 1))
        first, second = (np.arange(WALL_RAYS) + 0.5) / WALL_RAYS, np.arange(WALL_RAYS) * 0.618
        square, turn = (first + shifts[0]) % 1, 2 * np.pi * (second + shifts[1])
        helper = np.where(np.abs(normal[:, 2:]) < 0.9, [[0, 0, 1.0]], [[1.0, 0, 0]])
        u = np.cross(normal, helper)
        u /= np.linalg.norm(u, axis=-1, keepdims=True)
        v = np.cross(normal, u)
        flat = np.sqrt(square)
        ways = (
            (flat * np.cos(turn))[..., None] * u[:, None]
            + (flat * np.sin(turn))[..., None] * v[:, None]
            + np.sqrt(1 - square)[..., None] * normal[:, None]
        )
        begin = np.repeat(traced.point[wall] + 10 * NUDGE * normal, WALL_RAYS, axis=0)
        inside = np.repeat(traced.inside[wall], WALL_RAYS)
        ways, values = ways.reshape(-1, 3), np.zeros((len(begin), 3))
        for part in np.array_split(np.arange(len(begin)), len(begin) // CHUNK + 1):
            met = self._tracer.trace(ways[part], begin[part], inside[part], self._coupling)
            values[part] = self._radiance(met) / self._scale
        mean = self._capture.walls * values.reshape(-1, WALL_RAYS, 3).mean(axis=1)
        mean *= traced.transmission[wall, None]
        for label in np.unique(labels[wall]).tolist():
            mine = wall[labels[wall] == label]
            sums = np.zeros((len(places), 4))
            sums[mine, :3], sums[mine, 3] = mean[labels[wall] == label], 1
            sums = sums.reshape(*grid.shape[:2], 4)
            spreads = (WALL_SPREAD, WALL_SPREAD, 0)
            near = scipy.ndimage.gaussian_filter(sums, spreads, mode="constant")
            wide = scipy.ndimage.gaussian_filter(sums, [5 * s for s in spreads], mode="constant")
            near += 1e-3 * wide + 1e-12 * sums.sum(axis=(0, 1))
            self._wall_maps[label] = near[..., :3] / near[..., 3:]

    def _wall_light(self, labels: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Radiance of walls at places of the image, shape (places, 3)."""
        found = np.zeros((len(labels), 3))
        for label in np.unique(labels).tolist():
            if label not in self._wall_maps:
                continue
            mine = labels == label
            index = places[mine][:, ::-1].T / WALL_STEP
            for i in range(3):
                found[mine, i] = scipy.ndimage.map_coordinates(
                    self._wall_maps[label][..., i], index, order=1, mode="nearest"
                )
        return found


def _edges(labels: np.ndarray) -> np.ndarray:
    """Pixels that have a neighbor of another label."""
    edge = np.zeros(labels.shape, bool)
    for one, other in (
        (np.s_[1:], np.s_[:-1]),
        (np.s_[:, 1:], np.s_[:, :-1]),
    ):
        differs = labels[one] != labels[other]
        edge[one] |= differs
        edge[other] |= differs
    return edge
