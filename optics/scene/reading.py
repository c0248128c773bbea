"""From a scene file to a scene: names and frames, with every fault explained."""

from __future__ import annotations

import difflib
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Array, Float

from designopt.design_kind import read_tables
from designopt.errors import UserError
from designopt.io.files import printable
from designopt.io.spec_files import validated
from designopt.numerics import as_float
from optics.scene.camera import Camera, Sensor
from optics.scene.camera_module import LINES, NAME, CameraModule
from optics.scene.file import (
    FIXED,
    BezelTable,
    CameraTable,
    FrameTable,
    LayerTable,
    LensTable,
    MirrorTable,
    ModuleTable,
    PadTable,
    SceneFile,
    SurfaceTable,
)
from optics.scene.layers import CHANNELS, LayerKinds, Layers, MirrorLayers
from optics.scene.module_room import module_faults
from optics.scene.scene import WORLD, Frame, Layout, Scene, Surface
from optics.scene.sold import projection_of
from optics.scene.thin_lens import ThinLens

SIDES = {"left": 1, "right": -1, "both": 0}
LEAST_TRANSMISSION = 0.3
"""Of a pad with layers, unless its file states another."""

SENSES = {"counterclockwise": 1, "clockwise": -1}


def read_scene(path: str | Path) -> Scene:
    """The scene that a file describes.

    Args:
        path: a TOML file of a camera, mirrors, pads, blockers and frames (see the README).

    Returns:
        The scene. Arrays have JAX's default float type.

    Raises:
        UserError: the file cannot be read or describes no scene; one line has the place and what to
            change.

    Example:
        >>> from importlib.resources import files
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> [mirror.name for mirror in scene.layout.mirrors]
        ['lower', 'upper']
    """
    return parse_scene(read_tables(path, "scene", "camera"), str(path))


def parse_scene(data: Mapping[str, Any], source: str = "scene") -> Scene:
    """The scene that the tables of a scene file describe; otherwise as `read_scene`.

    Args:
        data: the tables, as `tomllib` gives them.
        source: where they come from, for messages.

    Example:
        >>> import tomllib
        >>> from importlib.resources import files
        >>> text = (files("studies") / "gallery/scenes/periscope.toml").read_text()
        >>> [pad.name for pad in parse_scene(tomllib.loads(text)).layout.pads]
        ['landscape']
    """
    return build_scene(validated(SceneFile, data, source), source)


def refuse_faults(file: SceneFile, source: str) -> None:
    """Nothing, if a file's content describes a scene.

    Raises:
        UserError: it does not, and why.
    """
    faults = [
        *_layer_faults(file),
        *_surface_faults(file),
        *_body_faults(file),
        *_frame_faults(file.frames),
    ]
    if file.camera.module is not None:
        faults += module_faults(file.camera, _module(file.camera.module), _kinds(file))
    if faults:
        raise UserError(f"{source}: " + "; ".join(faults))


def build_scene(file: SceneFile, source: str) -> Scene:
    """The scene of a file's content; otherwise as `parse_scene`."""
    refuse_faults(file, source)
    curved = tuple(i for i, mirror in enumerate(file.mirrors) if mirror.radius is not None)
    # Parents have fewer ancestors than their children.
    names = sorted(file.frames, key=lambda name: len(_ancestors(file.frames, name)))
    index = {FIXED: WORLD} | {name: i for i, name in enumerate(names)}
    angles = tuple(dict.fromkeys(frame.angle for frame in file.frames.values()))

    def surfaces(tables: Sequence[SurfaceTable]) -> tuple[Surface, ...]:
        return tuple(Surface(part.name, SIDES[part.side], index[part.body]) for part in tables)

    sheets = tuple(len(mirror.layers) for mirror in file.mirrors)
    layout = Layout(
        name=file.scene.name or printable(Path(source).stem),
        mirrors=surfaces(file.mirrors),
        curved=curved,
        pads=surfaces(file.pads),
        blockers=surfaces(file.blockers),
        frames=tuple(
            Frame(name, index[frame.parent], angles.index(frame.angle), SENSES[frame.positive])
            for name, frame in ((name, file.frames[name]) for name in names)
        ),
        angles=angles,
        camera_frame=index[file.camera.body],
        bounces=_bounces(file),
        layers=_kinds_of_layers(file.pads),
        bezels=tuple(pad.bezel is not None for pad in file.pads) if _layered(file.pads) else (),
        module=(Surface(NAME, 0, index[file.camera.body]),) * (LINES if file.camera.module else 0),
        sheets=sheets if any(sheets) else (),
    )
    return Scene(
        camera=build_camera(file.camera),
        mirrors=_ends(file.mirrors),
        radii=as_float(np.asarray([file.mirrors[i].radius for i in curved], float)),
        conics=as_float(np.asarray([file.mirrors[i].conic or 0.0 for i in curved], float)),
        pads=_ends(file.pads),
        grazing=as_float(
            np.asarray([math.radians(pad.min_grazing_deg) for pad in file.pads], float)
        ),
        blockers=_ends(file.blockers),
        hinges=as_float(
            np.asarray(np.reshape([file.frames[name].hinge for name in names], (-1, 2)), float)
        ),
        layout=layout,
        layers=_layers(file.pads) if layout.layers else None,
        widths=_widths(file.pads),
        mirror_layers=_sheets(file.mirrors) if layout.sheets else None,
    )


def _layered(pads: Sequence[PadTable]) -> bool:
    return any(pad.layers for pad in pads)


def _kinds_of_layers(pads: Sequence[PadTable]) -> tuple[tuple[LayerKinds, ...], ...]:
    if not _layered(pads):
        return ()
    return tuple(
        tuple(LayerKinds(of.start, of.end, of.beside) for of in (part.sides for part in pad.layers))
        for pad in pads
    )


def _layers(pads: Sequence[PadTable]) -> Layers:
    most = max(len(pad.layers) for pad in pads)

    def column(number: Callable[[LayerTable], Any], missing: Any) -> Float[np.ndarray, "..."]:
        rows = [[number(layer) for layer in pad.layers] for pad in pads]
        return np.array([row + [missing] * (most - len(row)) for row in rows], float)

    def indices(pad: PadTable) -> list[list[float]]:
        own = [[getattr(layer.index, color) for color in CHANNELS] for layer in pad.layers]
        return own + [own[-1] if own else [1.0] * len(CHANNELS)] * (most - len(own))

    bezels = [pad.bezel or BezelTable(lip=(0.0, 0.0), height=0.0) for pad in pads]
    default = [LEAST_TRANSMISSION if pad.layers else 0.0 for pad in pads]
    least = [
        other if pad.min_transmission is None else pad.min_transmission
        for pad, other in zip(pads, default, strict=True)
    ]
    return Layers(
        thickness=column(lambda layer: layer.thickness, 0.0),
        index=np.array([indices(pad) for pad in pads]),
        overhang=column(lambda layer: layer.overhang, [0.0] * 2),
        bevel=np.deg2rad(column(lambda layer: layer.bevel_deg, [0.0] * 2)),
        lip=np.array([bezel.lip for bezel in bezels]),
        height=np.array([bezel.height for bezel in bezels]),
        transmission=np.array(least),
    )


def _sheets(mirrors: Sequence[MirrorTable]) -> MirrorLayers:
    most = max(len(mirror.layers) for mirror in mirrors)
    none = [(0.0, 1.0)] * most
    rows = [[(of.thickness, of.index) for of in mirror.layers] + none for mirror in mirrors]
    numbers = np.array([row[:most] for row in rows])
    return MirrorLayers(thickness=numbers[..., 0], index=numbers[..., 1])


def _widths(pads: Sequence[PadTable]) -> Float[Array, " pads"] | None:
    if all(pad.width is None for pad in pads):
        return None
    return as_float(np.array([math.nan if pad.width is None else pad.width for pad in pads]))


def _bounces(file: SceneFile) -> int:
    """Most reflections of a view: as asked for, or two, or one for a single flat mirror."""
    if file.scene.bounces is not None:
        return file.scene.bounces
    # Light may meet a curved mirror twice in a row, a straight one not.
    curved = any(mirror.radius is not None for mirror in file.mirrors)
    return 2 if curved else min(len(file.mirrors), 2)


def _ends(tables: Sequence[SurfaceTable]) -> Float[Array, "surfaces 2 2"]:
    return as_float(
        np.asarray(np.reshape([(part.start, part.end) for part in tables], (-1, 2, 2)), float)
    )


def build_camera(table: CameraTable) -> Camera:
    """The camera of ``[camera]`` of a file."""
    sold, size = table.sold, table.format
    sensor, field = None, math.radians(table.section_fov_deg)
    if sold is not None and size is not None:
        along, across = table.section_side, 1 - table.section_side
        field = sold.field
        sensor = Sensor(
            size=as_float(np.asarray([size.sensor_mm[along], size.sensor_mm[across]], float)),
            aspect=size.pixels[across] / size.pixels[along],
            focal_length=sold.focal_length,
            image_circle=table.image_circle_mm,
        )
    offset = table.axis_offset_px
    return Camera(
        position=as_float(np.asarray(table.position, float)),
        direction=math.radians(table.direction_deg),
        field_of_view=field,
        pixels=table.section_pixels,
        projection=projection_of(table.section_projection),
        lens=None if table.lens is None else _lens(table.lens),
        sensor=sensor,
        module=None if table.module is None else _module(table.module),
        max_blur=table.max_blur_px,
        pupil_shift=None
        if table.pupil_shift is None
        else as_float(np.asarray(table.pupil_shift, float)),
        axis_offset=None if offset is None else as_float(np.asarray(offset, float)),
    )


def _module(table: ModuleTable) -> CameraModule:
    return CameraModule(**table.model_dump() | {"board": as_float(np.asarray(table.board, float))})


def _lens(table: LensTable) -> ThinLens:
    return ThinLens(
        focal_length=table.focal_length,
        aperture=table.focal_length / table.f_number,
        # The lens equation for an object at `focus`.
        sensor_distance=table.focal_length / (1 - table.focal_length / table.focus),
        nearest_focus=table.nearest_focus,
    )


def _kinds(file: SceneFile) -> dict[str, Sequence[SurfaceTable]]:
    return {"mirrors": file.mirrors, "pads": file.pads, "blockers": file.blockers}


def _surface_faults(file: SceneFile) -> Iterator[str]:
    kinds = _kinds(file)
    if not any(kinds.values()):
        yield "pads: there is nothing to see; add a pad, a mirror or a blocker"
    for kind, tables in kinds.items():
        for name, times in Counter(part.name for part in tables).items():
            if times > 1:
                yield f"{kind}: {times} are named '{name}'; give each its own name"


def _layer_faults(file: SceneFile) -> Iterator[str]:
    curved = [mirror.name for mirror in file.mirrors if mirror.radius is not None]
    layered = [pad.name for pad in file.pads if pad.layers]
    sheets = [mirror.name for mirror in file.mirrors if mirror.layers]
    if curved and sheets:
        yield (
            f"mirrors: light over curved mirrors ({', '.join(curved)}) is not followed over those "
            f"with layers ({', '.join(sheets)}); make them all straight, or leave out 'layers'"
        )
    if curved and layered:
        yield (
            f"pads: light over curved mirrors ({', '.join(curved)}) is not followed through layers "
            f"({', '.join(layered)}); make the mirrors straight, or the pads bare"
        )


def _body_faults(file: SceneFile) -> Iterator[str]:
    known = [*file.frames, FIXED]
    bodies = {"camera.body": file.camera.body}
    for kind, tables in _kinds(file).items():
        bodies |= {f"{kind}.{i}.body": part.body for i, part in enumerate(tables)}
    bodies |= {f"frames.{name}.parent": frame.parent for name, frame in file.frames.items()}
    for where, name in bodies.items():
        if name not in known:
            yield f"{where}: {_unknown(name, known)}"


def _unknown(name: str, known: list[str]) -> str:
    close = difflib.get_close_matches(name, known, n=1)
    others = f"there are: {', '.join(known)}; take one of these, or add [frames.{name}]"
    hint = f"did you mean '{close[0]}'?" if close else others
    return f"no frame is named '{name}'; {hint}"


def _frame_faults(frames: Mapping[str, FrameTable]) -> Iterator[str]:
    if FIXED in frames:
        yield f"frames.{FIXED}: '{FIXED}' is what does not move; choose another name"
        return
    for name in frames:
        line = _ancestors(frames, name)
        # Each ring is named once, by the first of its frames.
        if name in line and name == min(line, key=list(frames).index):
            ring = " in ".join(f"'{part}'" for part in [name, *line])
            yield (
                f"frames.{name}.parent: {ring}: frames cannot hold each other; hinge one of them "
                f"in '{FIXED}'"
            )


def _ancestors(frames: Mapping[str, FrameTable], name: str) -> list[str]:
    """Frames that a frame is hinged in, its parent first; ends where one comes again."""
    line: list[str] = []
    parent = frames[name].parent
    while parent in frames and parent not in line:
        line.append(parent)
        parent = frames[parent].parent
    return line
