"""The designed finger as a drawing to build from: linkage and optics in one, and its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from designopt.export.json import Quantity
from designopt.export.sheet import Layer, Sheet, Stroke
from kinematics.export.sheet import linkage_quantities, linkage_sheet
from optics.export.scene_sheet import HINGES, scene_quantities, scene_sheet
from studies.models.body import BodySpec

if TYPE_CHECKING:
    from studies.finger.design import DesignedFinger

OUTLINE = "outline"
"""Layer of the straight finger's outline."""


def finger_sheet(design: DesignedFinger) -> Sheet:
    """The section of the straight finger, PIP axis at the origin, x towards the tip.

    Linkage, camera, mirrors and pads lie on the layers of their own drawings; hinges are pins of
    the linkage. The faces and ends of the finger are construction lines.
    """
    links, optics = linkage_sheet(design.linkage, pose=False), scene_sheet(design.scene, pose=False)
    body = design.spec.body
    return Sheet(
        title=design.name,
        layers=[
            *links.layers,
            *(layer for layer in optics.layers if layer.name != HINGES),
            Layer(OUTLINE, "construction"),
        ],
        strokes=[*links.strokes, *optics.strokes, _outline(body)],
        circles=[
            *links.circles,
            *(circle for circle in optics.circles if circle.layer != HINGES),
        ],
        labels=[
            *links.labels,
            *(label for label in optics.labels if label.layer != HINGES),
        ],
        measures=[*links.measures, *optics.measures],
        notes=[
            "straight finger; the links lie at both its sides, the optics between them",
            *links.notes,
            *optics.notes,
        ],
    )


def finger_quantities(design: DesignedFinger) -> list[Quantity]:
    """Every number of linkage, scene, body and spring, by the part that it belongs to."""
    body, spring = design.spec.body, design.spec.spring
    lengths = ("proximal", "intermediate", "distal", "thickness", "axis_height")
    return [
        *_within("linkage", linkage_quantities(design.linkage)),
        *_within("scene", scene_quantities(design.scene)),
        *(Quantity(f"body.{name}", getattr(body, name), "mm") for name in lengths),
        Quantity("body.range", body.range_deg, "°"),
        Quantity("spring.stiffness", spring.stiffness, "N mm/rad"),
        Quantity("spring.preload", spring.preload, "rad"),
        Quantity("spring.servo", spring.servo, "N mm/rad"),
    ]


def _within(part: str, quantities: Sequence[Quantity]) -> list[Quantity]:
    return [replace(quantity, name=f"{part}.{quantity.name}") for quantity in quantities]


def _outline(body: BodySpec) -> Stroke:
    root, tip = -body.proximal, body.intermediate + body.distal
    corners = [
        (root, body.palmar),
        (tip, body.palmar),
        (tip, body.dorsal),
        (root, body.dorsal),
    ]
    return Stroke(OUTLINE, corners, closed=True)
