"""A drawing to scale, in mm, without saying in which file format."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Container, Sequence
from typing import Literal, NamedTuple

from designopt.export.arcs import Place, arc_line

Kind = Literal["body", "mirror", "pad", "blocker", "camera", "construction", "path", "view"]
"""Of a layer; a path is what a point traces, a view is the light that reaches the camera."""


class Layer(NamedTuple):
    """Lines that belong together.

    Attributes:
        name: unique; a body's, or ``mirrors``, ``pads``, …
        kind: how it is drawn.
        framed: whether the picture is made to hold it; a camera 10 m away is left outside.
        color: ``#RRGGBB``; if empty it follows from the kind.
    """

    name: str
    kind: Kind
    framed: bool = True
    color: str = ""


class Polyline(NamedTuple):
    """A line through places, closed or not; ``bulges`` of its edges as in `designopt.export.arcs`.

    Without them all edges are straight. ``name`` is that of what it stands for; its layer's if
    empty.
    """

    layer: str
    places: Sequence[Place]
    closed: bool = False
    bulges: Sequence[float] = ()
    name: str = ""

    def line(self) -> list[Place]:
        """Its places, and more of them on its arcs."""
        return arc_line(self.places, self.bulges, closed=self.closed)


class Circle(NamedTuple):
    """A circle, such as a pin; ``name`` is that of what it stands for."""

    layer: str
    name: str
    center: Place
    radius: float


class Label(NamedTuple):
    """A text beside a place."""

    layer: str
    place: Place
    text: str


class LinearDimension(NamedTuple):
    """A dimension line between two places; the text is their distance."""

    start: Place
    end: Place


class Drawing(NamedTuple):
    """A drawing of a design in one pose.

    Attributes:
        title: of the drawing.
        layers: all layers, in order.
        polylines: lines.
        circles: circles.
        labels: texts.
        dimensions: those that a drawing sheet states.
        notes: further lines for the sheet's title block.
    """

    title: str
    layers: Sequence[Layer]
    polylines: Sequence[Polyline] = ()
    circles: Sequence[Circle] = ()
    labels: Sequence[Label] = ()
    dimensions: Sequence[LinearDimension] = ()
    notes: Sequence[str] = ()

    def box(self) -> tuple[Place, Place]:
        """Lower left and upper right corner of what the picture has to hold."""
        framed = {layer.name for layer in self.layers if layer.framed}
        places = [p for line in self.polylines if line.layer in framed for p in line.line()]
        for circle in self.circles:
            if circle.layer in framed:
                (x, y), radius = circle.center, circle.radius
                places += [(x - radius, y - radius), (x + radius, y + radius)]
        across, up = zip(*places, strict=True)
        return (min(across), min(up)), (max(across), max(up))


def round_down(value: float) -> float:
    """The largest of …, 0.1, 0.2, 0.5, 1, 2, 5, … that is not larger than a positive number."""
    decade = math.floor(math.log10(value))
    # A number that is one of them but for rounding is not taken for less.
    figure = max(n for n in (1, 2, 5, 10) if n <= value / 10.0**decade * (1 + 1e-9))
    return float(f"{figure}e{decade}")


def unused_name(
    stem: str, taken: Container[str], written: Callable[[str], str] = lambda name: name
) -> str:
    """The stem, or with the first number from 2 on that makes it a name that is not taken.

    Args:
        stem: the name that is wanted.
        taken: names that there are.
        written: how these are written, such as `str.lower` where a format ignores case.
    """
    numbered = (f"{stem}_{number}" for number in itertools.count(2))
    return next(name for name in itertools.chain([stem], numbered) if written(name) not in taken)
