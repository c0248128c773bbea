"""Light on membranes: from line lamps, by way of layers, round again and again.

A membrane is matt. From a grid of its places, rays go out in all directions and are followed within
the layers to lamps and back to the membrane: sums over them are the irradiance by each lamp and the
light that places send each other, and a linear system the light that has gone round (radiosity:
Cohen and Wallace, 1993). In air there is only the integral over the lamp.

Where something is pressed in, light from a lamp is that on the flat membrane times the ratio of the
two under light that goes straight from the lamp, or by the uppermost level, to the membrane: the
true normals and shadows, for rays that are not bent.
"""

from __future__ import annotations

import functools
import json
from typing import NamedTuple

import numpy as np
import scipy.ndimage

from studies.oracles.judge.capture import Capture
from studies.oracles.judge.contacts import Contacts
from studies.oracles.judge.solids import FOOT, GAP, TOP, WIDTH, Tables
from studies.oracles.judge.tracing import Tracer, Walls

ALBEDO = 0.5
"""Of a membrane: what it sends back of the light that it meets."""

COLORS = np.array([[1.0, 0.06, 0.02], [0.02, 0.5, 0.03], [0.02, 0.08, 1.0]])
"""Radiance of the lamps in red, green and blue; the one at the end "from" is the weaker one."""

NODES, RAYS = 1.0, 987
"""Distance of places from which rays go out, mm, and how many do."""

GRID, FINE = 0.25, 0.05
"""Step of the grid on which light is kept, mm, without and with contacts."""

SHADED, LIFTED = 0.2, 0.05
"""Shading by lamps is computed on a grid of this step, mm, but at every place that is lifted by
more than this, mm: a pin's flank is as broad as a few tenths of a mm."""

INSET = 0.02
"""Rays go out so far inside the membrane's outline and above it, mm."""

PIECES = 160
"""Of a lamp in air."""

SHADOW_PIECES, SHADOW_STEPS = 10, 14
"""Of a lamp that throws shadows, and steps of the way to it."""


class MembraneLight(NamedTuple):
    """What a membrane sends to the camera.

    Attributes:
        length: of the membrane, mm.
        half: half its width, mm.
        values: radiance in red, green and blue, shape (along, across, 3), on equal steps between
            its edges.
    """

    length: float
    half: float
    values: np.ndarray

    def at(self, along: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Radiance at places, shape (places, 3)."""
        rows, columns = self.values.shape[:2]
        u = along / self.length * (rows - 1)
        v = (across / self.half + 1) / 2 * (columns - 1)
        places = np.stack([u, v])
        return np.stack(
            [
                scipy.ndimage.map_coordinates(self.values[..., i], places, order=1, mode="nearest")
                for i in range(3)
            ],
            axis=-1,
        )


def light_membranes(tables: Tables, capture: Capture) -> tuple[list[MembraneLight], float]:
    """The light of every pad's membrane, and what its unit is: lamps are as bright as `COLORS`.

    Raises:
        ValueError: no lamp lights any membrane.
    """
    contacts = Contacts(tables, capture.contacts)
    kept = ("from", "to", "side", "width", "layers", "bezel")
    found = []
    for i, pad in enumerate(tables.get("pads", [])):
        own = {name: pad[name] for name in kept if name in pad}
        pressed = [one._replace(pad="") for one in contacts.of(i)]
        light = _light_once(json.dumps([own, capture.light, capture.coupling]))
        found.append(_press(own, light, pressed, capture))
    if capture.light == "even":
        return found, 1.0
    brightest = np.concatenate([one.values.max(axis=-1).ravel() for one in found])
    level = float(np.quantile(brightest, 0.99))
    if level == 0:
        raise ValueError("no lamp lights a membrane: layers have no clear sides")
    return found, 1 / level


class FlatLight(NamedTuple):
    """On a flat membrane: radiance by each lamp directly, and of light that goes round.

    Arrays are of the shape (along, across, 3), the first over lamps, the second over colors.
    """

    length: float
    half: float
    direct: np.ndarray
    round_: np.ndarray


@functools.lru_cache(maxsize=64)
def _light_once(asked: str) -> FlatLight:
    pad, light, coupling = json.loads(asked)
    length = float(np.hypot(*np.subtract(pad["to"], pad["from"])))
    half = pad.get("width", WIDTH) / 2
    if light == "even":
        flat = np.zeros((2, 2, 3))
        return FlatLight(length, half, flat, flat + 1)
    if not pad.get("layers"):
        along, across = _grid(length, half, GRID)
        direct = ALBEDO * np.stack(
            [air_irradiance(length, half, lamp, along, across) for lamp in range(3)], axis=-1
        )
        return FlatLight(length, half, direct, np.zeros_like(direct))
    return _light_layers(pad, length, half, coupling)


def _grid(length: float, half: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Places at nearly such steps, edges among them."""
    along = np.linspace(0, length, int(np.ceil(length / step)) + 1)
    across = np.linspace(-half, half, int(np.ceil(2 * half / step)) + 1)
    first, second = np.meshgrid(along, across, indexing="ij")
    return first, second


def lamp_points(
    length: float, half: float, lamp: int, pieces: int, heights: np.ndarray, gap: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Middles of a lamp's pieces (along, across, height), where it shines to, and its length."""
    if lamp == 1:
        extent, to = 2 * half, np.array([1.0, 0.0])
        middles = [(-gap, (i + 0.5) / pieces * extent - half) for i in range(pieces)]
    else:
        extent, side = length, 1 if lamp == 0 else -1
        to = np.array([0.0, -side])
        middles = [((i + 0.5) / pieces * extent, side * (half + gap)) for i in range(pieces)]
    points = [(x, z, height) for x, z in middles for height in heights]
    return np.array(points), np.append(to, 0.0), extent


def air_irradiance(
    length: float, half: float, lamp: int, along: np.ndarray, across: np.ndarray
) -> np.ndarray:
    """Of a flat membrane in air by a lamp of unit radiance, over π."""
    rows = 4
    heights = FOOT + (np.arange(rows) + 0.5) / rows * (TOP - FOOT)
    points, to, extent = lamp_points(length, half, lamp, PIECES, heights, GAP)
    area = extent / PIECES * (TOP - FOOT) / rows
    found = np.zeros(along.shape)
    for x, z, y in points:
        ways = x - along, z - across
        square = ways[0] ** 2 + ways[1] ** 2 + y * y
        sent = -(ways[0] * to[0] + ways[1] * to[1])
        found += area * np.maximum(sent, 0) * y / square**2
    return found / np.pi


def _light_layers(pad: Tables, length: float, half: float, coupling: Walls) -> FlatLight:
    """By rays from a grid of places within the layers."""
    along, across = _grid(length, half, NODES)
    shape = along.shape
    inset = (
        np.clip(along, INSET, length - INSET).ravel(),
        np.clip(across, INSET - half, half - INSET).ravel(),
    )
    irradiance, exchange = gather_light(pad, length, half, inset, coupling, shape)
    # Light of one color: R = albedo (E + K R), of which the first is direct.
    direct, count = ALBEDO * irradiance, len(irradiance)
    sent = np.linalg.solve(np.eye(count) - ALBEDO * exchange, direct @ COLORS)
    round_ = ALBEDO * exchange @ sent
    smooth = [
        scipy.ndimage.gaussian_filter(one.reshape(*shape, 3), (0.6, 0.6, 0), mode="nearest")
        for one in (direct, round_)
    ]
    return FlatLight(length, half, *smooth)


def gather_light(
    pad: Tables, length: float, half: float, places: tuple[np.ndarray, np.ndarray],
    coupling: Walls, shape: tuple[int, ...],
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """What comes to places of a membrane behind layers, by rays that go out from them.

    Args:
        pad: its table.
        length: of the membrane, mm.
        half: half its width, mm.
        places: along and across, mm.
        coupling: of the lamps.
        shape: of the grid of places, along and across, whose light they exchange.

    Returns:
        Irradiance by each lamp of unit radiance, over π, shape (places, 3); and the share of the
        light of each place of the grid in that of each place, shape (places, grid).
    """
    scene = {"pads": [{**pad, "name": ""}]}
    start = np.array([*pad["from"], 0.0])
    tracer = Tracer(scene, {}, start, lamps=True)
    axes, count = tracer.axes(0), places[0].size
    # Evenly over the hemisphere: lamps lie low. A lattice, shifted from place to place.
    first, second = (np.arange(RAYS) + 0.5) / RAYS, np.arange(RAYS) * 610 / RAYS
    shifts = np.random.default_rng(0).random((2, count, 1))
    height, turn = (first + shifts[0]) % 1, 2 * np.pi * (second + shifts[1])
    flat = np.sqrt(1 - height**2)
    local = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=-1)
    origins = np.stack([*places, np.full(count, INSET)], axis=-1)
    irradiance, exchange = np.zeros((count, 3)), np.zeros((count, shape[0] * shape[1]))
    for part in np.array_split(np.arange(count), max(1, count * RAYS // 200_000)):
        ways = (local[part] @ axes).reshape(-1, 3)
        begin = np.repeat(origins[part] @ axes, RAYS, axis=0)
        traced = tracer.trace(ways, begin, np.zeros(len(ways), int), coupling)
        weight = 2 * height[part].ravel() / RAYS
        own = np.repeat(part, RAYS)
        np.add.at(irradiance, own, weight[:, None] * traced.glow)
        back = traced.reached
        u = np.clip(traced.along[back] / length, 0, 1) * (shape[0] - 1)
        v = np.clip(traced.across[back] / half / 2 + 0.5, 0, 1) * (shape[1] - 1)
        i, j = np.minimum(u.astype(int), shape[0] - 2), np.minimum(v.astype(int), shape[1] - 2)
        u, v, amount = u - i, v - j, (weight * traced.transmission)[back]
        for di, dj, share in (
            (0, 0, (1 - u) * (1 - v)), (0, 1, (1 - u) * v), (1, 0, u * (1 - v)), (1, 1, u * v)
        ):  # fmt: skip
            np.add.at(exchange, (own[back], (i + di) * shape[1] + j + dj), amount * share)
    return irradiance, exchange


def _press(pad: Tables, flat: FlatLight, pressed: list, capture: Capture) -> MembraneLight:
    """The light of a membrane with what is pressed into it, if anything is."""
    length, half = flat.length, flat.half
    direct, round_ = flat.direct, flat.round_
    if not pressed:
        return MembraneLight(length, half, direct @ COLORS + round_)
    along, across = _grid(length, half, FINE)
    resample = [MembraneLight(length, half, one).at(along.ravel(), across.ravel()) for one in
                (direct, round_)]  # fmt: skip
    direct, round_ = (one.reshape(*along.shape, 3) for one in resample)
    bulges = Contacts({"pads": [{**pad, "name": ""}]}, pressed)
    heights, normals = bulges.heights(0, along, across), bulges.normals(0, along, across)
    round_ = round_ * ((1 + normals[..., 2:]) / 2)
    if capture.light == "lamps":
        near, grid = heights > LIFTED, _grid(length, half, SHADED)
        shade = functools.partial(_shading, pad, length, half, heights, bulges, capture.heights)
        coarse = np.stack([shade(lamp, *grid) for lamp in range(3)], axis=-1)
        shading = MembraneLight(length, half, coarse).at(along.ravel(), across.ravel())
        shading = shading.reshape(direct.shape)
        places = along[near], across[near]
        shading[near] = np.stack([shade(lamp, *places) for lamp in range(3)], axis=-1)
        direct *= shading
    return MembraneLight(length, half, direct @ COLORS + round_)


def _shading(
    pad: Tables, length: float, half: float, surface: np.ndarray, bulges: Contacts, rows: int,
    lamp: int, along: np.ndarray, across: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Irradiance of places of the bulging membrane by a lamp over that of the flat one.

    The surface is the membrane's height on a grid between its edges, which throws shadows.
    """
    heights, normals = bulges.heights(0, along, across), bulges.normals(0, along, across)
    thickness = sum(layer["thickness"] for layer in pad.get("layers", []))
    low, high, gap = (0.0, 2 * thickness, 0.0) if thickness else (FOOT, TOP, GAP)
    levels = low + (np.arange(rows) + 0.5) / rows * (high - low)
    points, to, extent = lamp_points(length, half, lamp, SHADOW_PIECES, levels, gap)
    places = np.stack([along, across], axis=-1)
    steps = np.array([length, 2 * half]) / np.subtract(surface.shape, 1)
    bright, plain = np.zeros(along.shape), np.zeros(along.shape)
    for piece in points.reshape(SHADOW_PIECES, rows, 3):
        ways = piece[0, :2] - places
        horizon = np.full(along.shape, -np.inf)
        for share in (np.arange(SHADOW_STEPS) + 0.5) ** 2 / SHADOW_STEPS**2:
            spot = places + share * ways
            index = np.moveaxis((spot + np.array([0.0, half])) / steps, -1, 0)
            there = scipy.ndimage.map_coordinates(surface, index, order=1, mode="nearest")
            horizon = np.maximum(horizon, (there - heights) / share)
        # A piece is no point: half its length is the least distance.
        square = np.sum(ways**2, axis=-1) + (extent / SHADOW_PIECES / 2) ** 2
        sent = np.maximum(-(ways @ to[:2]), INSET)
        for height in piece[:, 2]:
            rise = height - heights
            plain += sent * height / (height**2 + square) ** 2
            toward = ways[..., 0] * normals[..., 0] + ways[..., 1] * normals[..., 1]
            toward += rise * normals[..., 2]
            # The horizon is that of the way's own length: rises over shares of it.
            free = (horizon < rise + 1e-3) & (rise > 0)
            bright += np.where(free, sent * np.maximum(toward, 0), 0) / (rise**2 + square) ** 2
    return bright / plain
