"""The designed finger as a drawing to build from: linkage and optics in one, and its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from designopt.export.drawing import Circle, Drawing, Layer, Polyline
from designopt.export.json import Quantity
from kinematics.export.drawing import linkage_quantities, make_linkage_drawing
from optics.export.scene_drawing import HINGES, make_scene_drawing, scene_quantities
from studies.models.designed import designed_linkage, designed_scene
from studies.models.finger import Finger
from studies.models.finger_parts import PHALANGES, Body
from studies.models.manufacture.plates import make_plates

OUTLINE = "outline"
"""Layer of the straight finger's outline."""


def make_finger_drawing(finger: Finger) -> Drawing:
    """The section of the straight finger, PIP axis at the origin, x towards the tip.

    Linkage, camera, mirrors and pads lie on the layers of their own drawings; hinges are pins of
    the linkage. Where links have widths, every bar and side wall is a closed outline with its holes
    on a layer of its own, and so is every mirror's glass. The faces and ends of the finger are
    construction lines.
    """
    links = make_linkage_drawing(designed_linkage(finger), pose=False)
    optics = make_scene_drawing(designed_scene(finger), pose=False)
    if finger.links is not None:
        links = _with_outlines(links, finger)
    return Drawing(
        title=finger.name,
        layers=[
            *links.layers,
            *(layer for layer in optics.layers if layer.name != HINGES),
            Layer(OUTLINE, "construction"),
        ],
        polylines=[*links.polylines, *optics.polylines, _outline(finger.body)],
        circles=[*links.circles, *_beside_hinges(optics.circles)],
        labels=[*links.labels, *_beside_hinges(optics.labels)],
        dimensions=[*links.dimensions, *optics.dimensions],
        notes=[
            "straight finger; the links lie at both its sides, the optics between them",
            *links.notes,
            *optics.notes,
        ],
    )


def _with_outlines(links: Drawing, finger: Finger) -> Drawing:
    """A linkage's drawing with the outlines and holes of its bars and walls in place of lines."""
    polylines, circles = [], []
    plates = make_plates(finger)
    for plate in plates:
        outline = plate.outline
        polylines.append(Polyline(plate.name, outline.places, True, outline.bulges))
        circles += [Circle(plate.name, hole.name, hole.center, hole.radius) for hole in plate.holes]
    names = {
        label.layer: f"{label.layer} wall" for label in links.labels if label.layer in PHALANGES
    }
    return links._replace(
        layers=[Layer(plate.name, "body") for plate in plates],
        polylines=polylines,
        circles=circles,
        labels=[one._replace(layer=names.get(one.layer, one.layer)) for one in links.labels],
        notes=[note for note in links.notes if not note.startswith("pins are drawn")],
    )


def finger_quantities(finger: Finger) -> list[Quantity]:
    """Every number of linkage, scene, body and spring, by the part that it belongs to."""
    body, spring = finger.body, finger.spring
    lengths = ("proximal", "intermediate", "distal", "thickness", "axis_height", "rim")
    lengths += ("protrusion", "pad_clearance", "membrane")
    found = [
        *_within("linkage", linkage_quantities(designed_linkage(finger))),
        *_within("scene", scene_quantities(designed_scene(finger))),
        *(Quantity(f"body.{name}", float(getattr(body, name)), "mm") for name in lengths),
        Quantity("body.range", body.ranges_deg[0], "°"),
        Quantity("body.dip_range", body.ranges_deg[1], "°"),
        *(
            Quantity(f"body.{joint}_gap", float(gap), "mm")
            for joint, gap in zip(("pip", "dip"), body.gaps, strict=True)
        ),
    ]
    if spring is not None:
        units = {"stiffness": "N mm/rad", "preload": "rad", "servo": "N mm/rad"}
        found += [
            Quantity(f"spring.{name}", float(getattr(spring, name)), unit)
            for name, unit in units.items()
        ]
    return found


def _beside_hinges(parts: Sequence[Any]) -> list[Any]:
    return [part for part in parts if part.layer != HINGES]


def _within(part: str, quantities: Sequence[Quantity]) -> list[Quantity]:
    return [replace(quantity, name=f"{part}.{quantity.name}") for quantity in quantities]


def _outline(body: Body) -> Polyline:
    root, tip = -float(body.proximal), float(body.intermediate + body.distal)
    palmar, dorsal = float(body.palmar), float(body.dorsal)
    corners = [(root, palmar), (tip, palmar), (tip, dorsal), (root, dorsal)]
    return Polyline(OUTLINE, corners, closed=True)
