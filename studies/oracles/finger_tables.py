"""The optical scene of a finger as plain tables, from nothing but the finger's file.

What follows from the file's numbers is written out a second time: where pads begin, how far the
ends of layers reach, the field of view of a lens and a sensor in the section, shells, walls and the
camera's body. Places are those of the straight finger as complex numbers, x + iy, mm: the PIP axis
is 0, x runs to the tip and y to the back.
"""

from __future__ import annotations

import cmath
import math
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

Tables = Mapping[str, Any]

CAMERAS = Path(__file__).parents[2] / "optics" / "scene" / "cameras.toml"
"""Numbers of cameras that are sold."""

SETBACK = 0.5
"""From the pinhole back to the line that stands for a camera's body without a module, mm."""

PROJECTIONS = {
    "pinhole": (math.tan, math.atan),
    "equidistant": (lambda angle: angle, lambda height: height),
    "equisolid": (lambda angle: 2 * math.sin(angle / 2), lambda high: 2 * math.asin(high / 2)),
    "stereographic": (lambda angle: 2 * math.tan(angle / 2), lambda high: 2 * math.atan(high / 2)),
    "orthographic": (math.sin, math.asin),
}
"""Image height (focal lengths) at an angle from the axis (rad), and its inverse."""

NARROW = ("pinhole", "orthographic")
"""Projections that image less than 90° from the axis."""


def scene_of_finger(path: str | Path) -> dict[str, Any]:
    """The tables of a scene file for a finger's file; lengths in mm.

    The intermediate phalanx is fixed; the flexions "pip" and "dip" (degrees) turn the others.

    Args:
        path: of the file, which has a camera.
    """
    file = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    body, camera = file["body"], file["camera"]
    middle, palmar = body["intermediate"], -body["axis_height"]
    dorsal = palmar + body["thickness"]
    rear, tip = -body["proximal"], middle + body["distal"]
    joint = {"proximal": 0.0, "intermediate": 0.0, "distal": middle}

    def part(name: str, phalanx: str, start: complex, end: complex, **more: Any) -> dict[str, Any]:
        ends = {"from": [start.real, start.imag], "to": [end.real, end.imag]}
        return {"name": name, "body": phalanx.replace("intermediate", "world"), **ends, **more}

    mirrors = []
    for mirror in file.get("mirrors", []):
        host = mirror["phalanx"]
        places = mirror["from"], mirror["to"]
        start, end = (complex(joint[host] + x, dorsal - y) for x, y in places)
        # From its joint outwards; the side towards the palm reflects.
        side = "left" if host == "proximal" else "right"
        mirrors.append(part(host, host, start, end, side=side))
    walls = {
        "proximal shell": (rear + 1j * dorsal, 1j * dorsal),
        "intermediate shell": (1j * dorsal, middle + 1j * dorsal),
        "distal shell": (middle + 1j * dorsal, tip + 1j * dorsal),
        "proximal end": (rear + 1j * palmar, rear + 1j * dorsal),
        "distal end": (tip + 1j * palmar, tip + 1j * dorsal),
    }
    blockers = [part(name, name.split()[0], *ends) for name, ends in walls.items()]
    carrier = camera.get("phalanx", "intermediate")
    eye = complex(joint[carrier] + camera["along"], dorsal - camera["depth"])
    axis = cmath.rect(1, math.radians(camera["tilt_deg"] - 90))
    for start, end in _camera_body(camera):
        blockers.append(part("camera", carrier, eye + axis * start, eye + axis * end))
    pads = []
    for name, start, end, layers in _pads(body, file.get("pads", {}), rear, tip):
        limits = {"side": "left", "min_grazing_deg": camera["min_grazing_deg"]}
        pads.append(part(name, name, start, end, **limits, **layers))
    return {
        "scene": {"bounces": 1},
        "camera": {
            "position": [eye.real, eye.imag],
            "direction_deg": camera["tilt_deg"] - 90,
            "fov_deg": field_of_view(camera),
            "body": carrier.replace("intermediate", "world"),
        },
        "mirrors": mirrors,
        "pads": pads,
        "blockers": blockers,
        "frames": {
            "proximal": {"hinge": [0.0, 0.0], "angle": "pip"},
            "distal": {"hinge": [middle, 0.0], "angle": "dip", "positive": "clockwise"},
        },
    }


def field_of_view(camera: Tables) -> float:
    """Of ``[camera]`` in the section, from limit to limit, degrees.

    With ``format`` it ends at the sensor's edge or at that of the image circle, at the height of
    which the lens, with one of the classical projections, images it.
    """
    if "model" in camera:
        sold = tomllib.loads(CAMERAS.read_text(encoding="utf-8"))[camera["model"]]
        sensor = {"format": sold["format"] | camera.get("format", {})}
        camera = {**sold, **camera, **sensor}
    if "format" not in camera:
        return float(camera["fov_deg"])
    long, short = camera["format"]["sensor_mm"]
    circle = camera.get("image_circle_mm", math.inf)
    name, focal = camera.get("projection", ""), camera.get("focal_length")
    if "fov_deg" in camera:
        sides = {"horizontal": long, "vertical": short, "diagonal": math.hypot(long, short)}
        half = math.radians(camera["fov_deg"]) / 2
        focals = {
            one: min(sides[camera["fov_axis"]], circle) / 2 / height(half)
            for one, (height, _) in PROJECTIONS.items()
            if name in ("", one) and (half < math.pi / 2 or one not in NARROW)
        }
        name = min(focals, key=lambda one: abs(focals[one] - (focal or focals[one])))
        focal = focal or focals[name]
    side = long if camera["format"]["section_axis"] == "long" else short
    return math.degrees(2 * PROJECTIONS[name][1](min(side, circle) / 2 / focal))


def _camera_body(camera: Tables) -> list[tuple[complex, complex]]:
    """Lines of its outline, as ahead of the pinhole + i to the left of it."""
    if (module := camera.get("module")) is None:
        half = camera["width"] / 2
        return [(-SETBACK - 1j * half, -SETBACK + 1j * half)]
    front, barrel = module["pupil_depth"], 0.5j * module["lens_diameter"]
    foot, board = front - module["lens_length"], 0.5j * module["board"][0]
    back = foot - module["board_thickness"] - module.get("connector_length", 0.0)
    sides = [(front + one, foot + one) for one in (barrel, -barrel)]
    corners = [foot - board, foot + board, back + board, back - board]
    return [*sides, *zip(corners, [*corners[1:], corners[0]], strict=True)]


def _pads(
    body: Tables, table: Tables, rear: float, tip: float
) -> Iterator[tuple[str, complex, complex, dict[str, Any]]]:
    """Name, ends and layers of every pad.

    Two membranes that begin g from a joint, h below its axis, are 2 (g cos r/2 − h sin r/2) apart
    when it is bent by r: at the greatest flexion, the clearance c. At a height z above them layers
    may reach z tan r/2 beyond, where they are as near to each other then, and g − c / 2, where they
    are so in the straight finger.
    """
    ranges = body["range_deg"]
    pip, dip = ranges if isinstance(ranges, list) else (ranges, body.get("dip_range_deg", ranges))
    below = body["axis_height"] + body.get("protrusion", 0.0)
    clearance, rim = body.get("pad_clearance", 0.0), body["rim"]
    bend = [math.radians(one) / 2 for one in (pip, dip)]
    gap = [(below * math.sin(one) + clearance / 2) / math.cos(one) for one in bend]

    def reach(end: int | None, heights: tuple[float, float], layer: Tables) -> list[float]:
        """Of the lower and the upper edge beyond the membrane, at a joint or at an outer end."""
        if end is None:
            free = max(rim - table.get("wall", 0.5), 0.0)
            return [share * free for share in layer.get("outer_reach", (0.0, 0.0))]
        most = max(gap[end] - clearance / 2, 0.0)
        free = [min(z * math.tan(bend[end]), most) for z in heights]
        return [
            share * one for share, one in zip(layer.get("reach", (0.0, 0.0)), free, strict=True)
        ]

    def layers(ends: tuple[int | None, int | None]) -> dict[str, Any]:
        if not table:
            return {}
        made, low, kind = [], 0.0, table.get("ends", "black")
        for layer in reversed(table["layers"]):
            thick = layer["thickness"]
            reaches = [reach(end, (low, low + thick), layer) for end in ends]
            made.append(
                {
                    "thickness": thick,
                    "index": layer["index"],
                    "overhang": [lower for lower, _ in reaches],
                    "bevel_deg": [math.degrees(math.atan2(a - b, thick)) for a, b in reaches],
                    "sides": {"from": kind, "to": kind},
                }
            )
            low += thick
        return {"layers": made[::-1], "min_transmission": table.get("min_transmission", 0.3)}

    middle, low = body["intermediate"], -1j * below
    yield "proximal", rear + rim + low, -gap[0] + low, layers((None, 0))
    yield "intermediate", gap[0] + low, middle - gap[1] + low, layers((0, 1))
    yield "distal", middle + gap[1] + low, tip - rim + low, layers((1, None))
