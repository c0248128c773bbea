"""Clearances of a finger in section by polygon distances, from nothing but the finger's file.

Everything is written out a second time: the pins of a posture by circles that intersect, the
outlines as Shapely's geometries, what the layers mean, and the finger's section as a union of
rectangles and of sectors about the joints. Distances are exact but for those from these sectors,
whose arcs are polygons inside of them: 2e-4 mm.

At the sides of the finger bars meet each other, axles, and the palmar faces of all phalanges; in
the middle camera, mirrors and pads meet. All of them but the pads, which are the palmar side there,
lie inside the section. A part of the middle is a list of convex pieces in its phalanx's own frame:
from its joint's axis (that of the proximal phalanx is PIP) towards the tip and to the back.
"""

from __future__ import annotations

import cmath
import math
import tomllib
from collections.abc import Mapping
from itertools import combinations, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

BARS = {
    "crank": ("F", "E", "K"),
    "rod": ("E", "D"),
    "plate": ("C", "D", "G'"),
    "bar": ("G", "G'"),
    "driver": ("M", "N"),
    "coupler": ("N", "K"),
    "coupling": ("P", "Q"),
}
CARRIERS = {
    "A": ("proximal", "intermediate"),
    "B": ("intermediate", "distal"),
    "F": ("proximal", "crank"),
    "G": ("intermediate", "bar"),
    "C": ("distal", "plate"),
    "D": ("plate", "rod"),
    "E": ("rod", "crank"),
    "G'": ("bar", "plate"),
    "K": ("crank", "coupler"),
    "N": ("coupler", "driver"),
    "M": ("driver", "proximal"),
}
"""The two bodies on every pin of a six-bar."""

COUPLED_CARRIERS = {pin: CARRIERS[pin] for pin in "ABMN"} | {
    "P": ("proximal", "coupling"),
    "Q": ("distal", "coupling"),
    "K": ("intermediate", "coupler"),
}
"""Those of a coupled finger."""

PHALANGES = ("proximal", "intermediate", "distal")

SETBACK, BACK, MOUNT, WALL = 0.5, 4.0, 1.0, 0.5
"""Pinhole to the front and to the back of the camera's body, a mirror's mount, and the wall at the
outer ends of layers; all but the first where the file has none of its own, mm."""

SEAM = 1e-7
"""mm."""

STRETCH = 1e-6
"""A bar that is longer or shorter by so much is another, mm."""

ARC_STEPS = 256
"""Chords of a quarter turn."""

Complex = NDArray[np.complex128]
Places = dict[str, Complex]
Pieces = list[list[complex]]


class PolygonClearances(NamedTuple):
    """What a finger's parts keep in the postures of a grid, which has PIP in rows.

    Attributes:
        degrees: angles of PIP and of DIP.
        apart: least distance of outlines by pair of parts, mm. An array has one row where PIP does
            not matter, and one column where DIP does not. Where bars overlap it is the negative sum
            of their roundings at most; where parts without roundings do, the negative root of the
            area that they share.
        inside: least distance of the outlines of bars, camera and mirrors from the inner sides of
            faces and ends, mm, squares; where one reaches out of the finger, that of its corner
            that is farthest out, negative.
        assembled: in which postures the linkage closes, a square.
    """

    degrees: tuple[np.ndarray, np.ndarray]
    apart: dict[tuple[str, str], np.ndarray]
    inside: dict[str, np.ndarray]
    assembled: np.ndarray

    @property
    def bars_apart(self) -> float:
        """Least of all pairs with a bar and of all postures, mm."""
        return min(float(np.min(each)) for (one, _), each in self.apart.items() if one in BARS)

    @property
    def bars_inside(self) -> float:
        """Least of all bars and postures, mm."""
        return min(float(np.min(each)) for one, each in self.inside.items() if one in BARS)


def polygon_clearances(
    path: str | Path, steps: int = 91, *, degrees: tuple[ArrayLike, ArrayLike] | None = None
) -> PolygonClearances:
    """Clearances of the finger of a file; of its linkage only where it has links.

    Args:
        path: of ``finger.toml``.
        steps: angles of each joint, from straight to the end of its range.
        degrees: angles of PIP and of DIP instead of these.
    """
    tables = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    body, shell = tables["body"], tables.get("links", {}).get("shell", 0.0)
    given = degrees or tuple(np.linspace(0.0, end, steps) for end in joint_ranges(body))
    pip_deg, dip_deg = (np.asarray(part, float) for part in given)
    pip, dip = np.deg2rad(pip_deg)[:, None], np.deg2rad(dip_deg)[None, :]
    # In the frame of the intermediate phalanx one joint alone moves each of the others.
    frames = {
        "proximal": (0.0, np.exp(1j * pip)),
        "intermediate": (0.0, np.ones((1, 1), complex)),
        "distal": (body["intermediate"], np.exp(-1j * dip)),
    }
    faces, parts = palmar_faces(body, shell), middle_parts(tables)
    placed = {
        name: [[origin + turn * corner for corner in piece] for piece in pieces]
        for name, (phalanx, pieces) in (faces | parts).items()
        for origin, turn in [frames[phalanx]]
    }
    hulls = {name: [_hulls(piece) for piece in pieces] for name, pieces in placed.items()}
    apart = {
        (one, other): _between(hulls[one], hulls[other])
        for group in (faces, parts)
        for one, other in combinations(group, 2)
    }
    square = tuple(np.broadcast_arrays(pip, dip))
    section, knuckle = _sections(body, *square, hand=False), np.exp(-1j * pip)
    turned = {
        name: [[corner * knuckle for corner in piece] for piece in pieces]
        for name, pieces in placed.items()
    }
    inside = {
        name: _inside(section, turned[name]) - shell for name in parts if not name.endswith("pad")
    }
    ok = np.ones(section.shape, bool)
    if "links" in tables and "pins" in tables:
        places = pin_places(tables, *square)
        ok = np.all([np.isfinite(place) for place in places.values()], axis=0)
        slabs = {face: _hulls(turned[face][0]) for face in faces}
        between = _bars_apart(tables, places, slabs)
        apart |= {pair: np.where(ok, each, -np.inf) for pair, each in between.items()}
        hand = _sections(body, *square, hand=True) if "motor" in tables else section
        for bar, corners in _bars(places).items():
            edge = _inside(hand if bar in ("driver", "coupler") else section, [corners])
            edge -= tables["links"]["bar_width"] / 2 + shell
            inside[bar] = np.where(ok, edge, -np.inf)
    return PolygonClearances((pip_deg, dip_deg), apart, inside, ok)


def _bars(places: Places) -> dict[str, list[Complex]]:
    """Pins of the bars that the finger has."""
    there = {bar: [places[pin] for pin in pins if pin in places] for bar, pins in BARS.items()}
    return {bar: pins for bar, pins in there.items() if len(pins) > 1}


def _bars_apart(
    tables: dict[str, Any], places: Places, slabs: dict[str, np.ndarray]
) -> dict[tuple[str, str], np.ndarray]:
    """Clearances of bars from each other, from axles and from palmar faces, mm."""
    links = tables["links"]
    hulls = {bar: _hulls(corners) for bar, corners in _bars(places).items()}
    radius, found = links["bar_width"] / 2, {}
    for one, other in meeting_parts(tables, list(hulls)):
        if other in hulls:
            distance = shapely.distance(hulls[one], hulls[other]) - radius
        else:
            distance = shapely.distance(hulls[one], _hulls([places[other]]))
            distance -= links["axle_diameter" if other in "AB" else "pin_diameter"] / 2
        found[one, other] = distance - radius
    for bar, hull in hulls.items():
        found |= {
            (bar, face): shapely.distance(hull, slab) - radius for face, slab in slabs.items()
        }
    return found


def _between(first: list[Any], second: list[Any]) -> np.ndarray:
    """Least distance of any two pieces, or the negative root of the area that two share, mm."""
    found = []
    for one in first:
        for other in second:
            distance = shapely.distance(one, other)
            shared = np.zeros_like(distance)
            touch = distance == 0
            if touch.any():
                at, to = np.broadcast_arrays(one, other)
                shared[touch] = shapely.area(shapely.intersection(at[touch], to[touch]))
            found.append(distance - np.sqrt(shared))
    return np.min(found, axis=0)


def _inside(section: np.ndarray, pieces: list[list[Complex]]) -> np.ndarray:
    """Least distance from a section's boundary; negative: of the corner farthest outside, mm."""
    hulls, boundary = [_hulls(piece) for piece in pieces], shapely.boundary(section)
    within = np.min([shapely.distance(hull, boundary) for hull in hulls], axis=0)
    covered = np.all([shapely.covers(section, hull) for hull in hulls], axis=0)
    beyond = [shapely.distance(_hulls([at]), section) for piece in pieces for at in piece]
    return np.where(covered, within, -np.max(beyond, axis=0))


def joint_ranges(body: dict[str, Any]) -> tuple[float, float]:
    """Greatest flexion of PIP and DIP, degrees."""
    pip, dip = np.broadcast_to(body["range_deg"], 2).tolist()
    return pip, body.get("dip_range_deg", dip)


def pad_gaps(body: dict[str, Any]) -> tuple[float, float]:
    """From PIP and DIP axis to the pads and palmar faces beside it, mm.

    Their ends keep half of the clearance from the plane that halves the bent joint.
    """
    down = body["axis_height"] + body.get("protrusion", 0.0)
    half = body.get("pad_clearance", 0.0) / 2
    turns = [math.radians(end) / 2 for end in joint_ranges(body)]
    pip, dip = ((down * math.sin(turn) + half) / math.cos(turn) for turn in turns)
    return pip, dip


def palmar_faces(body: dict[str, Any], shell: float) -> dict[str, tuple[str, Pieces]]:
    """Phalanges and outlines of the palmar faces, which end at the joints where the pads do."""
    pip, dip = pad_gaps(body)
    spans = ((-body["proximal"], -pip), (pip, body["intermediate"] - dip), (dip, body["distal"]))
    low = -1j * body["axis_height"]
    return {
        f"palmar face of the {phalanx} phalanx": (
            phalanx,
            [[x + low + up for up in (0, 1j * shell) for x in span]],
        )
        for phalanx, span in zip(PHALANGES, spans, strict=True)
    }


def middle_parts(tables: dict[str, Any]) -> dict[str, tuple[str, Pieces]]:
    """Phalanges and pieces of camera, mirrors and pads."""
    body = tables["body"]
    dorsal = body["thickness"] - body["axis_height"]
    parts: dict[str, tuple[str, Pieces]] = {}
    if "camera" in tables:
        host = tables["camera"].get("phalanx", "intermediate")
        parts["camera"] = host, camera_pieces(tables["camera"], dorsal)
    mirrors: dict[str, tuple[str, Pieces]] = {}
    for mirror in tables.get("mirrors", ()):
        start, end = (complex(x, dorsal - depth) for x, depth in (mirror["from"], mirror["to"]))
        # A proximal mirror reflects on its left, others on their right: to the pads.
        behind = {"proximal": -1j, "intermediate": 1j, "distal": 1j}[mirror["phalanx"]]
        behind *= end - start
        mount = mirror.get("mount", MOUNT) * behind / abs(behind)
        corners = [start, end, end + mount, start + mount]
        number = sum(phalanx == mirror["phalanx"] for phalanx, _ in mirrors.values()) + 1
        name = mirror["phalanx"] + (f" {number}" if number > 1 else "")
        mirrors[f"{name} mirror"] = mirror["phalanx"], [corners]
    pads = pad_pieces(body, tables.get("pads", {}))
    parts |= mirrors
    return parts | {f"{phalanx} pad": (phalanx, pieces) for phalanx, pieces in pads.items()}


def camera_pieces(camera: dict[str, Any], dorsal: float) -> Pieces:
    """The camera's opaque body: a box, or as it is sold a barrel on a board.

    Raises:
        ValueError: its body is that of a catalogue, which is not in the file.
    """
    if "model" in camera:
        raise ValueError("camera: 'model' is a name; write the finger's file with its numbers")
    boxes = [(-SETBACK, -camera.get("back", BACK), camera["width"])]
    if (sold := camera.get("module")) is not None:
        front, foot = sold["pupil_depth"], sold["pupil_depth"] - sold["lens_length"]
        back = foot - sold["board_thickness"] - sold["connector_length"]
        boxes = [(front, foot, sold["lens_diameter"]), (foot, back, sold["board"][0])]
    pinhole = complex(camera["along"], dorsal - camera["depth"])
    ahead = cmath.exp(1j * math.radians(camera["tilt_deg"] - 90))
    return [
        [
            pinhole + ahead * complex(x, y)
            for x, y in ((a, -w / 2), (b, -w / 2), (b, w / 2), (a, w / 2))
        ]
        for a, b, w in boxes
    ]


def pad_pieces(body: dict[str, Any], pads: dict[str, Any]) -> dict[str, Pieces]:
    """Layers of every pad, from the membrane up; bare membranes are lines.

    At a joint an edge of a layer reaches beyond the membrane by its share of what the plane that
    halves the joint at its greatest flexion leaves, and half of the clearance in the straight one.
    """
    rim, half = body["rim"], body.get("pad_clearance", 0.0) / 2
    gaps, turns = pad_gaps(body), [math.radians(end) / 2 for end in joint_ranges(body)]

    def reach(end: int | None, layer: dict[str, Any], edge: int, level: float) -> float:
        if end is None:
            share = layer.get("outer_reach", (0.0, 0.0))[edge]
            return share * max(rim - pads.get("wall", WALL), 0.0)
        share = layer.get("reach", (0.0, 0.0))[edge]
        return share * min(level * math.tan(turns[end]), max(gaps[end] - half, 0.0))

    spans = {
        "proximal": ((rim - body["proximal"], None), (-gaps[0], 0)),
        "intermediate": ((gaps[0], 0), (body["intermediate"] - gaps[1], 1)),
        "distal": ((gaps[1], 1), (body["distal"] - rim, None)),
    }
    membrane = -1j * (body["axis_height"] + body.get("protrusion", 0.0))
    found: dict[str, Pieces] = {}
    for phalanx, ((start, one), (end, other)) in spans.items():
        level, found[phalanx] = 0.0, []
        for layer in reversed(pads.get("layers", [])):
            corners = []
            for edge, at in enumerate((level, level + layer["thickness"])):
                left, right = (reach(joint, layer, edge, at) for joint in (one, other))
                corners += [start - left + 1j * at + membrane, end + right + 1j * at + membrane]
            found[phalanx].append(corners)
            level += layer["thickness"]
        if level == 0:
            found[phalanx] = [[start + membrane, end + membrane]]
    return found


def is_coupled(tables: Mapping[str, Any]) -> bool:
    """Whether one bar P-Q makes DIP follow PIP."""
    return "P" in tables["pins"]


def carriers(tables: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    """The two bodies on every pin of a finger."""
    return COUPLED_CARRIERS if is_coupled(tables) else CARRIERS


def postures(tables: Mapping[str, Any], steps: int) -> list[tuple[float, float]]:
    """Angles of PIP and DIP that a finger reaches, degrees: all pairs, or one for each of PIP.

    Args:
        tables: of the file.
        steps: angles of a joint, from straight to the end of its range.
    """
    grids = [np.linspace(0.0, end, steps) for end in joint_ranges(tables["body"])]
    if not is_coupled(tables):
        return list(product(*(grid.tolist() for grid in grids)))
    pip = np.deg2rad(grids[0])
    straight = {pin: complex(*place) for pin, place in tables["pins"].items()}
    straight["B"] = complex(tables["body"]["intermediate"])
    b = straight["B"] * np.exp(-1j * pip)
    q = _third(np.full_like(b, straight["P"]), b, "P", "B", "Q", straight)
    dip = -np.angle((q - b) / (straight["Q"] - straight["B"]) * np.exp(1j * pip))
    return list(zip(grids[0].tolist(), np.rad2deg(dip).tolist(), strict=True))


def meeting_parts(tables: Mapping[str, Any], bars: list[str]) -> list[tuple[str, str]]:
    """Bars that lie in one layer, and bars in a layer that a pin or an axle crosses."""
    layers = tables["links"]["layers"]
    layer = {part: number for number, parts in enumerate(layers) for part in parts}
    pairs = [
        (one, other)
        for one, other in combinations(bars, 2)
        if layer[one] == layer[other] and not set(BARS[one]) & set(BARS[other])
    ]
    present = {*PHALANGES, *bars}
    for pin, bodies in carriers(tables).items():
        if present.issuperset(bodies):
            low, high = sorted(layer[body] for body in bodies)
            pairs += [(bar, pin) for bar in bars if low < layer[bar] < high]
    return pairs


def pin_places(tables: dict[str, Any], pip: np.ndarray, dip: np.ndarray) -> Places:
    """Places of all pins in the proximal phalanx's frame, as complex numbers; NaN if none.

    Those of a coupled finger are none where its bar P-Q is too long or too short.

    Args:
        tables: of the file.
        pip: flexion, rad.
        dip: of the other joint.
    """
    straight = {pin: complex(*place) for pin, place in tables["pins"].items()}
    middle = complex(tables["body"]["intermediate"])
    knuckle, flexion = np.exp(-1j * pip), np.exp(-1j * dip)
    if is_coupled(tables):
        q = (middle + (straight["Q"] - middle) * flexion) * knuckle
        p = np.full_like(q, straight["P"])
        stretched = np.abs(np.abs(q - p) - abs(straight["Q"] - straight["P"]))
        places = {"P": p, "Q": np.where(stretched < STRETCH, q, np.nan)}
        places |= {"A": np.zeros_like(q), "B": middle * knuckle}
        return places | _parallelogram(tables, straight, "A", places["A"], knuckle)
    c = middle + (straight["C"] - middle) * flexion
    g = np.full_like(c, straight["G"])
    h = _third(g, c, "G", "C", "G'", straight)
    plate = (h - c) / (straight["G'"] - straight["C"])
    d = c + (straight["D"] - straight["C"]) * plate
    places = {pin: at * knuckle for pin, at in {"C": c, "D": d, "G": g, "G'": h}.items()}
    places["A"], places["B"] = np.zeros_like(c), middle * knuckle
    places["F"] = np.full_like(c, straight["F"])
    places["E"] = _third(places["F"], places["D"], "F", "D", "E", straight)
    turn = (places["E"] - places["F"]) / (straight["E"] - straight["F"])
    return places | _parallelogram(tables, straight, "F", places["F"], turn)


def _parallelogram(
    tables: Mapping[str, Any],
    straight: dict[str, complex],
    shaft: str,
    center: Complex,
    turn: Complex,
) -> Places:
    """Pins of the motor's parallelogram, if there is one, by the turn of what the motor turns.

    Args:
        tables: of the file.
        straight: places of the straight finger.
        shaft: the pin about which that turns.
        center: its places.
        turn: of it.
    """
    if "K" not in straight:
        return {}
    middle, motor = straight.get(shaft, 0j), tables["motor"]
    arm = (straight["K"] - middle) * turn
    axis = complex(-tables["body"]["proximal"] - motor["behind"], middle.imag + motor["above"])
    return {"M": np.full_like(center, axis), "K": center + arm, "N": axis + arm}


def _third(
    one: Complex, other: Complex, first: str, second: str, pin: str, straight: dict[str, complex]
) -> Complex:
    """Where two links from two pins meet, on the side on which they do in the straight finger."""
    a, b, p = straight[first], straight[second], straight[pin]
    near, far = abs(p - a), abs(p - b)
    side = math.copysign(1, ((b - a).conjugate() * (p - a)).imag)
    span = np.abs(other - one)
    along = (span**2 + near**2 - far**2) / (2 * span)
    with np.errstate(invalid="ignore"):
        across = np.sqrt(near**2 - along**2)
    return one + (other - one) / span * (along + 1j * side * across)


def _hulls(corners: list[Complex]) -> Any:
    stacked = np.stack([np.stack([one.real, one.imag], axis=-1) for one in corners], axis=-2)
    stacked = np.where(np.isfinite(stacked), stacked, 0.0)
    return shapely.convex_hull(shapely.multipoints(stacked))


def _sections(body: dict[str, Any], pip: np.ndarray, dip: np.ndarray, *, hand: bool) -> np.ndarray:
    """The finger's section in every posture; with the hand behind it, between the same faces."""
    low, high = -body["axis_height"], body["thickness"] - body["axis_height"]
    rear = -(10 if hand else 1) * body["proximal"]
    spans = ((rear, 0.0), (0.0, body["intermediate"]), (0.0, body["distal"]))
    found = []
    for first, second in zip(pip.ravel().tolist(), dip.ravel().tolist(), strict=True):
        turns = (1.0, cmath.exp(-1j * first), cmath.exp(-1j * (first + second)))
        origins = (0.0, 0.0, body["intermediate"] * turns[1])
        parts = []
        for origin, turn, (begin, end) in zip(origins, turns, spans, strict=True):
            corners = (complex(begin, low), complex(end, low), complex(end, high))
            parts.append(_polygon([origin + turn * c for c in (*corners, complex(begin, high))]))
        for origin, turn, angle in ((0.0, 1.0, first), (origins[2], turns[1], second)):
            if angle > 0:
                steps = np.linspace(0, angle, max(2, math.ceil(ARC_STEPS * angle / (math.pi / 2))))
                arc = [origin + turn * 1j * high * cmath.exp(-1j * step) for step in steps]
                parts.append(_polygon([origin, *arc]))
        # Grown a little, so that no slit is left where two of them share an edge.
        found.append(shapely.unary_union(shapely.buffer(parts, SEAM, join_style="mitre")))
    return np.array(found).reshape(pip.shape)


def _polygon(corners: list[complex]) -> shapely.Polygon:
    return shapely.Polygon([(one.real, one.imag) for one in corners])
