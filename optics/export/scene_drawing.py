"""An optical scene as a drawing to build from, and its numbers, in the reference pose."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from designopt.export.drawing import (
    Circle,
    Drawing,
    Kind,
    Label,
    Layer,
    LinearDimension,
    Place,
    Polyline,
    round_down,
)
from designopt.export.json import Quantity
from designopt.io.files import printable
from designopt.vectors import vector
from optics.plot.layer_section import LayerSection
from optics.plot.section import Section
from optics.scene.camera_module import LINES, NAME
from optics.scene.file import FIXED, CameraTable, LayerTable, MirrorTable, PadTable, SurfaceTable
from optics.scene.reading import LEAST_TRANSMISSION, SIDES
from optics.visibility.curves import arc_between

if TYPE_CHECKING:
    from optics.scene.designed import DesignedScene

HINGES, SHEETS = "hinges", "layers"
"""Layers of the hinges, and of the layers and bezels of pads."""

CHORD = 1e-3
"""A curved mirror's line of chords is nowhere so far from it, mm; nor by a tenth of this part of
its length."""

FINEST = 2**16
"""Most chords of a mirror: of one km long they keep the distance."""

DECIMALS = 9
"""Of the corners of layers, mm."""

SIGHT, SIGN = 0.35, 0.01
"""Length of the lines of sight, and radius of circles, as parts of the drawing's diagonal."""


def make_scene_drawing(design: DesignedScene, *, pose: bool = True) -> Drawing:
    """The drawing of a scene in its reference pose.

    Mirrors, pads, blockers, the pads' layers with their bezels, hinges, the camera with its optical
    axis and the edges of its field of view have layers of their own. Dimensions are the lengths of
    mirrors and pads and how far a mirror's ends are from the hinge of its frame, or, if it does not
    move, from the camera (to one far away they are left out) or from a hinge, if that moves.

    Args:
        design: the scene.
        pose: whether a note names the pose.
    """
    file = design.file
    kinds: dict[str, tuple[Kind, Sequence[SurfaceTable]]] = {
        "mirrors": ("mirror", file.mirrors),
        "pads": ("pad", file.pads),
        "blockers": ("blocker", file.blockers),
    }
    polylines, labels, measures, layers = [], [], [], []
    for layer, (kind, parts) in kinds.items():
        if parts:
            layers.append(Layer(layer, kind))
        for part in parts:
            places = _places(part)
            polylines.append(Polyline(layer, places))
            text = part.name if kind == "blocker" else f"{part.name} {kind}"
            labels.append(Label(layer, _middle(places), text))
    if design.scene.layers is not None or design.scene.mirror_layers is not None:
        layers.append(Layer(SHEETS, "body"))
    for mirror in file.mirrors:
        if mirror.layers:
            outline = _sheet(mirror)
            polylines.append(Polyline(SHEETS, outline, closed=True))
            count = len(mirror.layers)
            text = f"{mirror.name} mirror: {count} layer{'s' if count > 1 else ''}"
            labels.append(Label(SHEETS, _middle(outline[2:]), text))
    if design.scene.layers is not None:
        for pad, stack in zip(file.pads, _stacks(design), strict=True):
            if stack is None:
                continue
            outlines = [_rounded(part) for part in (*stack.layers, *stack.bezel)]
            polylines += [Polyline(SHEETS, places, closed=True) for places in outlines]
            count = len(stack.layers)
            text = f"{pad.name}: {count} layer{'s' if count > 1 else ''}"
            labels.append(Label(SHEETS, _middle(outlines[0][2:]), text))
            labels += [Label(SHEETS, _middle(part[1:3]), "bezel") for part in outlines[count:]]
    for part in (*file.mirrors, *file.pads):
        measures.append(LinearDimension(part.start, part.end))
    diagonal, far = _extent(design)
    for part in file.mirrors:
        base = _base(design, part.body)
        if not (far and part.body == FIXED):
            measures += [
                LinearDimension(base, end) for end in (part.start, part.end) if end != base
            ]
    radius = round_down(SIGN * diagonal)
    circles = []
    if file.frames:
        layers.append(Layer(HINGES, "construction"))
    for name, frame in file.frames.items():
        circles.append(Circle(HINGES, name, frame.hinge, radius))
        labels.append(Label(HINGES, frame.hinge, f"hinge {name}"))
    layers += [Layer("camera", "camera", framed=not far)]
    layers += [Layer("field of view", "construction", framed=False)]
    circles.append(Circle("camera", "camera", file.camera.position, radius))
    labels.append(Label("camera", file.camera.position, "camera"))
    polylines += _lines_of_sight(file.camera, SIGHT * diagonal)
    if file.camera.module is not None:
        layers.append(Layer(NAME, "blocker", framed=not far))
        for (x, y), end in np.asarray(design.scene.surface_ends, float)[-LINES:].tolist():
            polylines.append(Polyline(NAME, [(x, y), (end[0], end[1])]))
    return Drawing(
        title=printable(design.name),
        layers=layers,
        polylines=polylines,
        circles=circles,
        labels=labels,
        # Two mirrors may begin in one corner.
        dimensions=list(dict.fromkeys(measures)),
        notes=_notes(design, far, pose=pose),
    )


def scene_quantities(design: DesignedScene) -> list[Quantity]:
    """Every number of a scene file, in its order; angles in degrees."""
    file = design.file
    found = [*_camera_quantities(file.camera)]
    if file.scene.bounces is not None:
        found.insert(0, Quantity("scene.bounces", file.scene.bounces, ""))
    for part in file.mirrors:
        name = f"mirrors.{part.name}"
        found += _surface_quantities(name, part)
        if part.radius is not None:
            found.append(Quantity(f"{name}.radius", part.radius, "mm"))
        if part.conic is not None:
            found.append(Quantity(f"{name}.conic", part.conic, ""))
        for number, layer in enumerate(part.layers, start=1):
            found.append(Quantity(f"{name}.layers.{number}.thickness", layer.thickness, "mm"))
            found.append(Quantity(f"{name}.layers.{number}.index", layer.index, ""))
    for part in file.pads:
        name = f"pads.{part.name}"
        found += _surface_quantities(name, part)
        found.append(Quantity(f"{name}.min_grazing", part.min_grazing_deg, "°"))
        found += _pad_quantities(name, part)
    for part in file.blockers:
        found += _surface_quantities(f"blockers.{part.name}", part)
    for name, frame in file.frames.items():
        found += _place_quantities(f"frames.{name}.hinge", frame.hinge)
    return found


def _camera_quantities(camera: CameraTable) -> Iterator[Quantity]:
    yield from _place_quantities("camera.position", camera.position)
    yield Quantity("camera.direction", camera.direction_deg, "°")
    yield Quantity("camera.field_of_view", camera.section_fov_deg, "°")
    yield Quantity("camera.pixels", camera.section_pixels, "px")
    if isinstance(camera.projection, tuple):
        for index, coefficient in enumerate(camera.projection, start=1):
            yield Quantity(f"camera.projection.k{index}", coefficient, "")
    if camera.sold is not None and camera.format is not None:
        yield Quantity("camera.focal_length", camera.sold.focal_length, "mm")
        for side, length in zip(("long", "short"), camera.format.sensor_mm, strict=True):
            yield Quantity(f"camera.sensor.{side}", length, "mm")
        for side, count in zip(("long", "short"), camera.format.pixels, strict=True):
            yield Quantity(f"camera.sensor.{side}_pixels", count, "px")
    if camera.image_circle_mm is not None:
        yield Quantity("camera.image_circle", camera.image_circle_mm, "mm")
    if camera.max_blur_px is not None:
        yield Quantity("camera.max_blur", camera.max_blur_px, "px")
    if camera.pupil_shift is not None:
        for name, value in zip(("e2", "e4"), camera.pupil_shift, strict=True):
            yield Quantity(f"camera.pupil_shift.{name}", value, "mm")
    if camera.lens is not None:
        yield Quantity("camera.lens.focal_length", camera.lens.focal_length, "mm")
        yield Quantity("camera.lens.f_number", camera.lens.f_number, "")
        yield Quantity("camera.lens.focus", camera.lens.focus, "mm")
        if camera.lens.nearest_focus is not None:
            yield Quantity("camera.lens.nearest_focus", camera.lens.nearest_focus, "mm")
    if camera.module is not None:
        for name, value in camera.module.model_dump(exclude={"board"}).items():
            yield Quantity(f"camera.module.{name}", value, "mm")
        for name, value in zip(("along", "across"), camera.module.board, strict=True):
            yield Quantity(f"camera.module.board.{name}", value, "mm")


def _surface_quantities(name: str, part: SurfaceTable) -> Iterator[Quantity]:
    yield from _place_quantities(f"{name}.from", part.start)
    yield from _place_quantities(f"{name}.to", part.end)
    yield Quantity(f"{name}.length", math.dist(part.start, part.end), "mm")


def _pad_quantities(name: str, pad: PadTable) -> Iterator[Quantity]:
    """What a pad has besides its ends: width, layers and bezel."""
    if pad.width is not None:
        yield Quantity(f"{name}.width", pad.width, "mm")
    if pad.layers:
        least = LEAST_TRANSMISSION if pad.min_transmission is None else pad.min_transmission
        yield Quantity(f"{name}.min_transmission", least, "")
    for number, layer in enumerate(pad.layers, start=1):
        of_layer = f"{name}.layers.{number}"
        yield Quantity(f"{of_layer}.thickness", layer.thickness, "mm")
        for color, index in layer.index:
            yield Quantity(f"{of_layer}.index.{color}", index, "")
        yield from _end_quantities(f"{of_layer}.overhang", layer.overhang, "mm")
        yield from _end_quantities(f"{of_layer}.bevel", layer.bevel_deg, "°")
    if pad.bezel is not None:
        yield from _end_quantities(f"{name}.bezel.lip", pad.bezel.lip, "mm")
        yield Quantity(f"{name}.bezel.height", pad.bezel.height, "mm")


def _end_quantities(name: str, values: tuple[float, float], unit: str) -> Iterator[Quantity]:
    for end, value in zip(("from", "to"), values, strict=True):
        yield Quantity(f"{name}.{end}", value, unit)


def _place_quantities(name: str, place: Place) -> Iterator[Quantity]:
    for axis, value in zip("xy", place, strict=True):
        yield Quantity(f"{name}.{axis}", value, "mm")


def _places(part: SurfaceTable) -> list[Place]:
    """A surface's ends, or places along its curve."""
    if not isinstance(part, MirrorTable) or part.radius is None:
        return [part.start, part.end]
    start, end = (vector(jnp.asarray(place, float)) for place in (part.start, part.end))
    arc = arc_between(
        start, end, jnp.asarray(part.radius, float), jnp.asarray(part.conic or 0.0, float)
    )
    allowed, count = min(CHORD, 0.1 * CHORD * math.dist(part.start, part.end)), 16
    while True:
        # Where a curve is steep against its chord, at its ends, places lie closer.
        parts = (1 - np.cos(np.pi * np.linspace(0, 1, 2 * count + 1))) / 2
        places = np.asarray(arc.place(jnp.asarray(parts)).stacked(), float)
        if count >= FINEST or _off_chords(places) < allowed:
            inner = [(x, y) for x, y in places[2:-1:2].tolist()]
            return [part.start, *inner, part.end]
        count *= 2


def _off_chords(places: Float[np.ndarray, "places 2"]) -> float:
    """The largest distance of every second place from the chord of its neighbours, mm."""
    chords, arrows = places[2::2] - places[:-2:2], places[1::2] - places[:-2:2]
    across = chords[:, 0] * arrows[:, 1] - chords[:, 1] * arrows[:, 0]
    return float(np.max(np.abs(across) / np.hypot(*chords.T)))


def _stacks(design: DesignedScene) -> Sequence[LayerSection | None]:
    """The layers of all pads in the reference pose."""
    return Section.of(design.scene, np.zeros(len(design.scene.angle_names))).stacks


def _sheet(mirror: MirrorTable) -> list[Place]:
    """Outline of a mirror's layers: the ends of the coat, and back along the front."""
    ends = np.array([mirror.start, mirror.end])
    along = (ends[1] - ends[0]) / math.dist(*ends)
    normal = SIDES[mirror.side] * np.array([-along[1], along[0]])
    front = ends[::-1] + sum(layer.thickness for layer in mirror.layers) * normal
    return _rounded(np.vstack([ends, front]))


def _rounded(outline: Float[np.ndarray, "corners 2"]) -> list[Place]:
    """Corners without the rounding of a placed scene, so that 5 mm stay 5 mm."""
    return [(x, y) for x, y in (np.round(outline, DECIMALS) + 0.0).tolist()]


def _middle(places: Sequence[Place]) -> Place:
    """A place on a line, its middle."""
    first, second = places[(len(places) - 1) // 2], places[len(places) // 2]
    return (first[0] + second[0]) / 2, (first[1] + second[1]) / 2


def _base(design: DesignedScene, frame: str) -> Place:
    """From where a mirror that moves with a frame is measured."""
    file = design.file
    if frame != FIXED:
        return file.frames[frame].hinge
    if file.camera.body == FIXED:
        return file.camera.position
    # The camera moves: a hinge of what does not move is near.
    return next(one.hinge for one in file.frames.values() if one.parent == FIXED)


def _extent(design: DesignedScene) -> tuple[float, bool]:
    """The diagonal of all that is near together, mm, and whether the camera is far from it."""
    file = design.file
    lines = [np.array(_places(part)) for part in (*file.mirrors, *file.pads, *file.blockers)]
    hinges = np.array([frame.hinge for frame in file.frames.values()], float).reshape(-1, 2)
    section = Section(np.array(file.camera.position, float), 0.0, tuple(lines), hinges)
    far = section.far_camera() is not None
    places = np.vstack([*lines, hinges, *([] if far else [section.camera[None]])])
    return math.hypot(*np.ptp(places, axis=0)), far


def _lines_of_sight(camera: CameraTable, length: float) -> list[Polyline]:
    half = camera.section_fov_deg / 2
    edges = dict.fromkeys([-half, half] if half < 180 else [half], "field of view")
    polylines = []
    for turn, layer in ({0.0: "camera"} | edges).items():
        angle = math.radians(camera.direction_deg + turn)
        x, y = camera.position
        end = (x + length * math.cos(angle), y + length * math.sin(angle))
        polylines.append(Polyline(layer, [(x, y), end]))
    return polylines


def _notes(design: DesignedScene, far: bool, *, pose: bool) -> list[str]:
    camera, angles = design.file.camera, design.scene.angle_names
    x, y = camera.position
    notes = ["section; joint angles 0" if angles else "section"] if pose else []
    notes.append(
        f"camera at ({x:.6g}, {y:.6g}) mm{', outside the picture' if far else ''}; "
        f"axis {camera.direction_deg:.6g}°, field of view {camera.section_fov_deg:.6g}°"
    )
    for pad in design.file.pads:
        notes += [
            f"{pad.name} pad, layer {number}{' (outside)' * (number == 1)}: {_material(layer)}"
            for number, layer in enumerate(pad.layers, start=1)
        ]
    return notes


def _material(layer: LayerTable) -> str:
    """What a layer is made of, for a line of a title block."""
    indices = [f"{value:.6g}" for _, value in layer.index]
    sides = [kind for _, kind in layer.sides]
    index = indices[0] if len({*indices}) == 1 else f"{'/'.join(indices)} (red/green/blue)"
    kinds = (
        f"sides {sides[0]}" if len({*sides}) == 1 else "from {}, to {}, beside {}".format(*sides)
    )
    return f"{layer.thickness:.6g} mm, index {index}, {kinds}"
