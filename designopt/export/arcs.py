"""Lines of straight edges and arcs, which are written as bulges, as in DXF.

A bulge is the tangent of a quarter of an arc's angle: 0 where the edge is straight, 1 for half a
circle, positive where the arc is counter-clockwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Place = tuple[float, float]
"""x and y, mm; y upwards."""

CHORD = 0.01
"""The farthest that chords in place of an arc may lie from it, mm."""


def arc_middle(start: Place, end: Place, bulge: float) -> Place:
    """The place half-way on an arc."""
    (x, y), (x_end, y_end) = start, end
    return (x + x_end + bulge * (y_end - y)) / 2, (y + y_end - bulge * (x_end - x)) / 2


def arc_radius(start: Place, end: Place, bulge: float) -> float:
    """Of an arc, mm."""
    return math.dist(start, end) / 2 / abs(math.sin(2 * math.atan(bulge)))


def segment_area(start: Place, end: Place, bulge: float) -> float:
    """Between an arc and its chord, mm²; negative where the arc is clockwise."""
    if bulge == 0.0:
        return 0.0
    angle, radius = 4 * math.atan(bulge), arc_radius(start, end, bulge)
    return radius * radius * (angle - math.sin(angle)) / 2


def arc_line(
    places: Sequence[Place], bulges: Sequence[float], *, closed: bool, chord: float = CHORD
) -> list[Place]:
    """A line's places, and others on its arcs.

    Args:
        places: its vertices.
        bulges: of the edge that begins at each vertex; those that are missing are 0.
        closed: whether an edge leads from the last vertex to the first.
        chord: the farthest that chords may lie from the arcs, mm.

    Example:
        >>> line = arc_line([(1.0, 0.0), (-1.0, 0.0)], [1.0], closed=False, chord=0.5)
        >>> [(round(x, 9), round(y, 9)) for x, y in line]
        [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)]
    """
    found: list[Place] = []
    for number, start in enumerate(places):
        found.append(start)
        bulge = bulges[number] if number < len(bulges) else 0.0
        if bulge and (closed or number + 1 < len(places)):
            found += _between(start, places[(number + 1) % len(places)], bulge, chord)
    return found


def _between(start: Place, end: Place, bulge: float, chord: float) -> list[Place]:
    angle, radius = 4 * math.atan(bulge), arc_radius(start, end, bulge)
    step = 2 * math.acos(max(1 - chord / radius, 0.0))
    count = max(math.ceil(abs(angle) / step), 1)
    # From the middle of its circle the chord is seen under the arc's angle.
    along = complex(*end) - complex(*start)
    middle = complex(*start) + along / 2 * (1 + 1j / math.tan(angle / 2))
    spoke = complex(*start) - middle
    turned = (
        middle + spoke * complex(math.cos(angle * n / count), math.sin(angle * n / count))
        for n in range(1, count)
    )
    return [(place.real, place.imag) for place in turned]
