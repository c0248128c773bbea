"""What is judged: fingers, the layers on their pads, postures; as tables of scene files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from optics.scene.writer import scene_tables
from studies.models.finger import Finger, camera_of
from studies.models.finger_file import bare_finger
from studies.physical_check import LayersName, PhysicalCheckSpec

ACRYLIC, GEL = 1.49, 1.41
"""Refractive indices."""

THIN = 21.0
"""Thickness of the thin finger, mm."""

WIDTHS = (24.0, 20.0, 16.0, 28.0)
"""Of the pads of one finger after the other, mm."""

LENSES = ("equidistant", "equidistant", [-0.02, 0.002, 0.0, 0.0], "equidistant")
"""Projections of the cameras of one finger after the other."""

MEETING_DEG = 70.0
"""Beyond this flexion, layers that overhang run into each other."""


def _plate(thickness: float, index: float, **more: Any) -> dict[str, Any]:
    return {"thickness": thickness, "index": index, **more}


PADS: dict[LayersName, dict[str, Any]] = {
    "none": {},
    "1 mm": {"layers": [_plate(1, ACRYLIC)]},
    "2 mm": {"layers": [_plate(2, GEL)]},
    "3 mm": {"layers": [_plate(3, ACRYLIC)]},
    "3+2 mm": {"layers": [_plate(3, ACRYLIC), _plate(2, GEL)]},
    "3 mm clear": {"layers": [_plate(3, ACRYLIC, sides="clear")]},
    "3 mm clear, overhang": {"layers": [_plate(3, ACRYLIC, sides="clear", overhang=1)]},
    "3 mm bevelled": {"layers": [_plate(3, ACRYLIC, bevel_deg=[15, 10])]},
    "3+2 mm overhang": {
        "layers": [_plate(3, ACRYLIC, overhang=1, bevel_deg=-10), _plate(2, GEL, overhang=[0.5, 1])]
    },
    "3 mm bezel": {
        "layers": [_plate(3, ACRYLIC, overhang=1)],
        "bezel": {"lip": [1.5, 1], "height": 0.8},
    },
}
"""Keys of the pads, by the name of their layers."""


class Case(NamedTuple):
    """One finger with one kind of layers, in several postures.

    Attributes:
        finger: its name.
        layers: name of the kind.
        tables: of its scene's file.
        poses: joint angles, degrees.
        width: of the pads, mm.
    """

    finger: str
    layers: LayersName
    tables: dict[str, Any]
    poses: list[dict[str, float]]
    width: float


def cases(spec: PhysicalCheckSpec, seed: int) -> Iterator[Case]:
    """All cases of a run."""
    finger = bare_finger()
    body = replace(finger.body, thickness=THIN)
    fingers = {"designed": finger, "thin": replace(finger, body=body)}
    for number in range(1, spec.fingers + 1):
        fingers[f"random {number}"] = _random_finger(finger, np.random.default_rng([seed, number]))
    for number, (name, one) in enumerate(fingers.items()):
        # Plain numbers and lists, as tomllib gives them.
        tables = json.loads(json.dumps(scene_tables(one.scene())))
        tables["camera"]["projection"] = LENSES[number % len(LENSES)]
        width = WIDTHS[number % len(WIDTHS)]
        for index, layers in enumerate(spec.layers):
            more = PADS[layers] | {"width": width}
            pads = [pad | more for pad in tables["pads"]]
            top = one.body.range_deg if "over" not in str(more) else MEETING_DEG
            generator = np.random.default_rng([seed, 1000 + number, index])
            angles = generator.uniform(0, top, (spec.postures, 2)).round(3).tolist()
            poses = [{"pip": pip, "dip": dip} for pip, dip in angles]
            yield Case(name, layers, tables | {"pads": pads}, poses, width)


def _random_finger(finger: Finger, generator: np.random.Generator) -> Finger:
    """A finger with other lengths, another camera and other mirrors, not meant to be a good one."""
    body, camera = finger.body, camera_of(finger)

    def near(value: Any, spread: float) -> Any:
        return np.asarray(value) + generator.uniform(-spread, spread, np.shape(value))

    lengths = ("proximal", "intermediate", "distal", "thickness")
    body = replace(body, **{name: near(getattr(body, name), 2.0) for name in lengths})
    camera = replace(
        camera,
        along=near(camera.along, 1.5),
        depth=near(camera.depth, 0.5),
        tilt=near(camera.tilt, 0.05),
        field_of_view=near(camera.field_of_view, 0.15),
    )
    mirrors = tuple(replace(one, ends=near(one.ends, 1.0)) for one in finger.mirrors)
    return replace(finger, body=body, camera=camera, mirrors=mirrors)
