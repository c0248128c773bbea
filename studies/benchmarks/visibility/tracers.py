"""Ray tracers on the same rays, between mirrors which every ray meets one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.study.benchmark import BenchmarkMethod, compile_timed
from optics import parse_scene
from optics.scene.scene import Scene
from optics.visibility.tracing import trace_rays
from studies.benchmarks.visibility.peers import Ends, installed, optiland_tracer, rayoptics_tracer

OURS = "designopt"
NUMPY = "NumPy by hand"
OPTILAND = "optiland"
RAYOPTICS = "rayoptics"

RAYS = 100_000
RAYOPTICS_RAYS = 1000
"""It follows one ray after the other, in Python."""

MIRRORS = 5
APART_MM = 20.0
LENGTH_MM = 16.0
TILT = 0.3
"""Of all of it, rad, so that nothing lies along an axis."""

BLOCK = 4096
"""Rays that the NumPy tracer follows at a time, so that they stay in the cache."""


def intersections_per_ray(method: str, legs: int) -> int:
    """How many times a ray is intersected with a surface."""
    return legs if method in (OPTILAND, RAYOPTICS) else legs * MIRRORS


def zigzag() -> Scene:
    """Mirrors by turns above and below."""
    turn = np.exp(1j * TILT)
    mirrors = []
    for i in range(MIRRORS):
        middle = complex((i + 0.5) * APART_MM, APART_MM / 2 * (-1) ** i)
        start, end = (turn * (middle + side * LENGTH_MM / 2) for side in (-1, 1))
        ends = {"from": [start.real, start.imag], "to": [end.real, end.imag]}
        mirrors.append({"name": f"mirror {i}"} | ends)
    camera = {"position": [0, 0], "direction_deg": 0, "fov_deg": 90, "pixels": 1}
    return parse_scene({"camera": camera, "mirrors": mirrors})


def bundle(rays: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Places and directions (mm, rad) of rays that meet all mirrors in turn, none near its ends."""
    draw = np.random.default_rng(seed)
    starts = np.exp(1j * TILT) * draw.uniform(-1, 1, rays)
    directions = TILT + np.pi / 4 + np.deg2rad(draw.uniform(-1, 1, rays))
    return np.stack([starts.real, starts.imag], axis=-1), directions


def expected(positions: np.ndarray, directions: np.ndarray, legs: int) -> Ends:
    """Where they end after so many legs, in closed form: unfolded, they are straight."""
    turn = np.exp(1j * TILT)
    start, angle = (positions @ [1, 1j] / turn).real, directions - TILT
    height, side = APART_MM * (legs - 0.5), (-1) ** (legs - 1)
    places = turn * (start + height / np.tan(angle) + 0.5j * APART_MM * side)
    headings = turn * np.exp(-1j * side * angle)
    at, toward = (np.stack([z.real, z.imag], axis=-1) for z in (places, headings))
    return Ends(at, toward, height / np.sin(angle))


def contenders(legs: int, seed: int, *, peers: bool) -> Iterator[BenchmarkMethod]:
    """Every tracer over so many legs; the others' rays meet each surface once."""
    scene, (positions, directions) = zigzag(), bundle(RAYS, seed)
    mirrors, panel = np.asarray(scene.mirrors), f"{MIRRORS} mirrors, {legs} legs"
    right = expected(positions, directions, legs)

    def error(found: Any, part: int = RAYS) -> float:
        pairs = zip(Ends(*found), right, strict=True)
        return max(float(np.max(np.abs(np.asarray(a) - b[:part]))) for a, b in pairs)

    args = scene, jnp.asarray(positions), jnp.asarray(directions)
    run, seconds = compile_timed(partial(traced, legs), *args)
    yield BenchmarkMethod(OURS, "", panel, partial(run, *args), error, seconds)
    call = partial(numpy_trace, mirrors, positions, directions, legs)
    yield BenchmarkMethod(NUMPY, "", panel, call, error)
    if not peers or legs < MIRRORS:
        return
    if installed("optiland"):
        call, read = optiland_tracer(mirrors, positions, directions)
        yield BenchmarkMethod(OPTILAND, "", panel, call, lambda found: error(read(found)))
    if installed("rayoptics"):
        few = RAYOPTICS_RAYS
        call, read_few = rayoptics_tracer(mirrors, positions[:few], directions[:few])
        yield BenchmarkMethod(
            RAYOPTICS,
            f"first {few:,} rays traced and the time scaled",
            panel,
            call,
            lambda found: error(read_few(found), few),
            scale=RAYS / few,
        )


def traced(
    legs: int, scene: Scene, positions: Float[Array, "rays 2"], directions: Float[Array, " rays"]
) -> tuple[Array, Array, Array]:
    """Where rays end after so many legs, by the library."""
    hits = trace_rays(scene, scene.pose(), positions, directions, bounces=legs - 1)
    return hits.place[:, -1], hits.direction[:, -1], hits.length[:, -1]


def numpy_trace(
    mirrors: np.ndarray, positions: np.ndarray, directions: np.ndarray, legs: int
) -> Ends:
    """Rays from nearest mirror to nearest mirror, as a person would write it for this scene."""
    count = len(directions)
    found = Ends(np.empty((count, 2)), np.empty((count, 2)), np.empty(count))
    starts, steps = mirrors[:, 0], mirrors[:, 1] - mirrors[:, 0]
    normals = np.stack([-steps[:, 1], steps[:, 0]]) / np.linalg.norm(steps, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        for first in range(0, count, BLOCK):
            part = slice(first, first + BLOCK)
            x, y = positions[part].T
            dx, dy = np.cos(directions[part]), np.sin(directions[part])
            length, last = np.zeros(len(x)), np.full(len(x), -1)
            for _ in range(legs):
                nearest, hit = np.full(len(x), np.inf), np.full(len(x), -1)
                for index, ((ax, ay), (ex, ey)) in enumerate(zip(starts, steps, strict=True)):
                    px, py = ax - x, ay - y
                    inverse = 1 / (dx * ey - dy * ex)
                    distance, along = (px * ey - py * ex) * inverse, (px * dy - py * dx) * inverse
                    ahead = (distance > 0) & (along >= 0) & (along <= 1)
                    closer = ahead & (distance < nearest) & (last != index)
                    nearest[closer], hit[closer] = distance[closer], index
                met = hit >= 0
                nearest = np.where(met, nearest, 0.0)
                x, y, length = x + nearest * dx, y + nearest * dy, length + nearest
                nx, ny = normals[:, hit]
                toward = np.where(met, 2 * (dx * nx + dy * ny), 0.0)
                dx, dy, last = dx - toward * nx, dy - toward * ny, hit
            found.places[part, 0], found.places[part, 1] = x, y
            found.headings[part, 0], found.headings[part, 1] = dx, dy
            found.lengths[part] = length
    return found
