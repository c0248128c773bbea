"""What is laid on the pads, and before the sensor: scenes of today's finger, and published numbers.

Published numbers are those of an independent search in the section and an independent tracer.
Their layers are black and flush where nothing else is stated, and all pads have them.
"""

from __future__ import annotations

import json
import math
from typing import Any, NamedTuple

from optics import Scene, parse_scene
from optics.scene.writer import scene_tables
from studies.models.finger import Finger

ACRYLIC, SILICONE, MIDDLE = 1.49, 1.41, 1.43
"""Refractive indices; the last one is that of the published layers inside the phalanx."""

Pair = tuple[float, float]
Tables = dict[str, Any]

JOINT_ENDS = {"proximal": (0, 1), "intermediate": (1, 1), "distal": (1, 0)}
"""Which ends of a pad are at a joint: at ``from``, at ``to``."""


class Case(NamedTuple):
    """One way to cover the pads.

    Attributes:
        layers: thickness (mm) and index of each, from the camera's side to the membrane.
        sides: what their ends are.
        overhang: of the layers over the membrane at the joints, mm.
        shorter: by how much the membrane is shorter than today's there, mm.
        outside: whether the outermost surface lies at today's membrane, not the membrane itself.
        fov_deg: field of view in the section.
        today: published worst coverage of proximal and distal pad, mirrors as they are.
        redesigned: the same with other mirrors and another place of the camera.
    """

    layers: tuple[Pair, ...] = ()
    sides: str = "black"
    overhang: float = 0.0
    shorter: float = 0.0
    outside: bool = False
    fov_deg: float = 160.0
    today: Pair | None = None
    redesigned: Pair | None = None

    @property
    def down(self) -> float:
        """How far the membranes lie below today's, mm."""
        return sum(thickness for thickness, _ in self.layers) if self.outside else 0.0

    def meeting_deg(self, finger: Finger) -> float:
        """Flexion at which the lower edges of neighbours' layers, or membranes, touch, degrees."""
        height = float(finger.body.axis_height)
        reach = height + self.shorter - self.overhang
        return 2 * math.degrees(math.atan2(reach, height + self.down))

    def scene(self, finger: Finger) -> Scene:
        """The finger's scene with them."""
        tables = plain_tables(finger.scene())
        tables["camera"]["fov_deg"] = self.fov_deg
        for pad in tables["pads"]:
            first, second = JOINT_ENDS[pad["name"]]
            pad["from"] = [pad["from"][0] + first * self.shorter, pad["from"][1] - self.down]
            pad["to"] = [pad["to"][0] - second * self.shorter, pad["to"][1] - self.down]
            over = [first * self.overhang, second * self.overhang]
            more = {"sides": self.sides, "overhang": over}
            pad["layers"] = [{"thickness": t, "index": n} | more for t, n in self.layers]
        return parse_scene(tables, finger.name)


PLATE = ((3.0, ACRYLIC),)
THIN = ((2.0, ACRYLIC),)

CASES = {
    "none": Case(today=(1.0, 1.0)),
    "2 mm": Case(THIN),
    "3 mm": Case(PLATE, redesigned=(0.90, 0.89)),
    "3+2 mm": Case((*PLATE, (2.0, SILICONE)), redesigned=(0.74, 0.84)),
    "2 mm, overhang": Case(THIN, overhang=2, shorter=2, redesigned=(1.0, 1.0)),
    "2 mm, overhang beyond today's end": Case(THIN, overhang=2),
    "3 mm, overhang": Case(PLATE, overhang=2, shorter=2, redesigned=(0.96, 0.97)),
    "3 mm, clear ends": Case(PLATE, "clear", redesigned=(0.995, 0.995)),
    "3 mm, clear ends, overhang, 145°": Case(
        PLATE, "clear", overhang=2, shorter=2, fov_deg=145, redesigned=(0.998, 0.998)
    ),
    "1.5 mm inside": Case(((1.5, MIDDLE),), today=(0.955, 0.950)),
    "3 mm inside": Case(((3.0, MIDDLE),), today=(0.838, 0.895)),
    "5 mm inside": Case(((5.0, MIDDLE),), today=(0.683, 0.825)),
    "1.5 mm outside": Case(((1.5, MIDDLE),), outside=True, today=(0.955, 0.950)),
    "3 mm outside": Case(((3.0, MIDDLE),), outside=True, today=(0.838, 0.895)),
    "5 mm outside": Case(((5.0, MIDDLE),), outside=True, today=(0.683, 0.825)),
    "none, 128°": Case(fov_deg=128, redesigned=(0.88, 0.99)),
}
"""By name. Layers ``inside`` lie on the membrane where it is today, those ``outside`` have their
outermost surface there; where a layer overhangs it ends where today's pad does, but in one case."""

SENSOR = {"sensor_mm": [3.6, 2.7], "pixels": [1440, 1080]}
"""A sensor 4:3."""

DIAGONAL_DEG = 160.0
PROJECTIONS = ("equidistant", "equisolid", "stereographic", "orthographic")


def sold_camera(projection: str, axis: str) -> Scene:
    """A scene with only today's lens as it is sold, its field of view that of the diagonal."""
    camera = {
        "position": [0.0, 0.0],
        "direction_deg": 0.0,
        "format": SENSOR | {"section_axis": axis},
        "fov_deg": DIAGONAL_DEG,
        "fov_axis": "diagonal",
        "projection": projection,
    }
    return parse_scene({"camera": camera, "pads": [{"name": "p", "from": [9, 0], "to": [9, 1]}]})


def plain_tables(scene: Scene) -> Tables:
    """A scene's tables as `tomllib` gives them."""
    return json.loads(json.dumps(scene_tables(scene)))
