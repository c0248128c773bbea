"""Light in a bent, coloured chamber, by Mitsuba's path tracer: what an endoscope in it sees.

The chamber is a solid: a wall, swept along an arc of a circle, with a red, a blue and a yellow
part, closed by a flat top and behind the lens by a dark plate. Lamps lie in a ring round the lens,
as in an endoscope. Walls are matt, or matt under a clear coat that is smooth or a little rough;
dust lies on them as small white spheres. Nothing is fitted: the light's falling off, the walls'
lighting each other, mirror images and highlights follow from the solid.

Axes: x to the right in the image, y down, z along the lens. Lengths in mm, angles in radians.
"""

from __future__ import annotations

import functools
import importlib
import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from studies.oracles.judge import engine
from studies.oracles.judge.keeping import kept_arrays

COLORS = ((0.75, 0.12, 0.10), (0.10, 0.22, 0.75), (0.85, 0.70, 0.10), (0.18, 0.18, 0.18))
"""Red, green and blue reflected by the red, blue and yellow walls and by the top."""

PLATE = 0.05
"""Reflected by the plate behind the lens."""

DUST = 0.9
"""Reflected by dust."""

AROUND, STEP = 128, 1.0
"""Points of the wall round it, and the longest step along it, mm."""

BEHIND, LAMPS = 0.5, (1.0, 2.0)
"""How far the plate is behind the lens, and the radii between which the lamps lie, mm."""

BOUNCES = 16
"""Of a path; walls that reflect three quarters leave a hundredth of the light to longer ones."""

PASS = 8
"""Samples of each pixel at once: what fits memory."""


@dataclass(frozen=True)
class Frame:
    """A chamber, its endoscope, and how well they are traced.

    Attributes:
        lengths: of the red, the blue and the yellow wall along the centre line.
        radii: of the chamber where they begin and end.
        pinhole: distance of the pinhole behind the start of the centre line.
        bend: angle between the chamber's two ends.
        direction: in the image to which it bends; 0 is right, a right angle is down.
        field_of_view: angle between the rays of opposite corners, before distortion.
        distortion: k1 of r (1 + k1 r²), r the tangent of a ray's angle to the axis.
        columns: width of the image, px.
        rows: its height, px.
        coat: refractive index of the clear coat; 1 is a matt wall.
        roughness: of the coat, α of the Beckmann distribution.
        dust: number of spheres.
        grain: their radius.
        colors: of the three walls and of the top.
        samples: of each pixel, a multiple of 8. Few of them leave speckles where walls shine: light
            that comes by rare paths.
        seed: of samples and dust.
    """

    lengths: tuple[float, float, float]
    radii: tuple[float, float, float, float]
    pinhole: float
    bend: float = 0.0
    direction: float = 0.0
    field_of_view: float = math.radians(60.0)
    distortion: float = 0.0
    columns: int = 640
    rows: int = 480
    coat: float = 1.0
    roughness: float = 0.1
    dust: int = 0
    grain: float = 0.1
    colors: tuple[tuple[float, float, float], ...] = COLORS
    samples: int = 16
    seed: int = 0


@contextmanager
def _mitsuba() -> Iterator[Any]:
    """Mitsuba in colours; afterwards in the variant it was in."""
    mitsuba = engine.load_mitsuba()
    before = mitsuba.variant()
    together = engine.find_llvm() is not None
    mitsuba.set_variant("llvm_ad_rgb" if together else "scalar_rgb")
    if together:  # millions of rays at a time
        importlib.import_module("drjit").set_thread_count(os.cpu_count() or 1)
    try:
        yield mitsuba
    finally:
        mitsuba.set_variant(before)
        if together:
            importlib.import_module("drjit").set_thread_count(1)


def wall(frame: Frame, arc: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Points of the wall at places along the centre line and round it, shape (..., 3).

    Round it, 0 is the side to which the chamber bends.
    """
    starts = np.concatenate([[0.0], np.cumsum(frame.lengths)])
    radius = np.interp(arc, starts, frame.radii)
    if frame.bend:
        curvature = frame.bend / starts[-1]
        # Behind the start of the centre line the chamber is straight.
        turned = curvature * np.maximum(arc, 0)
        x, z = (1 - np.cos(turned)) / curvature, np.sin(turned) / curvature + np.minimum(arc, 0)
    else:
        turned, x, z = np.zeros_like(arc), np.zeros_like(arc), arc
    across = x + radius * np.cos(turn) * np.cos(turned)
    along = z - radius * np.cos(turn) * np.sin(turned) + frame.pinhole
    beside = radius * np.sin(turn)
    cosine, sine = math.cos(frame.direction), math.sin(frame.direction)
    return np.stack(
        [across * cosine - beside * sine, across * sine + beside * cosine, along], axis=-1
    )


def rays(frame: Frame, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Unit vectors of the rays that are imaged at these places, px."""
    focal = math.hypot(frame.columns, frame.rows) / 2 / math.tan(frame.field_of_view / 2)
    x = (columns - (frame.columns - 1) / 2) / focal
    y = (rows - (frame.rows - 1) / 2) / focal
    imaged = np.hypot(x, y)
    slope = imaged.copy()
    for _ in range(20):  # Newton's method for r (1 + k1 r²)
        k1 = frame.distortion
        slope -= (slope * (1 + k1 * slope**2) - imaged) / (1 + 3 * k1 * slope**2)
    scale = np.where(imaged > 0, slope / np.where(imaged > 0, imaged, 1), 1)
    vectors = np.stack([x * scale, y * scale, np.ones_like(x)], axis=-1)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _mesh(mi: Any, points: np.ndarray, table: dict[str, Any], *, smooth: bool) -> Any:
    """A grid of points, shape (along, around, 3), closed around, seen from inside."""
    along, around = points.shape[:2]
    i, j = np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij")
    a, b = i * around + j, i * around + (j + 1) % around
    faces = np.stack([a, b, a + around, b, b + around, a + around], axis=-1).reshape(-1, 3)
    properties = mi.Properties()
    for name, plugin in table.items():
        properties[name] = mi.load_dict(plugin)
    mesh = mi.Mesh("grid", along * around, len(faces), props=properties, has_vertex_normals=smooth)
    values = mi.traverse(mesh)
    values["vertex_positions"] = points.ravel().astype(np.float32)
    values["faces"] = faces.ravel().astype(np.uint32)
    if smooth:
        onward = np.gradient(points, axis=0)
        sideways = np.roll(points, -1, axis=1) - np.roll(points, 1, axis=1)
        normals = np.cross(sideways, onward)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        values["vertex_normals"] = normals.ravel().astype(np.float32)
    values.update()
    return mesh


def _bsdf(frame: Frame, color: tuple[float, ...]) -> dict[str, Any]:
    diffuse = {"type": "rgb", "value": list(color)}
    if frame.coat == 1:
        plain = {"type": "diffuse", "reflectance": diffuse}
    else:
        plain = {
            "type": "roughplastic",
            "diffuse_reflectance": diffuse,
            "int_ior": frame.coat,
            "alpha": frame.roughness,
            "nonlinear": True,
        }
    return {"type": "twosided", "bsdf": plain}


def _disc(frame: Frame, inner: float, outer: float, at: float) -> np.ndarray:
    """A flat ring across the lens's axis."""
    turn = 2 * np.pi * np.arange(AROUND) / AROUND
    radius = np.array([[outer], [inner]])
    flat = np.broadcast_to(np.float64(at), (2, AROUND))
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), flat], axis=-1)


def _scene(mi: Any, frame: Frame) -> Any:
    turn = 2 * np.pi * np.arange(AROUND) / AROUND
    ends = np.concatenate([[0.0], np.cumsum(frame.lengths)])
    parts: dict[str, Any] = {}
    back = -frame.pinhole - BEHIND
    for i, color in enumerate(frame.colors[:3]):
        start = ends[i] if i else back
        arc = np.linspace(start, ends[i + 1], math.ceil((ends[i + 1] - start) / STEP) + 1)
        points = wall(frame, *np.meshgrid(arc, turn, indexing="ij"))
        parts[f"wall{i}"] = _mesh(mi, points, {"bsdf": _bsdf(frame, color)}, smooth=True)
    rim = wall(frame, np.full(AROUND, ends[-1]), turn)
    middle = np.broadcast_to(rim.mean(axis=0), rim.shape)
    top = {"bsdf": _bsdf(frame, frame.colors[3])}
    parts["top"] = _mesh(mi, np.stack([rim, middle]), top, smooth=False)
    plate = {"bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": PLATE}}}
    parts["plate"] = _mesh(mi, _disc(frame, 0.0, frame.radii[0] + 1, -BEHIND), plate, smooth=False)
    lamp = {"emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}}
    parts["lamp"] = _mesh(mi, _disc(frame, *LAMPS, 0.0), lamp, smooth=False)
    random = np.random.default_rng([frame.seed, 1])
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": DUST}}
    for i in range(frame.dust):
        place = random.uniform(ends[1] / 2, ends[-1]), random.uniform(0, 2 * np.pi)
        center = wall(frame, *map(np.array, place)).tolist()
        parts[f"dust{i}"] = {
            "type": "sphere", "center": center, "radius": frame.grain, "bsdf": white,
        }  # fmt: skip
    return mi.load_dict({"type": "scene", **parts})


def trace(frame: Frame) -> np.ndarray:
    """Light that reaches the pixels, red, green and blue, shape (rows, columns, 3).

    The lamps' own brightness is 1. Every pixel is the mean of samples spread over it.
    """
    with _mitsuba() as mi:
        scene = _scene(mi, frame)
        integrator = mi.load_dict({"type": "path", "max_depth": BOUNCES, "rr_depth": 6})
        random = np.random.default_rng([frame.seed, 2])
        total = np.zeros((frame.rows, frame.columns, 3))
        columns, rows = np.meshgrid(np.arange(frame.columns), np.arange(frame.rows))
        for number in range(frame.samples // PASS):
            offsets = random.uniform(-0.5, 0.5, (2, PASS, *columns.shape)).astype(np.float32)
            vectors = rays(frame, columns + offsets[0], rows + offsets[1]).reshape(-1, 3)
            light = _sample(mi, scene, integrator, vectors, frame.seed * 4096 + number)
            total += light.reshape(PASS, *columns.shape, 3).sum(axis=0)
    return (total / frame.samples).astype(np.float32)


def _sample(mi: Any, scene: Any, integrator: Any, vectors: np.ndarray, seed: int) -> np.ndarray:
    """One sample of the light along each ray from the pinhole."""
    sampler = mi.load_dict({"type": "independent", "sample_count": 1})
    if mi.variant().startswith("scalar"):
        sampler.seed(seed)
        one = [integrator.sample(scene, sampler, mi.RayDifferential3f(mi.Ray3f([0, 0, 0], v)))[0]
               for v in vectors.tolist()]  # fmt: skip
        return np.array(one).reshape(-1, 3)
    sampler.seed(seed, len(vectors))
    along = mi.Vector3f(np.ascontiguousarray(vectors.T, np.float32))
    ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(0, 0, 0), along))
    light, _, _ = integrator.sample(scene, sampler, ray)
    return np.array(light).T


def trace_once(frame: Frame, folder: Path) -> np.ndarray:
    """`trace`, or what it found of the same frame before, kept in a folder as float16."""
    asked = json.dumps(asdict(frame), sort_keys=True).encode()
    kept = kept_arrays(
        folder, _sources() + asked, lambda: {"light": trace(frame).astype(np.float16)}
    )
    return kept["light"].astype(np.float32)


@functools.cache
def _sources() -> bytes:
    """The tracer itself: a frame that another one has traced is traced again."""
    return Path(__file__).read_bytes() + version("mitsuba").encode()


def expose(light: np.ndarray, gain: float, gamma: float = 1.0) -> np.ndarray:
    """Pixels of 8 bits: light times a gain, cut off at full scale, by a response curve."""
    return np.rint(255 * np.clip(gain * light, 0, 1) ** (1 / gamma)).astype(np.uint8)
