"""All parts of a finger: what its phalanges carry, and what else its bill of materials lists."""

from __future__ import annotations

import math

import numpy as np

from designopt.export.parts import Assembly, BillRow, Outline, Part, Span, circle, polygon
from studies.models.finger import Finger, camera_of, links_of
from studies.models.finger_parts import PHALANGES
from studies.models.links import AXLES
from studies.models.manufacture.phalanges import (
    camera_half_width,
    camera_outlines,
    make_phalanges,
    strip_spans,
)
from studies.models.manufacture.plates import bar_outline, mirror_glass
from studies.models.manufacture.section import BESIDE_PADS, Section, rectangle, sides, through
from studies.models.mirror_design.clearances import layer_outlines

SHEET, PIN, GLASS, LED, CAMERA = "#8A8A8A", "#4D4D4D", "#7B3FA0", "#E8C547", "#3A3A3A"
LAYER_COLORS = ("#BFD9EA", "#E6C8D5")
"""Acrylic, and what lies beneath it."""

NAMED = {1.49: "acrylic (PMMA)", 1.41: "silicone, clear"}
"""Materials of layers by their index."""

SIDES = ("left", "right")

ORDER = (
    "Assemble from the middle outwards: pads, mirrors and camera into their shells; then layer by "
    "layer, each pin through the parts it joins before the next layer covers it; the axles and the "
    "outermost walls last."
)


def make_parts(finger: Finger) -> list[Part]:
    """Every solid part of a finger, in its straight posture.

    Args:
        finger: with pins and links.

    Raises:
        UserError: it has none, or its links lie in another order.

    Example:
        >>> from studies.models import packaged_finger
        >>> [part.name for part in make_parts(packaged_finger()) if part.item == "crank"]
        ['crank, left', 'crank, right']
    """
    section = Section.of(finger)
    parts = make_phalanges(finger) + _bars(section, finger) + _pins(section, finger)
    if finger.camera is not None:
        parts += [_camera(finger), *_mirrors(section, finger)]
    return parts + _pads(section, finger) + _strips(section)


def make_assembly(finger: Finger) -> Assembly:
    """All parts of a finger, what is bought besides, and what lies where across its width.

    Raises:
        UserError: as `make_parts`.
    """
    spring, links, others = finger.spring, links_of(finger), []
    if spring is not None:
        turn = f"{float(spring.stiffness):g} N mm/rad, wound by {float(spring.preload):g} rad"
        others.append(BillRow("torsion spring at pin C", "spring steel", turn, 1))
    kind = links.kind
    drive = f"{kind.crank_title} on its shaft {kind.shaft}"
    if finger.motor is not None:
        drive = "drivers on its shaft M"
    others += [
        BillRow("geared motor", "bought", drive, 1),
        BillRow("cover of the joints' backs", "black cloth", "light-tight, slack", 2),
    ]
    edges = np.asarray(links.edges, float).tolist()
    spans = [
        Span(", ".join(parts), low, high)
        for parts, (low, high) in zip(links.layers, edges, strict=True)
    ]
    return Assembly(finger.name, make_parts(finger), others, spans, ORDER)


def _bars(section: Section, finger: Finger) -> list[Part]:
    links, found = links_of(finger), []
    for bar, pins in section.kind.outlines.items():
        holes = section.holes(pins)
        if len(holes) < 2:
            continue
        low, high = section.layers[links.layer_of(bar)]
        outline = bar_outline(section, bar)
        size = f"{high - low:.3g} mm sheet, {_extent(outline)}, {len(holes)} holes"
        for side, prism in zip(SIDES, sides(outline, low, high, holes), strict=True):
            part = Part(f"{bar}, {side}", bar, bar, "aluminium 6061-T6", size, (prism,), (), SHEET)
            found.append(part)
    return found


def _pins(section: Section, finger: Finger) -> list[Part]:
    links, found = links_of(finger), []
    for pin, bodies in finger.joined().items():
        inner, *_, outer = sorted(links.layer_of(body) for body in bodies)
        low, high = section.layers[inner][0], section.layers[outer][1]
        [(center, radius, named)] = section.holes(pin)
        # In the one that it is pressed into it does not turn: the wall, if it has one.
        body = min(bodies, key=lambda one: (one not in PHALANGES, one))
        size = f"⌀{2 * radius:g} × {high - low:.4g} mm"
        kind = "axle" if pin in AXLES else "pin"
        name = f"{kind} {named}"
        item, steel = f"{kind}s {high - low:.4g} mm long", "stainless steel A2-70"
        both = sides(circle(*center, radius), low, high)
        for side, prism in zip(SIDES, both, strict=True):
            part = Part(f"{name}, {side}", item, body, steel, size, (prism,), (), PIN)
            found.append(part)
    return found


def _camera(finger: Finger) -> Part:
    half = camera_half_width(finger)
    boxes = camera_outlines(finger)
    size = f"{_extent(boxes[0])} in the section, {2 * half:g} mm across"
    prisms = tuple(through(box, half) for box in boxes)
    host = camera_of(finger).phalanx
    return Part(f"{host} camera", "camera", host, "bought", size, prisms, (), CAMERA)


def _mirrors(section: Section, finger: Finger) -> list[Part]:
    found, width = [], 2 * section.half_width
    glass = mirror_glass(finger)
    for (name, outline), mirror in zip(glass.items(), finger.mirrors, strict=True):
        size = f"{float(mirror.mount):g} × {float(mirror.length):.4g} × {width:.4g} mm"
        prism, title = through(outline, section.half_width), f"{name} mirror"
        part = Part(title, title, mirror.phalanx, "glass, first surface", size, (prism,), (), GLASS)
        found.append(part)
    return found


def _pads(section: Section, finger: Finger) -> list[Part]:
    if finger.layers is None:
        return []
    outlines = np.asarray(layer_outlines(finger), float)
    thickness, index = (np.asarray(one) for one in (finger.layers.thickness, finger.layers.index))
    found = []
    for phalanx, own in zip(PHALANGES, outlines, strict=True):
        for number, corners in enumerate(own):
            outline = polygon(*corners)
            refraction = round(float(index[number]), 4)
            material = NAMED.get(refraction, f"clear, index {refraction:g}")
            length = max(corners[:, 0]) - min(corners[:, 0])
            size = f"{thickness[number]:g} × {length:.4g} × {2 * section.half_width:.4g} mm"
            name = f"{phalanx} pad, layer {number + 1}"
            color = LAYER_COLORS[min(number, 1)]
            prism = through(outline, section.half_width)
            found.append(Part(name, name, phalanx, material, size, (prism,), (), color))
    return found


def _strips(section: Section) -> list[Part]:
    (low, high), found = section.layers[BESIDE_PADS], []
    for phalanx in PHALANGES:
        for number, (start, end) in enumerate(strip_spans(section, phalanx), 1):
            outline = rectangle(start, end, section.palmar, section.palmar + section.stack)
            size = f"{high - low:.3g} × {section.stack:.3g} × {end - start:.4g} mm"
            for side, prism in zip(SIDES, sides(outline, low, high), strict=True):
                name = f"{phalanx} LED strip {number}, {side}"
                item = f"LED strip {number} of the {phalanx} pad"
                found.append(Part(name, item, phalanx, "bought", size, (prism,), (), LED))
    return found


def _extent(outline: Outline) -> str:
    """Least rectangle that holds an outline, in words."""
    places = np.array(outline.line(0.01))
    sides = np.roll(places, -1, axis=0) - places
    sides = sides[np.hypot(*sides.T) > 1e-9]
    along = sides / np.hypot(*sides.T)[:, None]
    # One of its sides lies on a side of the outline's hull.
    extents = [
        (np.ptp(places @ one), np.ptp(places @ np.array([-one[1], one[0]]))) for one in along
    ]
    length, width = sorted(min(extents, key=math.prod), reverse=True)
    return f"{length:.4g} × {width:.4g} mm"
