"""Random scenes of pads under clear layers, as tables of a scene file and as plain numbers."""

from __future__ import annotations

import cmath
import copy
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from studies.oracles.layers import AIR, Layer, Pad, Pair, Scene, Surface

SIDES = {"left": 1, "right": -1, "both": 0}
OTHER = {"left": "right", "right": "left", "both": "both"}

CLEAR = 5.0
"""Of how far the entrance pupil moves, how far away all else is at least."""

EDGE_ON = 1e-6
"""mm: a pad's line that is nearer to the camera goes through it."""

Tables = dict[str, Any]
"""A scene file as TOML gives it."""


def read(tables: Mapping[str, Any], colour: str = "green") -> Scene:
    """The scene of a file without frames, in the light of a colour."""
    camera = tables["camera"]
    return Scene(
        complex(*camera["position"]),
        np.exp(1j * np.radians(camera["direction_deg"])),
        np.radians(camera["fov_deg"]) / 2,
        [_mirror(table, colour) for table in tables.get("mirrors", ())],
        [_pad(table, colour) for table in tables["pads"]],
        [_surface(table) for table in tables.get("blockers", ())],
        tables["scene"]["bounces"],
        tuple(camera.get("pupil_shift", (0.0, 0.0))),
    )


def posed_tables(tables: Tables, degrees: Mapping[str, float]) -> Tables:
    """The tables of a scene in a pose, without frames; each of them is hinged in what stands still.

    Args:
        tables: of the scene.
        degrees: its joint angles by name.
    """
    posed = copy.deepcopy(tables)
    surfaces = [*posed.get("mirrors", []), *posed["pads"], *posed["blockers"]]
    for part in [posed["camera"], *surfaces]:
        frame = posed["frames"].get(part.pop("body", None))
        if frame is None:
            continue
        sign = -1 if frame.get("positive") == "clockwise" else 1
        hinge, angle = complex(*frame["hinge"]), sign * degrees[frame["angle"]]
        turn = cmath.rect(1.0, math.radians(angle))
        for key in {"position", "from", "to"} & part.keys():
            place = hinge + turn * (complex(*part[key]) - hinge)
            part[key] = [place.real, place.imag]
        if "direction_deg" in part:
            part["direction_deg"] += angle
    del posed["frames"]
    return posed


def _surface(table: Mapping[str, Any]) -> Surface:
    side = SIDES[table.get("side", "both")]
    return Surface(complex(*table["from"]), complex(*table["to"]), side)


def _mirror(table: Mapping[str, Any], colour: str) -> Surface:
    layers = tuple(_layer(layer, colour) for layer in table.get("layers", ()))
    return _surface(table)._replace(layers=layers)


def _pad(table: Mapping[str, Any], colour: str) -> Pad:
    layers = tuple(_layer(layer, colour) for layer in table.get("layers", ()))
    bezel = table.get("bezel", {"lip": 0, "height": 0})
    return Pad(
        *_surface(table)[:3],
        np.radians(table.get("min_grazing_deg", 0.0)),
        table.get("min_transmission", 0.3 if layers else 0.0),
        layers,
        _pair(bezel["lip"]),
        bezel["height"],
    )


def _layer(table: Mapping[str, Any], colour: str) -> Layer:
    index, sides = table["index"], table.get("sides", "black")
    if isinstance(sides, str):
        sides = {"from": sides, "to": sides}
    return Layer(
        table["thickness"],
        index[colour] if isinstance(index, Mapping) else index,
        _pair(table.get("overhang", 0)),
        _pair(np.radians(table.get("bevel_deg", 0))),
        (sides.get("from") == "clear", sides.get("to") == "clear"),
    )


def _pair(value: Any) -> Pair:
    """Of both ends, from one number for both or one for each."""
    start, end = np.broadcast_to(value, 2).tolist()
    return start, end


def random_scene(rng: np.random.Generator, structure: int | None = None) -> tuple[Scene, Tables]:
    """A scene the size of a finger: its plain numbers, and its tables.

    One to three pads in a chain, most of them under one to three layers of 0 to 8 mm in all; a
    camera over one of them, just above its outermost surface or beside its end; up to two mirrors
    that show it a pad, and up to three blockers on its way. No two pads or mirrors cross, and the
    camera is in air.

    Args:
        rng: draws all numbers.
        structure: seed of everything else: how many parts there are, their sides, which ends are
            clear; ``rng`` draws that too by default.
    """
    while True:
        shape = rng if structure is None else np.random.default_rng(structure)
        tables = _tables(rng, shape)
        scene = read(tables)
        if _buildable(scene):
            return scene, tables


def sliding_scene(
    rng: np.random.Generator,
    structure: int | None = None,
    *,
    pupil: bool = True,
    sheets: bool = True,
    layers: bool = True,
) -> tuple[Scene, Tables]:
    """As `random_scene`, but rays slide: the entrance pupil moves, or mirrors are sheets.

    The pupil moves by up to 1 mm at 80°, and by no more than a part of the distance of what is
    nearest; sheets are up to 1 mm thick.

    Args:
        rng: as there.
        structure: as there.
        pupil: whether the pupil moves.
        sheets: whether mirrors have layers.
        layers: whether pads may have layers.
    """
    while True:
        shape = rng if structure is None else np.random.default_rng(structure)
        tables = _tables(rng, shape)
        if not layers:
            for pad in tables["pads"]:
                for key in ("layers", "bezel", "min_transmission"):
                    pad.pop(key, None)
        if pupil:
            shift, part = 10 ** rng.uniform(-2, 0) * rng.choice([-1, 1]), rng.uniform()
            square = np.radians(80) ** 2
            shifts = shift * part / square, shift * (1 - part) / square**2
            tables["camera"]["pupil_shift"] = [float(number) for number in shifts]
        for mirror in tables["mirrors"] if sheets else ():
            count = shape.integers(0, 3)
            if count and mirror["side"] != "both":
                parts = (rng.uniform(0, 1) * rng.dirichlet(np.ones(count))).tolist()
                mirror["layers"] = [
                    {"thickness": part, "index": rng.uniform(1, 1.8)} for part in parts
                ]
        scene = read(tables)
        if _buildable(scene) and _apart(scene):
            return scene, tables


def _apart(scene: Scene) -> bool:
    """Whether all that a ray meets is farther from the camera than rays cross.

    And no pad is seen exactly edge-on, which a moving pupil turns into a view too narrow for a fan.
    """
    ends = np.array([(face.start, face.end) for face in scene.faces])
    step, away = ends[:, 1] - ends[:, 0], scene.camera - ends[:, 0]
    part = np.clip(np.real(np.conj(step) * away) / np.abs(step) ** 2, 0, 1)
    moved = np.abs(scene.start(np.array([scene.half])) - scene.camera)
    height = np.abs(np.imag(np.conj(step) * away)) / np.abs(step)
    pads = np.array([face.part in ("membrane", "outer") for face in scene.faces])
    far = np.abs(away - part * step).min() > CLEAR * moved[0]
    return bool(far and height[pads].min() > EDGE_ON)


def _tables(rng: np.random.Generator, shape: np.random.Generator) -> Tables:
    chain, corner, along = [], 0j, 1 + 0j
    for _ in range(shape.integers(1, 4)):
        chain.append((corner, corner + along * rng.uniform(10, 40)))
        corner = chain[-1][1] + along * rng.uniform(3, 12)
        along *= np.exp(1j * rng.uniform(-0.9, 0.9))
    stacks = [_stack(rng, shape) for _ in chain]

    def target() -> complex:
        start, end = chain[rng.integers(len(chain))]
        return start + (end - start) * rng.uniform()

    camera = _camera(rng, chain, stacks)
    ahead = np.angle(target() - camera) + rng.normal(0, 0.4)
    middles = [target() + 1j * rng.uniform(5, 40) + rng.uniform(-20, 20) for _ in range(2)]
    if _chance(shape, 0.5):
        ways = [(camera, middles[0], middles[1]), (middles[0], middles[1], target())]
    else:
        ways = [(camera, middle, target()) for middle in middles[: shape.integers(3)]]
    mirrors = []
    for before, middle, after in ways:
        # The normal halves the angle of a way over the mirror's middle, more or less.
        forth, back = (step / abs(step) for step in (after - middle, before - middle))
        half = -1j * (forth + back) * np.exp(1j * rng.normal(0, 0.1))
        half *= rng.uniform(3, 20) / abs(half)
        mirrors.append((middle - half, middle + half))
    blockers = []
    for _ in range(shape.integers(4)):
        middle = camera + (target() - camera) * rng.uniform(0.2, 0.9)
        half = rng.uniform(0.3, 4) * np.exp(2j * np.pi * rng.uniform())
        blockers.append((middle - half, middle + half))

    place, turn, flipped = (
        complex(*rng.uniform(-50, 50, 2)),
        rng.uniform(0, 360),
        _chance(shape, 0.5),
    )

    def put(at: complex) -> list[float]:
        at = place + np.exp(1j * np.radians(turn)) * (at.conjugate() if flipped else at)
        return [float(at.real), float(at.imag)]

    def tables(kind: str, pairs: list[tuple[complex, complex]], both: float) -> list[Tables]:
        found = []
        for i, pair in enumerate(pairs):
            turned = _chance(shape, 0.5)
            side = "both" if _chance(shape, both) else ("right" if turned != flipped else "left")
            start, end = map(put, pair[::-1] if turned else pair)
            found.append({"name": f"{kind}{i}", "from": start, "to": end, "side": side})
        return found

    pads = tables("p", chain, 0.0)
    for pad, stack in zip(pads, stacks, strict=True):
        pad |= stack
        if "layers" not in stack and _chance(shape, 0.2):
            pad["side"] = "both"
    direction = turn + np.degrees(-ahead if flipped else ahead)
    return {
        "scene": {"bounces": int(shape.choice(3, p=[0.2, 0.3, 0.5]))},
        "camera": {
            "position": put(camera),
            "direction_deg": float(direction),
            "fov_deg": rng.uniform(40, 200),
            "pixels": 1000,
            "projection": "equidistant",
        },
        "mirrors": tables("m", mirrors, 0.1),
        "pads": pads,
        "blockers": tables("b", blockers, 0.5),
    }


def _camera(
    rng: np.random.Generator, chain: list[tuple[complex, complex]], stacks: list[Tables]
) -> complex:
    """Its position: over a pad, just above its outermost surface, or beside its end."""
    which = rng.integers(len(chain))
    start, end = chain[which]
    along, length = (end - start) / abs(end - start), abs(end - start)
    height = sum(layer["thickness"] for layer in stacks[which].get("layers", ()))
    kind = rng.choice(["over", "grazing", "beside"], p=[0.5, 0.3, 0.2])
    if kind == "over":
        above = rng.uniform(5, 60) * np.exp(1j * rng.uniform(0.1, np.pi - 0.1))
        return start + along * (length * rng.uniform() + above)
    if kind == "grazing":
        above = height + 10 ** rng.uniform(-2, 0.5)
        return start + along * (rng.uniform(-30, length) + 1j * above)
    return start - along * (rng.uniform(5, 40) - 1j * rng.uniform(0, height))


def _stack(rng: np.random.Generator, shape: np.random.Generator) -> Tables:
    """Limits, layers and bezel of a pad."""
    stack: Tables = {"min_grazing_deg": float(rng.choice([0.0, rng.uniform(0, 20)]))}
    if _chance(shape, 0.2):
        return stack
    thicknesses = rng.uniform(0, 8) * rng.dirichlet(np.ones(shape.integers(1, 4)))
    stack["layers"] = [_random_layer(rng, shape, thickness) for thickness in thicknesses.tolist()]
    limit = float(rng.choice([0.0, 0.3, rng.uniform(0.1, 0.6)]))
    if limit != 0.3:
        stack["min_transmission"] = limit
    if _chance(shape, 0.4):
        stack["bezel"] = {"lip": _one_or_two(rng, 0, 3), "height": rng.uniform(0, 2)}
    return stack


def _random_layer(rng: np.random.Generator, shape: np.random.Generator, thickness: float) -> Tables:
    index = 1.0 if _chance(rng, 0.05) else rng.uniform(1, 1.8)
    layer: Tables = {"thickness": thickness, "index": index}
    if _chance(rng, 0.2):
        layer["index"] = {"red": index, "green": index + 0.01, "blue": index + 0.02}
    if _chance(rng, 0.6):
        layer["overhang"] = _one_or_two(rng, 0, 4)
    if _chance(rng, 0.6):
        layer["bevel_deg"] = _one_or_two(rng, -45, 45)
    first, second = shape.choice(["clear", "black"], 2).tolist()
    if _chance(shape, 0.7):
        layer["sides"] = first if _chance(shape, 0.5) else {"from": first, "to": second}
    return layer


def _one_or_two(rng: np.random.Generator, low: float, high: float) -> float | list[float]:
    return rng.uniform(low, high) if _chance(rng, 0.5) else rng.uniform(low, high, 2).tolist()


def _chance(rng: np.random.Generator, probability: float) -> bool:
    return bool(rng.random() < probability)


def _buildable(scene: Scene) -> bool:
    """Whether all layers have a length, no pads or mirrors cross, and the camera is in air."""
    for pad in scene.pads:
        spans = [layer.spans(abs(pad.end - pad.start))[1] for layer in pad.layers]
        lips = [sum(pad.lip), *[0.0] * len(spans)]
        if any(stop - start <= lip for (start, stop), lip in zip(spans, lips, strict=False)):
            return False
    faces = [face for face in scene.faces if face.front == AIR and face.owner[0] != "b"]
    names, starts, ends, sides = zip(
        *((f.owner, f.start, f.end, f.side) for f in faces), strict=True
    )
    owner, start, end = np.unique(names, return_inverse=True)[1], np.array(starts), np.array(ends)
    # Of an outline that the camera is within, all faces together turn once around it.
    turns = np.angle((end - scene.camera) / (start - scene.camera)) * np.array(sides)
    if np.any(np.abs(np.bincount(owner, turns)) > np.pi):
        return False
    step = (end - start)[:, None]
    ahead, behind = (np.imag(np.conj(step) * (place - start[:, None])) for place in (end, start))
    apart = ahead * behind < 0  # the line of one has the ends of the other on both sides
    return not np.any(apart & apart.T & (owner[:, None] != owner))
