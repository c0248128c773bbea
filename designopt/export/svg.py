"""A drawing as SVG, to scale: one unit is one millimetre."""

from __future__ import annotations

import itertools
import re
import xml.etree.ElementTree as ElementTree
from xml.etree.ElementTree import Element, SubElement

from designopt.export.arcs import arc_radius
from designopt.export.drawing import Drawing, Polyline, unused_name
from designopt.export.line_styles import LineStyle, line_styles_of
from designopt.export.placing import Clutter

SVG = "http://www.w3.org/2000/svg"
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"

ROOM = 0.08
"""Room around the drawing, as a part of its larger side."""

PAPER = 200.0
"""Lines and texts are as wide as on a drawing whose larger side is so long, mm."""

TEXT = 2.8
"""Height of texts on such a drawing, mm."""


def svg_text(sheet: Drawing) -> str:
    """The text of an SVG file: a group for each layer, and one of the names."""
    (left, low), (right, high) = sheet.box()
    side = max(right - left, high - low)
    room, unit = ROOM * side, side / PAPER
    size = right - left + 2 * room, high - low + 2 * room
    ElementTree.register_namespace("", SVG)
    ElementTree.register_namespace("inkscape", INKSCAPE)
    root = Element(f"{{{SVG}}}svg", version="1.1")
    root.set("width", f"{size[0]!r}mm")
    root.set("height", f"{size[1]!r}mm")
    root.set("viewBox", f"{left - room!r} {-high - room!r} {size[0]!r} {size[1]!r}")
    _child(root, "title").text = sheet.title
    _child(root, "desc").text = "\n".join(["in mm, to scale", *sheet.notes])
    looks, taken = line_styles_of(sheet.layers), set[str]()
    groups = {layer.name: _group(root, layer.name, taken) for layer in sheet.layers}
    for name, group in groups.items():
        _paint(group, looks[name], unit)
    for line in sheet.polylines:
        if line.bulges:
            _child(groups[line.layer], "path", d=path_data(line))
            continue
        kind = "polygon" if line.closed else "polyline"
        points = " ".join(f"{x!r},{_down(y)!r}" for x, y in line.places)
        _child(groups[line.layer], kind, points=points)
    for circle in sheet.circles:
        x, y = circle.center
        places = {"cx": repr(x), "cy": repr(_down(y)), "r": repr(circle.radius)}
        _child(_child(groups[circle.layer], "circle", **places), "title").text = circle.name
    names = _group(root, "names", taken)
    names.set("style", f"font:{TEXT * unit:.6g}px sans-serif;text-anchor:middle;stroke:none")
    corners = (left - room) / unit, (low - room) / unit, (right + room) / unit, (high + room) / unit
    clutter = Clutter.of(sheet, 1 / unit, (corners[:2], corners[2:]))
    for label in sheet.labels:
        x, y = clutter.place_label(label, TEXT) * unit
        baseline = _down(y - 0.35 * TEXT * unit)
        places = {"x": repr(float(x)), "y": repr(float(baseline))}
        color = looks[label.layer].color
        _child(names, "text", fill=color, **places).text = label.text
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _child(parent: Element, name: str, **attributes: str) -> Element:
    return SubElement(parent, f"{{{SVG}}}{name}", attributes)


def _group(root: Element, name: str, taken: set[str]) -> Element:
    """A layer in Inkscape's extension of SVG."""
    stem = re.sub(r"[^\w.-]", "_", name)
    stem = stem if re.match(r"[^\W\d]", stem) else f"_{stem}"
    unique = unused_name(stem, taken)
    taken.add(unique)
    group = _child(root, "g", id=unique)
    group.set(f"{{{INKSCAPE}}}groupmode", "layer")
    group.set(f"{{{INKSCAPE}}}label", name)
    return group


def _paint(group: Element, look: LineStyle, unit: float) -> None:
    width = f"{look.width * unit:.6g}"
    looks = {"stroke-width": width, "stroke-linejoin": "round"}
    group.attrib |= {"fill": look.color if look.fill else "none", "stroke": look.color, **looks}
    if look.fill:
        group.set("fill-opacity", f"{look.fill:g}")
    if look.dashed:
        group.set("stroke-dasharray", f"{3 * unit:.6g} {1.5 * unit:.6g}")


def path_data(line: Polyline) -> str:
    """A line as data of an SVG path, y downwards.

    Example:
        >>> path_data(Polyline("bar", [(0.0, 0.0), (4.0, 3.0)]))
        'M 0.0,0.0 L 4.0,-3.0'
    """
    # The last edge of a closed line is drawn by Z, unless it may be an arc.
    ends = [*line.places[1:], *line.places[: bool(line.closed and line.bulges)]]
    (x, y), *_ = line.places
    found = [f"M {x!r},{_down(y)!r}"]
    bulges = itertools.chain(line.bulges, itertools.repeat(0.0))
    for start, end, bulge in zip(line.places, ends, bulges, strict=False):
        place = f"{end[0]!r},{_down(end[1])!r}"
        if bulge:
            radius = arc_radius(start, end, bulge)
            # With y downwards, what is counter-clockwise here is against SVG's positive angles.
            found.append(f"A {radius!r} {radius!r} 0 {abs(bulge) > 1:d} {bulge < 0:d} {place}")
        else:
            found.append(f"L {place}")
    return " ".join([*found, "Z"] if line.closed else found)


def _down(y: float) -> float:
    """SVG counts y downwards."""
    return 0.0 - y  # no −0
