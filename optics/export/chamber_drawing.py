"""A soft finger's chamber as a drawing to build from, and its numbers."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from designopt.export.drawing import (
    Circle,
    Drawing,
    Label,
    Layer,
    LinearDimension,
    Place,
    Polyline,
    round_down,
)
from designopt.export.json import Quantity
from optics.chamber.chamber import Chamber

if TYPE_CHECKING:
    from optics.chamber.designed import DesignedChamber

REGIONS = {"red": "AB", "blue": "BC", "yellow": "CD", "top": "DE"}
"""The wall's regions, each a layer, by the points between which they run."""

COLORS = ("#C0392B", "#0072B2", "#E0A800", "#8A8A8A")
"""Of the regions' lines."""

LINES, CAMERA = "construction", "camera"
"""Layers of the centre line and the reference ray, and of the pinhole."""

SIGN = 0.01
"""Radius of the pinhole's circle, as a part of the chamber's length."""

AROUND = 120
"""Edges that stand for a circle in the image, which is far smaller than a mm."""


def make_chamber_drawing(design: DesignedChamber) -> Drawing:
    """The section of a chamber's wall, by `draw_chamber`, with its imaging ratio."""
    ratio = design.chamber.imaging_ratio()
    notes = ["half of the wall's section over the centre line; D is counted to its other side"]
    if bool(ratio.ok):
        notes.append(f"imaging ratio {float(ratio.value):.6g}")
    return draw_chamber(design.chamber, title=design.name)._replace(notes=notes)


def draw_chamber(chamber: Chamber, *, title: str) -> Drawing:
    """The section of a chamber's wall: x along the centre line from A, y from the centre line.

    The wall's regions have layers of their own; the top reaches from D to the reference ray, where
    its image ends. The pinhole is a circle. Dimensions are lengths along the centre line, offsets
    of the wall, and where the pinhole is.

    Args:
        chamber: the chamber.
        title: of the drawing.
    """
    corners = _corners(chamber)
    pinhole = -float(chamber.pinhole_offset), -float(chamber.reference_height)
    end = corners["E"][0]
    low, high = min(pinhole[0], 0.0), max(end, pinhole[0])
    feet = {name: (x, 0.0) for name, (x, _) in corners.items() if name != "E"}
    chain = [(0.0, 0.0), *(feet[name] for name in "BCD")]
    measures = [*itertools.pairwise(chain), *((feet[n], corners[n]) for n in feet)]
    measures += [(pinhole, (0.0, pinhole[1])), ((0.0, pinhole[1]), (0.0, 0.0))]
    walls = [
        Polyline(name, [corners[end] for end in ends], name=_wall(name))
        for name, ends in REGIONS.items()
    ]
    return Drawing(
        title=title,
        layers=[
            *(
                Layer(name, "body", color=color)
                for name, color in zip(REGIONS, COLORS, strict=True)
            ),
            Layer(CAMERA, "camera"),
            Layer(LINES, "construction"),
        ],
        polylines=[
            *walls,
            Polyline(LINES, [(low, 0.0), (high, 0.0)], name="centre line"),
            Polyline(LINES, [(low, pinhole[1]), (high, pinhole[1])], name="reference ray"),
        ],
        circles=[Circle(CAMERA, "pinhole", pinhole, round_down(SIGN * (high - low)))],
        labels=[
            *(
                Label(next(region for region, ends in REGIONS.items() if name in ends), place, name)
                for name, place in corners.items()
            ),
            Label(CAMERA, pinhole, "pinhole"),
        ],
        dimensions=[LinearDimension(start, stop) for start, stop in measures if start != stop],
    )


def draw_light(chamber: Chamber) -> tuple[list[Layer], list[Polyline]]:
    """What the camera sees in a chamber's section: light of every region whose ring has a width.

    Returns:
        A layer of kind ``"view"`` for each, named ``light of blue``, and an outline on it: from the
        pinhole to both ends of the region.
    """
    corners = _corners(chamber)
    pinhole = -float(chamber.pinhole_offset), -float(chamber.reference_height)
    layers, outlines = [], []
    for (region, ends), color in list(zip(REGIONS.items(), COLORS, strict=True))[1:]:
        name = f"light of {region}"
        layers.append(Layer(name, "view", framed=False, color=color))
        places = [pinhole, *(corners[end] for end in ends)]
        outlines.append(Polyline(name, places, closed=True, name=_wall(region)))
    return layers, outlines


def draw_rings(chamber: Chamber, *, title: str) -> Drawing:
    """The image of a chamber on the sensor: its blue and yellow ring and its top, mm.

    Its middle is the image of the reference ray; where an image lies beyond it, there is no ring.
    The red wall reaches to the lens, farther out than any sensor, and is not drawn.

    Args:
        chamber: one with an image.
        title: of the drawing.
    """
    heights = np.asarray(chamber.image_heights().value, float)
    # Beyond f = v the image is turned over.
    radii = np.maximum(heights * np.sign(heights[0]), 0.0).tolist()
    regions = list(zip(REGIONS, COLORS, strict=True))[1:]
    layers, polylines, labels = [], [], []
    for (region, color), outer, inner in zip(regions, radii, [*radii[1:], 0.0], strict=True):
        layers.append(Layer(region, "view", color=color))
        name = "top" if region == "top" else f"{region} ring"
        if outer > inner:
            polylines.append(_ring(region, name, outer, inner))
            labels.append(Label(region, (0.0, (outer + inner) / 2), name))
    if not polylines:
        # A picture has some extent, even where nothing is imaged.
        layers.append(Layer(LINES, "construction"))
        polylines.append(Polyline(LINES, [(-1.0, 0.0), (1.0, 0.0)]))
    return Drawing(title, layers, polylines, labels=labels)


def _ring(layer: str, name: str, outer: float, inner: float) -> Polyline:
    """A filled ring as one outline: around outside, and back around inside; or a circle."""
    turns = [2 * math.pi * part / AROUND for part in range(AROUND + 1)]
    places = [(outer * math.cos(turn), outer * math.sin(turn)) for turn in turns]
    if inner > 0:
        places += [(inner * math.cos(turn), inner * math.sin(turn)) for turn in reversed(turns)]
    return Polyline(layer, places, closed=True, name=name)


def _wall(region: str) -> str:
    return "top" if region == "top" else f"{region} wall"


def chamber_quantities(design: DesignedChamber) -> list[Quantity]:
    """Every dimension of a chamber, what follows from them of the wall, and its image.

    Where there is no image, its numbers are left out.
    """
    chamber = design.chamber
    lengths = {
        "length_ab": chamber.length_ab,
        "length_bc": chamber.length_bc,
        "length_cd": chamber.length_cd,
        "offset_a": chamber.offset_a,
        "offset_b": chamber.offset_b,
        "offset_c": chamber.offset_c,
        "offset_d": chamber.offset_d,
        "focal_length": chamber.focal_length,
        "image_distance": chamber.image_distance,
        "reference_height": chamber.reference_height,
        "pinhole_offset": chamber.pinhole_offset,
    }
    angles = {"wall_angle_bc": chamber.wall_angle_bc, "wall_angle_cd": chamber.wall_angle_cd}
    found = [Quantity(name, float(value), "mm") for name, value in lengths.items()]
    found += [Quantity(name, math.degrees(float(value)), "°") for name, value in angles.items()]
    ratio, rings = chamber.imaging_ratio(), chamber.ring_widths()
    if bool(ratio.ok):
        found.append(Quantity("imaging_ratio", float(ratio.value), ""))
    if bool(rings.ok):
        names = ("ring_blue", "ring_yellow", "ring_top")
        values = rings.value.tolist()
        found += [Quantity(name, value, "mm") for name, value in zip(names, values, strict=True)]
    return found


def _corners(chamber: Chamber) -> dict[str, Place]:
    a, b, c = (float(x) for x in (chamber.length_ab, chamber.length_bc, chamber.length_cd))
    return {
        "A": (0.0, float(chamber.offset_a)),
        "B": (a, float(chamber.offset_b)),
        "C": (a + b, float(chamber.offset_c)),
        "D": (a + b + c, -float(chamber.offset_d)),
        "E": (a + b + c, -float(chamber.reference_height)),
    }
