"""Ray tracers on the same rays, between mirrors which every ray meets one after the other.

optiland and rayoptics take part where the extra ``peers`` is installed. Both are made for lenses:
rays meet the surfaces in the order in which these are given, and their z and y axes are the
section's x and y.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.study.benchmark import BenchmarkMethod, compile_methods
from optics import parse_scene
from optics.scene.scene import Scene
from optics.visibility.tracing import trace_rays
from studies.benchmarks.measuring import installed
from studies.oracles import rays

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

Ends = tuple[Any, ...]
"""Where rays end, on the last mirror that they meet: places, mm, and for all but the oracle's rays
their headings, reflected, of length 1, and the lengths of their paths, mm."""

Tracer = tuple[Callable[[], Any], Callable[[Any], Ends]]
"""What traces all rays, and what reads its answer."""


def zigzag() -> Scene:
    """Mirrors by turns above and below."""
    mirrors = []
    for i in range(MIRRORS):
        middle = complex((i + 0.5) * APART_MM, APART_MM / 2 * (-1) ** i)
        ends = middle + np.array([-1, 1]) * LENGTH_MM / 2
        start, end = pairs(np.exp(1j * TILT) * ends).tolist()
        mirrors.append({"name": f"mirror {i}", "from": start, "to": end})
    camera = {"position": [0, 0], "direction_deg": 0, "fov_deg": 90, "pixels": 1}
    return parse_scene({"camera": camera, "mirrors": mirrors})


def bundle(rays: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Places and directions (mm, rad) of rays that meet all mirrors in turn, none near its ends."""
    draw = np.random.default_rng(seed)
    starts = np.exp(1j * TILT) * draw.uniform(-1, 1, rays)
    directions = TILT + np.pi / 4 + np.deg2rad(draw.uniform(-1, 1, rays))
    return pairs(starts), directions


def pairs(places: np.ndarray) -> np.ndarray:
    """Complex numbers as coordinates, shape (rays, 2)."""
    return np.stack([np.real(places), np.imag(places)], axis=-1)


def expected(positions: np.ndarray, directions: np.ndarray, legs: int) -> Ends:
    """Where they end after so many legs, in closed form: unfolded, they are straight."""
    turn = np.exp(1j * TILT)
    start, angle = (positions @ [1, 1j] / turn).real, directions - TILT
    height, side = APART_MM * (legs - 0.5), (-1) ** (legs - 1)
    places = turn * (start + height / np.tan(angle) + 0.5j * APART_MM * side)
    return pairs(places), pairs(turn * np.exp(-1j * side * angle)), height / np.sin(angle)


def methods(legs: int, seed: int, *, peers: bool) -> Iterator[BenchmarkMethod]:
    """Every tracer over so many legs; the others' rays meet each surface once."""
    scene, given = zigzag(), bundle(RAYS, seed)
    panel, right = f"{MIRRORS} mirrors, {legs} legs", expected(*given, legs)

    def error(found: Any, read: Callable[[Any], Ends] = tuple) -> float:
        return max(
            float(np.max(np.abs(np.asarray(part) - wanted[: len(part)])))
            for part, wanted in zip(read(found), right, strict=False)
        )

    arrays = map(jnp.asarray, given)
    yield from compile_methods(OURS, panel, error, partial(traced, legs), scene, *arrays)
    call, read = numpy_tracer(legs, scene, *given)
    yield BenchmarkMethod(NUMPY, "", panel, call, partial(error, read=read))
    if peers and legs == MIRRORS:
        scaled = f"first {RAYOPTICS_RAYS:,} rays traced and the time scaled"
        for name, make, part, setting in (
            (OPTILAND, optiland_tracer, RAYS, ""),
            (RAYOPTICS, rayoptics_tracer, RAYOPTICS_RAYS, scaled),
        ):
            if installed(name):
                call, read = make(scene, *(part_of[:part] for part_of in given))
                off = partial(error, read=read)
                yield BenchmarkMethod(name, setting, panel, call, off, scale=RAYS / part)


def traced(
    legs: int, scene: Scene, positions: Float[Array, "rays 2"], directions: Float[Array, " rays"]
) -> tuple[Array, Array, Array]:
    """Where rays end after so many legs, by the library."""
    hits = trace_rays(scene, scene.pose(), positions, directions, bounces=legs - 1)
    return hits.place[:, -1], hits.direction[:, -1], hits.length[:, -1]


def numpy_tracer(legs: int, scene: Scene, positions: np.ndarray, directions: np.ndarray) -> Tracer:
    """The oracle's rays, to the place where they end: the last mirror is a pad for them."""
    mirrors = np.asarray(scene.mirrors) @ [1, 1j]
    surfaces = rays.Surfaces([*map(tuple, mirrors)], [0] * MIRRORS, legs - 1, [0.0], {})
    places, headings = positions @ [1, 1j], np.stack([np.cos(directions), np.sin(directions)])

    def call() -> np.ndarray:
        blocks = [slice(i, i + rays.CHUNK) for i in range(0, len(places), rays.CHUNK)]
        found = [rays.cast(surfaces, places[i], tuple(headings[:, i]), legs - 1) for i in blocks]
        return np.concatenate([along for _, along in found])

    start, end = mirrors[legs - 1]
    return call, lambda along: (pairs(start + along * (end - start)),)


def optiland_tracer(scene: Scene, positions: np.ndarray, directions: np.ndarray) -> Tracer:
    """`optiland`: all rays at once in NumPy, nothing recorded on the way.

    Args:
        scene: its mirrors are in the order in which they are met.
        positions: where the rays start, mm.
        directions: rad.
    """
    from optiland.optic import Optic  # pyright: ignore[reportMissingImports]
    from optiland.rays import RealRays  # pyright: ignore[reportMissingImports]

    system = Optic()
    system.surfaces.add(index=0, thickness=np.inf)
    for number, (start, end) in enumerate(np.asarray(scene.mirrors), start=1):
        (x, y), (dx, dy) = (start + end) / 2, end - start
        place = {"x": 0.0, "y": y, "z": x, "rx": np.pi / 2 - np.arctan2(dy, dx)}
        kind = {"radius": np.inf, "material": "mirror", "is_stop": number == 1}
        system.surfaces.add(index=number, **kind, **place)
    zero, one = np.zeros(len(positions)), np.ones(len(positions))
    x, y = positions.T
    across, along = np.sin(directions), np.cos(directions)

    def call() -> Any:
        # It moves the rays that it is given.
        given = [leaf.copy() for leaf in (zero, y, x, zero, across, along)]
        return system.surfaces.trace(RealRays(*given, one, one), skip=1, record=False)

    return call, lambda found: (
        pairs(found.z + 1j * found.y),
        pairs(found.N + 1j * found.M),
        found.opd,
    )


def rayoptics_tracer(scene: Scene, positions: np.ndarray, directions: np.ndarray) -> Tracer:
    """`rayoptics`: its function for one ray, called for each; otherwise as `optiland_tracer`."""
    from rayoptics.elem.profiles import Spherical  # pyright: ignore[reportMissingImports]
    from rayoptics.elem.surface import Surface  # pyright: ignore[reportMissingImports]
    from rayoptics.raytr.raytrace import trace_raw  # pyright: ignore[reportMissingImports]

    # Of every surface, axes as rows and origin: y along the mirror, z in the sense of the light.
    frames = [(np.eye(3), np.zeros(3))]
    for number, (start, end) in enumerate(np.asarray(scene.mirrors)):
        dx, dy = (end - start) / np.linalg.norm(end - start)
        x, y = np.array([(-1.0) ** (number + 1), 0.0, 0.0]), np.array([0.0, dy, dx])
        middle = (start + end) / 2
        frames.append((np.stack([x, y, np.cross(x, y)]), np.array([0.0, middle[1], middle[0]])))
    last = frames[-1]
    first = Surface(interact_mode="dummy")
    plane = Surface(profile=Spherical(c=0.0), interact_mode="reflect")
    path = [
        (first if number == 0 else plane, None, (turn @ axes.T, axes @ (origin - here)), 1.0, 1.0)
        for number, ((axes, here), (turn, origin)) in enumerate(itertools.pairwise([*frames, last]))
    ]
    zero = np.zeros(len(positions))
    starts = np.stack([zero, positions[:, 1], positions[:, 0]], axis=-1)
    headings = np.stack([zero, np.sin(directions), np.cos(directions)], axis=-1)

    def call() -> list[Any]:
        both = zip(starts, headings, strict=True)
        return [trace_raw(iter(path), *one, 550.0, intersect_obj=False) for one in both]

    def read(traced: list[Any]) -> Ends:
        (axes, origin), paths = last, [ray for ray, _, _ in traced]
        places, toward = (np.array([ray[-1][part] for ray in paths]) @ axes for part in (0, 1))
        lengths = np.array([sum(segment[2] for segment in ray) for ray in paths])
        return (places + origin)[:, [2, 1]], toward[:, [2, 1]], lengths

    return call, read
