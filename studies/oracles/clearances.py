"""Clearances of a finger in section by polygon distances, from nothing but the finger's file.

Everything is written out a second time: the pins of a posture by circles that intersect, the
outlines as Shapely's geometries, what the layers mean, and the finger's section as a union of
rectangles and of sectors about the joints. Distances are exact but for those from these sectors,
whose arcs are polygons inside of them: 2e-4 mm.
"""

from __future__ import annotations

import cmath
import math
import tomllib
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

BARS = {
    "crank": ("F", "E", "K"),
    "rod": ("E", "D"),
    "plate": ("C", "D", "G'"),
    "bar": ("G", "G'"),
    "driver": ("M", "N"),
    "coupler": ("N", "K"),
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
"""The two bodies on every pin."""

SEAM = 1e-7
"""mm."""

ARC_STEPS = 256
"""Chords of a quarter turn."""

Complex = NDArray[np.complex128]
Places = dict[str, Complex]


class PolygonClearances(NamedTuple):
    """What a finger's parts keep in the postures of a square grid.

    Attributes:
        degrees: of either joint; PIP in rows.
        apart: least distance of outlines by pair of parts, mm, squares; where they overlap it is
            the negative sum of their roundings at most.
        inside: least distance of every bar's outline from the inner sides of faces and ends, mm;
            where it reaches out of the finger, that of the pin that is farthest out, negative.
        assembled: in which postures the linkage closes.
    """

    degrees: np.ndarray
    apart: dict[tuple[str, str], np.ndarray]
    inside: dict[str, np.ndarray]
    assembled: np.ndarray

    @property
    def least_apart(self) -> float:
        """Least of all pairs and postures, mm."""
        return float(min(np.min(one) for one in self.apart.values()))

    @property
    def least_inside(self) -> float:
        """Least of all bars and postures, mm."""
        return float(min(np.min(one) for one in self.inside.values()))


def polygon_clearances(path: str | Path, steps: int = 91) -> PolygonClearances:
    """Clearances of the finger of a file.

    Args:
        path: of ``finger.toml``.
        steps: angles of each joint, from straight to the end of its range.
    """
    tables = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    links, body = tables["links"], tables["body"]
    degrees = np.linspace(0.0, body["range_deg"], steps)
    pip, dip = (np.deg2rad(part).ravel() for part in np.meshgrid(degrees, degrees, indexing="ij"))
    places = pin_places(tables, pip, dip)
    ok = np.all([np.isfinite(place) for place in places.values()], axis=0)
    radius, axle = links["bar_width"] / 2, links["axle_diameter"] / 2
    hulls = {
        bar: _hulls([places[pin] for pin in pins if pin in places])
        for bar, pins in BARS.items()
        if all(pin in places for pin in pins[:2])
    }
    points = {pin: shapely.points(places[pin].real, places[pin].imag) for pin in ("A", "B")}
    square = (steps, steps)
    apart = {}
    for one, other in meeting_parts(links, list(hulls)):
        second, rounding = (hulls[other], radius) if other in hulls else (points[other], axle)
        distance = shapely.distance(hulls[one], second) - radius - rounding
        apart[one, other] = np.where(ok, distance, -np.inf).reshape(square)
    inside = {}
    sections = {hand: _sections(body, pip, dip, hand=hand) for hand in (False, True)}
    for bar, hull in hulls.items():
        section = sections[bar in ("driver", "coupler")]
        within = shapely.distance(hull, shapely.boundary(section))
        pins = [places[pin] for pin in BARS[bar] if pin in places]
        beyond = [shapely.distance(shapely.points(at.real, at.imag), section) for at in pins]
        edge = np.where(shapely.covers(section, hull), within, -np.max(beyond, axis=0))
        inside[bar] = (np.where(ok, edge, -np.inf) - radius - links["shell"]).reshape(square)
    return PolygonClearances(degrees, apart, inside, ok.reshape(square))


def meeting_parts(links: dict[str, Any], bars: list[str]) -> list[tuple[str, str]]:
    """Bars that lie in one layer, and bars in a layer that an axle crosses."""
    layer = {part: number for number, parts in enumerate(links["layers"]) for part in parts}
    pairs = [
        (one, other)
        for one, other in combinations(bars, 2)
        if layer[one] == layer[other] and not set(BARS[one]) & set(BARS[other])
    ]
    for axle in ("A", "B"):
        low, high = sorted(layer[body] for body in CARRIERS[axle])
        pairs += [(bar, axle) for bar in bars if low < layer[bar] < high]
    return pairs


def pin_places(tables: dict[str, Any], pip: np.ndarray, dip: np.ndarray) -> Places:
    """Places of all pins in the proximal phalanx's frame, as complex numbers; NaN if none.

    Args:
        tables: of the file.
        pip: flexion, rad.
        dip: of the other joint.
    """
    straight = {pin: complex(*place) for pin, place in tables["pins"].items()}
    middle = complex(tables["body"]["intermediate"])
    knuckle, flexion = np.exp(-1j * pip), np.exp(-1j * dip)
    c = middle + (straight["C"] - middle) * flexion
    g = np.full_like(c, straight["G"])
    h = _third(g, c, "G", "C", "G'", straight)
    plate = (h - c) / (straight["G'"] - straight["C"])
    d = c + (straight["D"] - straight["C"]) * plate
    places = {pin: at * knuckle for pin, at in {"C": c, "D": d, "G": g, "G'": h}.items()}
    places["A"], places["B"] = np.zeros_like(c), middle * knuckle
    places["F"] = np.full_like(c, straight["F"])
    places["E"] = _third(places["F"], places["D"], "F", "D", "E", straight)
    if "K" in straight:
        arm = straight["K"] - straight["F"]
        turn = (places["E"] - places["F"]) / (straight["E"] - straight["F"])
        motor = tables["motor"]
        axis = complex(
            -tables["body"]["proximal"] - motor["behind"], straight["F"].imag + motor["above"]
        )
        places["M"] = np.full_like(c, axis)
        places["K"], places["N"] = places["F"] + arm * turn, places["M"] + arm * turn
    return places


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
    stacked = np.stack([np.stack([one.real, one.imag], axis=-1) for one in corners], axis=1)
    stacked = np.where(np.isfinite(stacked), stacked, 0.0)
    return shapely.convex_hull(shapely.multipoints(stacked))


def _sections(
    body: dict[str, float], pip: np.ndarray, dip: np.ndarray, *, hand: bool
) -> np.ndarray:
    """The finger's section in every posture; with the hand behind it, between the same faces."""
    low, high = -body["axis_height"], body["thickness"] - body["axis_height"]
    rear = -(10 if hand else 1) * body["proximal"]
    spans = ((rear, 0.0), (0.0, body["intermediate"]), (0.0, body["distal"]))
    found = []
    for first, second in zip(pip.tolist(), dip.tolist(), strict=True):
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
    return np.array(found)


def _polygon(corners: list[complex]) -> shapely.Polygon:
    return shapely.Polygon([(one.real, one.imag) for one in corners])
