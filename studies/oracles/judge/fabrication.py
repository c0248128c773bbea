"""Errors of one finger that has been made, and the plain tables of that finger.

Errors are a plain dictionary: ``camera`` [dx, dy] (mm), ``lateral`` (mm towards +z), ``tilt``,
``yaw`` and ``roll`` (rad) of the camera; ``pupil`` (mm/rad²), ``distortion`` (k₁) and
``lateral_color`` [red, blue] of its lens; ``mirror_tilt``, ``mirror_lean`` (rad),
``mirror_offset`` and ``mirror_bow`` (mm) by mirror; ``pad_tilt``, ``pad_lean`` (rad),
``pad_offset`` and ``pad_shift`` (mm) by pad; ``thickness`` (mm) and ``index`` by pad and layer.
What is not named is as designed.

The tables of a finger that has been made have keys that no scene file has: ``lean`` (rad) of
mirrors and pads, ``bow`` (mm) of mirrors, and ``lateral``, ``yaw``, ``roll`` and ``lateral_color``
of the camera.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from studies.oracles.judge.solids import Tables

CAMERA_BODY = "camera body"
"""The blocker that the camera carries."""

Channel = Literal["red", "green", "blue"]

CHANNELS: tuple[Channel, ...] = ("red", "green", "blue")
"""Of an image, in their order."""

Errors = Mapping[str, Any]


def sample_errors(
    tables: Tables, deviations: Errors, generator: np.random.Generator
) -> dict[str, Any]:
    """Independent normal errors of the given standard deviations.

    Args:
        tables: of the scene as designed.
        deviations: by the errors' names, a number for all of an error's entries or a list with one
            for each.
        generator: of random numbers.
    """
    mirrors, pads = len(tables.get("mirrors", [])), tables.get("pads", [])
    layers = [len(pad.get("layers", [])) for pad in pads]
    shapes: dict[str, Any] = {
        "camera": 2,
        "lateral_color": 2,
        "thickness": layers,
        "index": layers,
        **dict.fromkeys(("lateral", "tilt", "yaw", "roll", "pupil", "distortion")),
        **dict.fromkeys(("mirror_tilt", "mirror_offset", "mirror_lean", "mirror_bow"), mirrors),
        **dict.fromkeys(("pad_tilt", "pad_offset", "pad_shift", "pad_lean"), len(pads)),
    }
    if unknown := set(deviations) - set(shapes):
        raise ValueError(f"no errors of fabrication: {sorted(unknown)}")

    def draw(deviation: Any, shape: Any) -> Any:
        if isinstance(shape, list):
            each = [deviation] * len(shape) if np.ndim(deviation) == 0 else deviation
            return [draw(*one) for one in zip(each, shape, strict=True)]
        return (np.asarray(deviation) * generator.standard_normal(shape)).tolist()

    return {
        name: draw(deviations[name], shape) for name, shape in shapes.items() if name in deviations
    }


def fabricated(tables: Tables, errors: Errors) -> dict[str, Any]:
    """The tables of the finger that has been made with such errors."""

    def error(name: str, *entry: int) -> Any:
        value = errors.get(name, 0.0)
        for one in entry:
            value = value[one] if np.ndim(value) else value
        return value

    made = dict(tables)
    camera, shift = dict(tables["camera"]), complex(error("camera", 0), error("camera", 1))
    pinhole = complex(*camera["position"])
    camera["position"] = _pair(pinhole + shift)
    camera["direction_deg"] += math.degrees(error("tilt"))
    for name in ("lateral", "yaw", "roll"):
        camera[name] = error(name)
    camera["lateral_color"] = [error("lateral_color", 0), error("lateral_color", 1)]
    first, second = camera.get("pupil_shift", (0.0, 0.0))
    camera["pupil_shift"] = [first + error("pupil"), second]
    if k1 := error("distortion"):
        projection = camera.get("projection", "equidistant")
        known = [0.0] if projection == "equidistant" else projection
        camera["projection"] = [known[0] + k1, *known[1:]]
    made["camera"] = camera
    made["mirrors"] = [
        _displaced(mirror, error("mirror_tilt", i), error("mirror_offset", i))
        | {"lean": error("mirror_lean", i), "bow": error("mirror_bow", i)}
        for i, mirror in enumerate(tables.get("mirrors", []))
    ]
    made["pads"] = [
        _displaced(pad, error("pad_tilt", i), error("pad_offset", i), error("pad_shift", i))
        | {
            "lean": error("pad_lean", i),
            "layers": [
                layer
                | {
                    "thickness": layer["thickness"] + error("thickness", i, j),
                    "index": _added(layer["index"], error("index", i, j)),
                }
                for j, layer in enumerate(pad.get("layers", []))
            ],
        }
        for i, pad in enumerate(tables.get("pads", []))
    ]
    turn = cmath.exp(1j * error("tilt"))
    made["blockers"] = [
        part
        | {
            end: _pair(pinhole + shift + turn * (complex(*part[end]) - pinhole))
            for end in ("from", "to")
            if part["name"] == CAMERA_BODY
        }
        for part in tables.get("blockers", [])
    ]
    return made


def of_channel(tables: Tables, channel: Channel) -> dict[str, Any]:
    """The tables as light of one color meets them: its indices, and the scale of its image."""
    red, blue = tables["camera"].get("lateral_color", (0.0, 0.0))
    change = {"red": red, "green": 0.0, "blue": blue}[channel]
    pads = [
        pad
        | {
            "layers": [
                layer | {"index": index[channel] if isinstance(index, Mapping) else index}
                for layer in pad.get("layers", [])
                for index in [layer["index"]]
            ]
        }
        for pad in tables.get("pads", [])
    ]
    return {**tables, "camera": tables["camera"] | {"scale": 1 + change}, "pads": pads}


def _displaced(
    part: Mapping[str, Any], tilt: float, offset: float, shift: float = 0.0
) -> dict[str, Any]:
    """A segment turned about its middle, then moved along its left normal and along itself."""
    start, end = complex(*part["from"]), complex(*part["to"])
    middle, half = (start + end) / 2, (end - start) / 2 * cmath.exp(1j * tilt)
    middle += half / abs(half) * (shift + 1j * offset)
    return {**part, "from": _pair(middle - half), "to": _pair(middle + half)}


def _pair(place: complex) -> list[float]:
    return [place.real, place.imag]


def _added(index: Any, error: float) -> Any:
    if isinstance(index, Mapping):
        return {channel: value + error for channel, value in index.items()}
    return index + error
