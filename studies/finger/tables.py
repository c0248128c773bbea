"""The study's own tables: requirements line by line, and dimensions beside the pins."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from designopt.study.results import Table
from studies.finger.spec import FingerSpec
from studies.models.finger import camera_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from studies.finger.found import FingerDesign
    from studies.finger.statements import Line


def requirements(lines: Sequence[Line]) -> Table:
    """Paper B's Table 3.1 and text, line by line."""
    return Table(
        "table_3_1",
        "Paper B's requirements (Table 3.1 and §3.1.2), as required and as achieved",
        ["requirement", "category", "required", "achieved", "met"],
        [
            (line.name, line.category, line.required, line.achieved, "yes" if line.met else "no")
            for line in lines
        ],
    )


def dimensions(spec: FingerSpec, found: FingerDesign) -> Table:
    """Phalanges, camera and mirrors; the pins have their own table."""
    body, scene, camera = spec.body, found.finger.scene(), camera_of(found.finger)
    position, middle = np.asarray(scene.camera.position), np.array([body.intermediate, 0.0])
    rows = [
        ("proximal phalanx", "length", body.proximal, "mm"),
        ("intermediate phalanx", "length", body.intermediate, "mm"),
        ("distal phalanx", "length", body.distal, "mm"),
        ("all phalanges", "thickness", body.thickness, "mm"),
        ("all phalanges", "palmar face to axes", body.axis_height, "mm"),
        ("camera, from A in the intermediate phalanx", "x", float(position[0]), "mm"),
        ("camera, from A in the intermediate phalanx", "y", float(position[1]), "mm"),
        (
            "camera, from A in the intermediate phalanx",
            "optical axis from straight down, counter-clockwise",
            math.degrees(float(camera.tilt)),
            "°",
        ),
    ]
    distal, proximal = np.asarray(scene.mirrors)
    for name, ends, origin in (("proximal", proximal, "A"), ("distal", distal - middle, "B")):
        for end, place in zip(("near", "far"), ends, strict=True):
            for axis, value in zip("xy", place, strict=True):
                part = f"{name} mirror, from {origin} in its phalanx"
                rows.append((part, f"{end} end, {axis}", float(value), "mm"))
    spring = spec.spring
    rows += [
        ("spring between distal phalanx and plate", "stiffness", spring.stiffness, "N mm/rad"),
        ("spring between distal phalanx and plate", "preload", spring.preload, "rad"),
    ]
    return Table(
        "dimensions",
        "Dimensions beside the pins",
        ["part", "dimension", "value", "unit"],
        rows,
        {"value": 2},
    )
