"""Parts to make: prisms across the plane of a drawing, in mm, in no file format."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from designopt.export.arcs import CHORD, arc_line, segment_area
from designopt.export.drawing import Place
from designopt.io.csv_text import csv_text

Disc = tuple[float, float, float]
"""x, y and radius, mm; of a corner the radius is 0."""


ROUNDING = 1e-9
"""A turn so little less than none is none, rad."""


class Outline(NamedTuple):
    """A closed line of straight edges and arcs, counter-clockwise.

    Attributes:
        places: its vertices.
        bulges: of the edge that begins at each vertex, the tangent of a quarter of its arc's angle,
            as in DXF; 0 where it is straight, positive where the arc is counter-clockwise.
    """

    places: tuple[Place, ...]
    bulges: tuple[float, ...]

    @property
    def area(self) -> float:
        """What it encloses, mm²; negative where it is clockwise."""
        total = 0.0
        for number, bulge in enumerate(self.bulges):
            start, end = self.places[number], self.places[(number + 1) % len(self.places)]
            total += (start[0] * end[1] - end[0] * start[1]) / 2
            total += segment_area(start, end, bulge)
        return total

    def line(self, chord: float = CHORD) -> list[Place]:
        """Its vertices, and places on its arcs so near that no chord is farther off, mm."""
        return arc_line(self.places, self.bulges, closed=True, chord=chord)


class Hole(NamedTuple):
    """A round hole through a prism, by the name of what is in it."""

    center: Place
    radius: float
    name: str = ""


class Prism(NamedTuple):
    """An outline that is extruded across the plane.

    Attributes:
        outline: of it.
        across: where it begins and ends, mm.
        holes: through it.
    """

    outline: Outline
    across: tuple[float, float]
    holes: tuple[Hole, ...] = ()

    @property
    def volume(self) -> float:
        """mm³."""
        low, high = self.across
        holes = sum(math.pi * hole.radius**2 for hole in self.holes)
        return (self.outline.area - holes) * (high - low)


class Part(NamedTuple):
    """A solid: the union of some prisms, less others.

    Attributes:
        name: unique.
        item: what it is on a bill of materials; pieces of one item are equal.
        body: that it moves with.
        material: of it.
        size: its size in words, for the bill.
        prisms: what it is made of.
        cuts: what is taken away from them.
        color: ``#RRGGBB``.
        shell: whether it holds the others, which pictures show without it.
    """

    name: str
    item: str
    body: str
    material: str
    size: str
    prisms: tuple[Prism, ...]
    cuts: tuple[Prism, ...] = ()
    color: str = "#8A8A8A"
    shell: bool = False


class BillRow(NamedTuple):
    """A row of a bill of materials: an item, of what, in what size, and how many."""

    item: str
    material: str
    size: str
    pieces: int


class Span(NamedTuple):
    """What lies between two places across, mm."""

    parts: str
    low: float
    high: float


class Assembly(NamedTuple):
    """A design as parts to make and to buy.

    Attributes:
        name: of it.
        parts: solids, where they are when it is assembled.
        others: what is bought besides and has no solid.
        spans: from the middle outwards, what lies at either side of the middle plane.
        order: in which it is put together, in words.
    """

    name: str
    parts: Sequence[Part]
    others: Sequence[BillRow]
    spans: Sequence[Span]
    order: str

    def bill(self) -> list[BillRow]:
        """Every item once: those that parts are pieces of, with their counts, then the others."""
        counts = Counter((part.item, part.material, part.size) for part in self.parts)
        return [*(BillRow(*item, count) for item, count in counts.items()), *self.others]


def bill_text(assembly: Assembly) -> str:
    """The bill of materials as CSV."""
    return csv_text([BillRow._fields, *assembly.bill()])


def around(*discs: Disc) -> Outline:
    """The outline around discs in counter-clockwise order: arcs about them, tangents between.

    Where a disc's radius is 0 it is a corner, convex or not.

    Raises:
        ValueError: one of two neighbours lies inside the other, so that they have no tangent.

    Example:
        >>> bar = around((0.0, 0.0, 2.0), (10.0, 0.0, 2.0))
        >>> round(bar.area - 40 - 4 * math.pi, 9)
        0.0
    """
    if len(discs) == 1:
        return circle(*discs[0])
    places: list[Place] = []
    bulges: list[float] = []
    turns = [
        _tangent_turn(one, discs[(number + 1) % len(discs)]) for number, one in enumerate(discs)
    ]
    for number, (x, y, radius) in enumerate(discs):
        before, after = turns[number - 1], turns[number]
        angle = (after - before) % (2 * math.pi)
        if radius == 0.0 or min(angle, 2 * math.pi - angle) < ROUNDING:
            places.append(_on_disc((x, y, radius), after))
            bulges.append(0.0)
            continue
        places += [_on_disc((x, y, radius), before), _on_disc((x, y, radius), after)]
        bulges += [math.tan(angle / 4), 0.0]
    return Outline(tuple(places), tuple(bulges))


def circle(x: float, y: float, radius: float) -> Outline:
    """A full circle, as two arcs."""
    return Outline(((x + radius, y), (x - radius, y)), (1.0, 1.0))


def hull(*discs: Disc) -> Outline:
    """The outline around all discs, whatever their order; see `wrapped`.

    Example:
        >>> len(hull((0.0, 0.0, 1.0), (1.0, 0.1, 0.0), (10.0, 0.0, 2.0)).places)
        4
    """
    return around(*wrapped(*discs))


def polygon(*places: Iterable[float]) -> Outline:
    """The convex polygon around places, whatever their order.

    Example:
        >>> polygon((0, 0), (2, 1), (2, 0), (0, 1)).area
        2.0
    """
    return hull(*((float(x), float(y), 0.0) for x, y in places))


def wrapped(*discs: Disc) -> list[Disc]:
    """The discs that the hull of some touches, counter-clockwise; one may come twice."""
    # Gift wrapping: of all tangents from a disc the one that turns least has all others left.
    outer = [
        one
        for number, one in enumerate(discs)
        if not any(_is_inside(one, other) for other in [*discs[:number], *discs[number + 1 :]])
    ]
    last = min(outer, key=lambda disc: disc[1] - disc[2])
    found, turned = [last], 0.0
    while len(outer) > 1:
        turns = {
            other: (_direction(last, other) - turned + ROUNDING) % (2 * math.pi) - ROUNDING
            for other in outer
            if other != last
        }
        last = min(turns, key=lambda other: (round(turns[other], 9), -_apart(found[-1], other)))
        turned += turns[last]
        if turned > 2 * math.pi - ROUNDING:
            break
        found.append(last)
    return found[:-1] if len(found) > 1 and found[-1] == found[0] else found


def _apart(one: Disc, other: Disc) -> float:
    return math.dist(one[:2], other[:2])


def _is_inside(one: Disc, other: Disc) -> bool:
    return one != other and _apart(one, other) + one[2] <= other[2]


def _direction(one: Disc, other: Disc) -> float:
    """Direction of the tangent that has both discs on its left, rad."""
    between = math.atan2(other[1] - one[1], other[0] - one[0])
    apart, grown = _apart(one, other), other[2] - one[2]
    if abs(grown) > apart:
        raise ValueError(f"no tangent of {one} and {other}: one lies inside the other")
    return between + math.asin(-grown / apart) if apart else between


def _tangent_turn(one: Disc, other: Disc) -> float:
    """Direction from a disc's middle to where that tangent touches it, rad."""
    return _direction(one, other) - math.pi / 2


def _on_disc(disc: Disc, direction: float) -> Place:
    x, y, radius = disc
    return x + radius * math.cos(direction), y + radius * math.sin(direction)
