"""An optical scene as a drawing to scale, in any pose, what is seen in it, and its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

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
from optics.plot.section import (
    Angles,
    Point,
    Points,
    Section,
    Traced,
    through_pieces,
    trace_pieces,
)
from optics.scene.camera_module import NAME
from optics.scene.file import CameraTable, LayerTable, PadTable, SurfaceTable
from optics.scene.reading import LEAST_TRANSMISSION
from optics.scene.scene import WORLD, Layout, Scene, Surface
from optics.visibility.curves import arc_between
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces, name_paths

if TYPE_CHECKING:
    from optics.scene.designed import DesignedScene

HINGES, SHEETS, CAMERA, FIELD = "hinges", "layers", "camera", "field of view"
"""Layers of the hinges, of the layers and bezels of pads, of the camera with its optical axis, and
of the edges of its field of view."""

BEZEL = "bezel"

CHORD = 1e-3
"""A curved mirror's line of chords is nowhere so far from it, mm; nor by a tenth of this part of
its length."""

FINEST = 2**16
"""Most chords of a mirror: of one km long they keep the distance."""

DECIMALS = 9
"""Of places, mm: without the rounding of a placed scene 5 mm stay 5 mm."""

PATHS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
"""Colours of what is seen by the paths, in turn."""

WITHIN_CURVED = 17
"""Rays to a piece by curved mirrors, from end to end."""

SIGHT, SIGN = 0.35, 0.01
"""Length of the lines of sight, and radius of circles, as parts of the drawing's diagonal."""


def make_scene_drawing(design: DesignedScene, *, pose: bool = True) -> Drawing:
    """The drawing of a scene in its reference pose, by `draw_scene`.

    Args:
        design: the scene.
        pose: whether a note names the pose.
    """
    scene = design.scene
    section = Section.of(scene, np.zeros(len(scene.angle_names)))
    drawing = draw_scene(scene, section, title=design.name)
    far = not all(layer.framed for layer in drawing.layers if layer.name == CAMERA)
    return drawing._replace(notes=_notes(design, far, pose=pose))


def draw_scene(scene: Scene, section: Section, *, title: str = "") -> Drawing:
    """The drawing of a scene in a pose.

    Mirrors, pads, blockers, the pads' layers with their bezels, hinges, the camera with its optical
    axis and the edges of its field of view have layers of their own. Dimensions are the lengths of
    mirrors and pads and how far a mirror's ends are from the hinge of its frame, or, if it does not
    move, from the camera (to one far away they are left out) or from a hinge, if that moves.

    Args:
        scene: the scene.
        section: the scene in the pose.
        title: of the drawing; the scene's name by default.
    """
    layout, designed = scene.layout, section.designed
    assert designed is not None  # of a whole scene
    coats = _coats(scene, section)
    first = len(layout.mirrors)
    pads = [
        _places(section.pad(scene, index), designed[first + index])
        for index in range(len(layout.pads))
    ]
    parts = len(layout.mirrors) + len(layout.pads)
    others = parts + len(layout.blockers)
    rest = slice(parts, others + len(layout.module))
    dark = list(map(_places, section.lines[rest], designed[rest]))
    blockers, module = dark[: others - parts], dark[others - parts :]
    (camera,) = _places(section.camera[None], np.asarray(scene.camera.position)[None])
    hinges = _places(section.hinges, scene.hinges)
    near = Section(section.camera, 0.0, section.lines[:others], section.hinges)
    far = near.far_camera() is not None
    diagonal = math.hypot(*np.ptp(near.places(), axis=0))

    polylines, labels, layers = [], [], []
    kinds: dict[str, tuple[Kind, Sequence[Surface], Sequence[Sequence[Place]]]] = {
        "mirrors": ("mirror", layout.mirrors, coats),
        "pads": ("pad", layout.pads, pads),
        "blockers": ("blocker", layout.blockers, blockers),
    }
    for layer, (kind, surfaces, lines) in kinds.items():
        if surfaces:
            layers.append(Layer(layer, kind))
        for part, places in zip(surfaces, lines, strict=True):
            text = part.name if kind == "blocker" else f"{part.name} {kind}"
            polylines.append(Polyline(layer, places, name=text))
            labels.append(Label(layer, _middle(places), text))
    if scene.layers is not None or scene.mirror_layers is not None:
        layers.append(Layer(SHEETS, "body"))
    for outline, text, name in _sheets(scene, section, coats):
        polylines.append(Polyline(SHEETS, outline, closed=True, name=name))
        if text:
            labels.append(
                Label(SHEETS, _middle(outline[1:3] if text == BEZEL else outline[2:]), text)
            )
    measures = [LinearDimension(line[0], line[-1]) for line in (*coats, *pads)]
    for part, line in zip(layout.mirrors, coats, strict=True):
        base = hinges[part.frame] if part.frame != WORLD else camera
        if part.frame == WORLD and layout.camera_frame != WORLD:
            # The camera moves: a hinge of what does not move is near.
            base = next(
                hinge
                for frame, hinge in zip(layout.frames, hinges, strict=True)
                if frame.parent == WORLD
            )
        if not (far and part.frame == WORLD):
            measures += [LinearDimension(base, end) for end in (line[0], line[-1]) if end != base]
    radius = round_down(SIGN * diagonal)
    circles = []
    if layout.frames:
        layers.append(Layer(HINGES, "construction"))
    for frame, hinge in zip(layout.frames, hinges, strict=True):
        circles.append(Circle(HINGES, frame.name, hinge, radius))
        labels.append(Label(HINGES, hinge, f"hinge {frame.name}"))
    layers += [Layer(CAMERA, "camera", framed=not far)]
    layers += [Layer(FIELD, "construction", framed=False)]
    circles.append(Circle(CAMERA, "camera", camera, radius))
    labels.append(Label(CAMERA, camera, "camera"))
    half = float(scene.camera.field_of_view) / 2
    polylines += _lines_of_sight(camera, section.axis, half, SIGHT * diagonal)
    if module:
        layers.append(Layer(NAME, "blocker", framed=not far))
        polylines += [Polyline(NAME, line) for line in module]
    return Drawing(
        title=printable(title or layout.name),
        layers=layers,
        polylines=polylines,
        circles=circles,
        labels=labels,
        # Two mirrors may begin in one corner.
        dimensions=list(dict.fromkeys(measures)),
    )


def trace_outlines(scene: Scene, angles: Angles, view: Pieces) -> Traced | None:
    """The rays that bound what is seen of every piece, by `trace_pieces`; none if all are straight.

    Args:
        scene: the scene.
        angles: joint angles in the order of ``scene.angle_names``, rad.
        view: what is seen in this pose, unbatched.
    """
    curved = scene.layout.curved
    if not (curved or scene.layers is not None or scene.rays_slide):
        return None
    return trace_pieces(scene, angles, view, count=WITHIN_CURVED if curved else 2)


def draw_views(
    scene: Scene, section: Section, view: Pieces, traced: Traced | None
) -> tuple[list[Layer], list[Polyline]]:
    """What is seen of a scene in a pose: the light that reaches the camera, as filled outlines.

    Args:
        scene: the scene.
        section: the scene in this pose.
        view: what is seen in this pose, unbatched.
        traced: by `trace_outlines`.

    Returns:
        A layer of kind ``"view"`` for every path by which anything is seen, named as the path, and
        for every piece of a pad that it shows an outline from the camera to the first mirror, one
        from each mirror to the next, and one to the pad, each named as pad and path.
    """
    layout = scene.layout
    names = name_paths(layout, view.spans.shape[-2])
    layers, polylines = dict[int, Layer](), []
    if traced is None:
        rays = _straight_rays(layout, section, view)
    else:
        rays = through_pieces(scene, section, view, traced)
    for path, pad, lines in rays:
        color = PATHS[path % len(PATHS)]
        layers.setdefault(path, Layer(names[path], "view", framed=False, color=color))
        for leg in range(min(map(len, lines)) - 1):
            first, last = ([line[at] for line in lines] for at in (leg, leg + 1))
            outline = dict.fromkeys(_places([*first, *reversed(last)]))
            name = f"{layout.pads[pad].name} pad, {names[path]}"
            polylines.append(Polyline(names[path], [*outline], closed=True, name=name))
    return [layers[path] for path in sorted(layers)], polylines


def _straight_rays(
    layout: Layout, section: Section, view: Pieces
) -> Iterator[tuple[int, int, list[Points]]]:
    """The index of every piece's path, that of its pad, and the corners of rays that bound it."""
    words = paths_of(layout, view.spans.shape[-2])
    for pad, piece in np.argwhere(view.present).tolist():
        path = int(view.path[pad, piece])
        word = words[path]
        met = [section.lines[surface] for surface in (*word, len(layout.mirrors) + pad)]
        on_pad = np.array([view.start[pad, piece], view.end[pad, piece]])
        both = [
            line[0] + at[:, None] * (line[1] - line[0])
            for line, at in zip(met, [*view.spans[pad, piece, : len(word)], on_pad], strict=True)
        ]
        yield path, pad, [np.array([section.camera, *(one[end] for one in both)]) for end in (0, 1)]


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


def _coats(scene: Scene, section: Section) -> list[list[Place]]:
    """Every mirror's ends, or places along its curve; of one with layers those of the coat."""
    layout, coats = scene.layout, []
    first = len(layout.mirrors + layout.pads + layout.blockers + layout.module)
    sheets = iter(section.lines[first : first + len(layout.sheet_ends)])
    for index, (line, designed) in enumerate(
        zip(section.lines, np.asarray(scene.mirrors, float), strict=False)
    ):
        if layout.sheets and layout.sheets[index]:
            line = np.array([next(sheets)[0], next(sheets)[0]])
        ends = _places(line[[0, -1]], designed)
        if index in layout.curved:
            curved = layout.curved.index(index)
            inner = _curve(ends, scene.radii[curved], scene.conics[curved])
            ends[1:1] = [(x, y) for x, y in inner.tolist()]
        coats.append(ends)
    return coats


def _curve(
    ends: Sequence[Place], radius: Float[Array, ""], conic: Float[Array, ""]
) -> Float[np.ndarray, "places 2"]:
    """Places along a curved mirror, between its ends."""
    length = math.dist(*ends)
    allowed, count = min(CHORD, 0.1 * CHORD * length), 16
    while True:
        # Where a curve is steep against its chord, at its ends, places lie closer.
        parts = (1 - np.cos(np.pi * np.linspace(0, 1, 2 * count + 1))) / 2
        places = np.asarray(_on_arc(jnp.array(ends), radius, conic, jnp.asarray(parts)), float)
        if count >= FINEST or _off_chords(places) < allowed:
            return places[2:-1:2]
        count *= 2


@jax.jit
def _on_arc(
    ends: Float[Array, "2 2"],
    radius: Float[Array, ""],
    conic: Float[Array, ""],
    parts: Float[Array, " places"],
) -> Float[Array, "places 2"]:
    return arc_between(vector(ends[0]), vector(ends[1]), radius, conic).place(parts).stacked()


def _off_chords(places: Float[np.ndarray, "places 2"]) -> float:
    """The largest distance of every second place from the chord of its neighbours, mm."""
    chords, arrows = places[2::2] - places[:-2:2], places[1::2] - places[:-2:2]
    across = chords[:, 0] * arrows[:, 1] - chords[:, 1] * arrows[:, 0]
    return float(np.max(np.abs(across) / np.hypot(*chords.T)))


def _sheets(
    scene: Scene, section: Section, coats: Sequence[Sequence[Place]]
) -> Iterator[tuple[list[Place], str, str]]:
    """Outlines of layers and bezels, each with its label, if it has one, and its name."""
    layout = scene.layout
    for mirror, count, coat, front in zip(
        layout.mirrors, layout.sheets, coats, section.lines, strict=False
    ):
        if count:
            name = f"{mirror.name} mirror"
            yield [*coat, *_places(front[::-1])], f"{name}: {_counted(count)}", name
    for pad, stack in zip(layout.pads, section.stacks, strict=True):
        if stack is None:
            continue
        text = f"{pad.name}: {_counted(len(stack.layers))}"
        for number, outline in enumerate(stack.layers, start=1):
            yield _places(outline), text if number == 1 else "", f"{pad.name} pad, layer {number}"
        for outline in stack.bezel:
            yield _places(outline), BEZEL, f"{pad.name} pad, {BEZEL}"


def _counted(count: int) -> str:
    return f"{count} layer{'s' if count > 1 else ''}"


def _places(
    places: Points | Sequence[Point],
    designed: Float[Array | np.ndarray, "places 2"] | None = None,
) -> list[Place]:
    """Places in the pose; those that are where they are in the file have its numbers."""
    found = [place.tolist() for place in places]
    if designed is None:
        return [(round(x, DECIMALS) + 0.0, round(y, DECIMALS) + 0.0) for x, y in found]
    pairs = zip(found, np.asarray(designed, float).tolist(), strict=True)
    return [(_rounded(x, own_x), _rounded(y, own_y)) for (x, y), (own_x, own_y) in pairs]


def _rounded(value: float, designed: float) -> float:
    return designed if abs(value - designed) < 10.0**-DECIMALS else round(value, DECIMALS) + 0.0


def _middle(places: Sequence[Place]) -> Place:
    """A place on a line, its middle."""
    first, second = places[(len(places) - 1) // 2], places[len(places) // 2]
    return (first[0] + second[0]) / 2, (first[1] + second[1]) / 2


def _lines_of_sight(camera: Place, axis: float, half: float, length: float) -> list[Polyline]:
    """The optical axis and both edges of the field of view: one, if they coincide."""
    edges = dict.fromkeys([-half, half] if half < math.pi else [half], FIELD)
    polylines = []
    for turn, layer in ({0.0: CAMERA} | edges).items():
        across, up = (length * part(axis + turn) for part in (math.cos, math.sin))
        name = "optical axis" if layer == CAMERA else ""
        polylines.append(Polyline(layer, [camera, (camera[0] + across, camera[1] + up)], name=name))
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
