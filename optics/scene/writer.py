"""A scene as the file that it could have been read from."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from designopt.io.files import replaced_when_complete
from designopt.io.spec_files import FORMAT, LARGEST
from designopt.io.toml_writing import degrees_of, format_toml
from optics.scene.camera import Camera, Sensor
from optics.scene.file import FIXED
from optics.scene.layers import CHANNELS, Layers, MirrorLayers
from optics.scene.reading import SENSES, SIDES
from optics.scene.scene import WORLD, Layout, Scene, Surface
from optics.scene.sold import projection_entry


def scene_tables(scene: Scene) -> dict[str, Any]:
    """The tables of a scene's file; `optics.parse_scene` makes the same scene of them.

    Args:
        scene: a single one. Numbers of a lens come back to rounding, all others as they are. The
            field of view of a camera with a sensor is not written: it follows.
    """
    layout = scene.layout
    names = {WORLD: FIXED} | {index: frame.name for index, frame in enumerate(layout.frames)}

    def surfaces(parts: Sequence[Surface], ends: Any) -> list[dict[str, Any]]:
        found = []
        for part, (start, end) in zip(parts, np.asarray(ends, float).tolist(), strict=True):
            table = {"name": part.name, "from": start, "to": end, "side": _key(SIDES, part.side)}
            found.append(table | ({} if part.frame == WORLD else {"body": names[part.frame]}))
        return found

    mirrors = surfaces(layout.mirrors, scene.mirrors)
    arcs = zip(layout.curved, np.asarray(scene.radii), np.asarray(scene.conics), strict=True)
    for index, radius, conic in arcs:
        mirrors[index] |= {"radius": float(radius), "conic": float(conic)}
    if scene.mirror_layers is not None:
        for index in np.flatnonzero(layout.sheets).tolist():
            mirrors[index]["layers"] = _sheets(scene.mirror_layers, layout, index)
    pads = surfaces(layout.pads, scene.pads)
    for pad, grazing in zip(pads, np.asarray(scene.grazing, float).tolist(), strict=True):
        pad["min_grazing_deg"] = degrees_of(grazing)
    if scene.widths is not None:
        for pad, width in zip(pads, np.asarray(scene.widths, float).tolist(), strict=True):
            pad |= {} if math.isnan(width) else {"width": width}
    if scene.layers is not None:
        pads = [pad | _layers(scene.layers, layout, i) for i, pad in enumerate(pads)]
    camera = camera_table(scene.camera)
    if layout.camera_frame != WORLD:
        camera["body"] = names[layout.camera_frame]
    hinges = np.asarray(scene.hinges, float).tolist()
    frames = {}
    for index in _frames_as_in_a_file(layout):
        frame = layout.frames[index]
        frames[frame.name] = {
            "hinge": hinges[index],
            "angle": layout.angles[frame.angle],
            "parent": names[frame.parent],
            "positive": _key(SENSES, frame.sign),
        }
    tables = {
        "scene": {"name": layout.name, "format": FORMAT, "bounces": layout.bounces},
        "camera": camera,
        "mirrors": mirrors,
        "pads": pads,
        "blockers": surfaces(layout.blockers, scene.blockers),
        "frames": frames,
    }
    return {name: table for name, table in tables.items() if table}


def format_scene(scene: Scene) -> str:
    """The text of a scene's file; `optics.read_scene` reads the same back.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> "[camera]" in format_scene(scene).splitlines()
        True
    """
    return format_toml(scene_tables(scene), "Camera, mirrors, pads and blockers: mm.")


def write_scene(scene: Scene, path: str | Path) -> None:
    """Write a scene's file; an existing one is replaced when the new one is complete.

    Args:
        scene: a single one.
        path: of the file.

    Example:
        >>> import tempfile
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_scene(scene, f"{folder}/copy.toml")
        ...     copy = read_scene(f"{folder}/copy.toml")
        >>> copy.layout == scene.layout
        True
    """
    with replaced_when_complete(Path(path)) as partial:
        partial.write_text(format_scene(scene), encoding="utf-8")


def camera_table(camera: Camera) -> dict[str, Any]:
    """``[camera]`` of a scene's file; see `scene_tables`."""
    table: dict[str, Any] = {
        "position": np.asarray(camera.position, float).tolist(),
        "direction_deg": degrees_of(float(camera.direction)),
    }
    if camera.sensor is None:
        table["fov_deg"] = degrees_of(float(camera.field_of_view))
        table["pixels"] = round(float(camera.pixels))
    else:
        table |= _sensor(camera.sensor, round(float(camera.pixels)))
    table["projection"] = projection_entry(camera.projection)
    if camera.max_blur is not None:
        table["max_blur_px"] = float(camera.max_blur)
    if camera.pupil_shift is not None:
        table["pupil_shift"] = np.asarray(camera.pupil_shift, float).tolist()
    if camera.axis_offset is not None:
        table["axis_offset_px"] = np.asarray(camera.axis_offset, float).tolist()
    if camera.lens is not None:
        focal, sensor = float(camera.lens.focal_length), float(camera.lens.sensor_distance)
        table["lens"] = {
            "focal_length": focal,
            "f_number": focal / float(camera.lens.aperture),
            # A sensor in the focal plane: focused at infinity, for which a file has no number.
            "focus": LARGEST if sensor == focal else focal / (1 - focal / sensor),
        }
        if camera.lens.nearest_focus is not None:
            # Rounding may have brought the focus nearer than this.
            nearest = min(float(camera.lens.nearest_focus), table["lens"]["focus"])
            table["lens"]["nearest_focus"] = nearest
    if camera.module is not None:
        table["module"] = {
            field.name: np.asarray(getattr(camera.module, field.name), float).tolist()
            for field in dataclasses.fields(camera.module)
        }
    return table


def _sensor(sensor: Sensor, pixels: int) -> dict[str, Any]:
    """The keys of a lens before a sensor, whose field of view follows."""
    sides = np.asarray(sensor.size, float).tolist()
    counts = [pixels, round(pixels * float(sensor.aspect))]
    order = 1 if sides[0] >= sides[1] else -1
    table: dict[str, Any] = {
        "format": {
            "sensor_mm": sides[::order],
            "pixels": counts[::order],
            "section_axis": "long" if order == 1 else "short",
        },
        "focal_length": float(sensor.focal_length),
    }
    if sensor.image_circle is not None:
        table["image_circle_mm"] = float(sensor.image_circle)
    return table


def _sheets(layers: MirrorLayers, layout: Layout, mirror: int) -> list[dict[str, float]]:
    own = slice(layout.sheets[mirror])
    pairs = zip(layers.thickness[mirror, own], layers.index[mirror, own], strict=True)
    return [{"thickness": float(thickness), "index": float(index)} for thickness, index in pairs]


def _layers(layers: Layers, layout: Layout, pad: int) -> dict[str, Any]:
    """The keys of a pad that its layers add."""
    kinds = layout.layers[pad]
    if not kinds:
        return {}
    numbers = jax.tree.map(lambda leaf: np.asarray(leaf, float)[pad].tolist(), layers)
    found: dict[str, Any] = {
        "min_transmission": numbers.transmission,
        "layers": [
            {
                "thickness": numbers.thickness[layer],
                "index": dict(zip(CHANNELS, numbers.index[layer], strict=True)),
                "sides": dict(zip(("from", "to", "beside"), sides, strict=True)),
                "overhang": numbers.overhang[layer],
                "bevel_deg": [degrees_of(angle) for angle in numbers.bevel[layer]],
            }
            for layer, sides in enumerate(kinds)
        ],
    }
    bezel = {"lip": numbers.lip, "height": numbers.height}
    return found | ({"bezel": bezel} if layout.bezels[pad] else {})


def _frames_as_in_a_file(layout: Layout) -> list[int]:
    """An order of the frames from which a reader finds the same order of frames and of angles.

    It sorts frames by how deep they are hinged in each other, and angles by who comes first.
    """
    depths: list[int] = []
    for frame in layout.frames:
        depths.append(0 if frame.parent == WORLD else depths[frame.parent] + 1)
    waiting = [
        [i for i, deep in enumerate(depths) if deep == depth] for depth in sorted(set(depths))
    ]
    order: list[int] = []
    met = 0
    while any(waiting):
        line = next(one for one in waiting if one and layout.frames[one[0]].angle <= met)
        met = max(met, layout.frames[line[0]].angle + 1)
        order.append(line.pop(0))
    return order


def _key(names: dict[str, int], value: int) -> str:
    return next(name for name, one in names.items() if one == value)
