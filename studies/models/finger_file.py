"""The finger's file: ``[finger]``, ``[body]``, ``[pins]``, and what a finger has besides.

No number in it follows from another. Lengths in mm, coordinates of the straight finger.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import fields
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, Any, Literal

import jax
import numpy as np
from pydantic import Field, model_validator

from designopt import Context, Spec, UserError
from designopt.design_kind import read_tables
from designopt.io.files import printable, replaced_when_complete
from designopt.io.spec_files import FORMAT, Format, Length, Number, Point, Title, validated
from designopt.io.toml_writing import degrees_of, format_toml
from designopt.progress import step_display
from kinematics.io.designed import DesignedLinkage
from optics.scene.camera import Camera
from optics.scene.designed import DesignedScene
from optics.scene.file import LARGEST_INDEX, MOST_LAYERS
from optics.scene.file import CameraTable as LensTable
from optics.scene.reading import build_camera
from optics.scene.writer import camera_table
from studies.models.body import BodyTable
from studies.models.finger import Finger
from studies.models.finger_parts import (
    MOUNT,
    Body,
    FingerCamera,
    FingerMirror,
    FingerMotor,
    FingerSpring,
    Phalanx,
)
from studies.models.link_layers import Links
from studies.models.linkage_kinds import COUPLED, SIX_BAR, KindName
from studies.models.links import LinksTable
from studies.models.pad_layers import LEAST_TRANSMISSION, WALL, PadLayers
from studies.models.pins import PINS, pin_name

SAME = 1e-6
"""Two statements of one number contradict each other where they differ by more, mm and rad."""

FOREIGN = ("position", "direction_deg", "body", "pupil_shift")
"""Keys of a scene's camera that a finger's does not have."""

Angle = Annotated[Number, Field(ge=-180, le=180)]
Share = Annotated[Number, Field(ge=0, le=1)]


class FingerTable(Spec):
    """``[finger]``."""

    name: Title | None = None
    """Its name, in titles and file names."""
    format: Format = FORMAT
    """Version of the file's format."""


class PinsTable(Spec):
    """``[pins]``: places in the straight finger, PIP axis at the origin, by paper B's names."""

    F: Point
    """Axis of the crank EF, in the proximal phalanx, mm."""
    E: Point
    """Crank EF to bar DE, mm."""
    D: Point
    """Bar DE to plate CD, mm."""
    C: Point
    """Plate CD to the distal phalanx, mm."""
    G: Point
    """Bar GG' to the intermediate phalanx, mm."""
    H: Point = Field(alias="G'")
    """Bar GG' to plate CD, mm."""
    K: Point | None = None
    """Crank to the coupler of the motor's parallelogram, mm; absent without a motor."""


class CouplingPinsTable(Spec):
    """``[pins]`` of a coupled finger; see `CouplingPins`."""

    P: Point
    """Bar to the proximal phalanx, mm."""
    Q: Point
    """Bar to the distal phalanx, mm."""
    K: Point | None = None
    """Crank to the coupler of the motor's parallelogram, mm; absent without a motor."""


class SpringTable(Spec):
    """``[spring]``; see `FingerSpring`."""

    stiffness: Annotated[Number, Field(ge=0)]
    """Torsion spring between distal phalanx and plate CD, N mm/rad."""
    preload: Number
    """Angle by which it is wound in the straight finger, rad."""
    servo: Annotated[Number, Field(gt=0)]
    """Stiffness of the motor's position control, N mm/rad."""


class MotorTable(Spec):
    """``[motor]``; see `FingerMotor`."""

    behind: Length
    """Motor's axis M behind the rear end of the proximal phalanx, mm."""
    above: Number
    """M above the axis of the crank, mm."""


class CameraTable(LensTable):
    """``[camera]``; see `FingerCamera`. Its lens is written as in a scene file."""

    position: Point = (0.0, 0.0)
    direction_deg: Number = 0.0
    phalanx: Phalanx = "intermediate"
    """The phalanx that carries it."""
    along: Number
    """Entrance pupil from the phalanx's own joint axis along the finger, mm."""
    depth: Number
    """Entrance pupil below the dorsal face, mm."""
    tilt_deg: Angle
    """Optical axis from straight down, positive towards the tip, degrees."""
    width: Length
    """Of the opaque body along the section, mm."""
    back: Length = 4.0
    """From the pinhole to the back of the opaque body, mm."""
    min_grazing_deg: Annotated[Number, Field(ge=0, lt=90)]
    """Least angle between ray and pad for a view to count, degrees."""

    @model_validator(mode="before")
    @classmethod
    def _has_its_own_place(cls, data: Any) -> Any:
        if isinstance(data, dict) and (given := [key for key in FOREIGN if key in data]):
            raise ValueError(
                f"{', '.join(given)}: of a scene's camera; a finger's has 'along', 'depth' and "
                "'tilt_deg'"
            )
        return data

    @property
    def optics(self) -> Camera:
        """Lens and sensor, somewhere."""
        return build_camera(self)


class LayerTable(Spec):
    """An entry of ``layers`` of ``[pads]``; see `PadLayers`."""

    thickness: Length
    """mm."""
    index: Annotated[Number, Field(ge=1, le=LARGEST_INDEX)]
    """Index of refraction."""
    reach: tuple[Share, Share] = (0.0, 0.0)
    """How far the lower and upper edge of its ends at the joints stand beyond the membrane, as a
    share of what is free."""
    outer_reach: tuple[Share, Share] = (0.0, 0.0)
    """The same at the outer ends of the finger."""


class PadsTable(Spec):
    """``[pads]``; see `PadLayers`."""

    ends: Literal["black", "clear"] = "black"
    """What the end faces of layers are."""
    wall: Annotated[Number, Field(ge=0)] = WALL
    """Part of the rim that stays free of layers, mm."""
    min_transmission: Annotated[Number, Field(ge=0, lt=1)] = LEAST_TRANSMISSION
    """Least part of the light that must come through all surfaces."""
    layers: Annotated[list[LayerTable], Field(min_length=1, max_length=MOST_LAYERS)]
    """From the camera's side to the membrane."""

    def made(self) -> PadLayers:
        """The layers."""
        columns = {
            name: np.array([getattr(layer, name) for layer in self.layers])
            for name in LayerTable.model_fields
        }
        more = {"wall": self.wall, "transmission": self.min_transmission, "ends": self.ends}
        return PadLayers(**columns, **more)


class MirrorTable(Spec):
    """``[[mirrors]]``; see `FingerMirror`."""

    phalanx: Phalanx
    """The phalanx that carries it."""
    start: Point = Field(alias="from")
    """First end: along from the phalanx's own axis, below the dorsal face, mm."""
    end: Point = Field(alias="to")
    """Second end, likewise, mm."""
    mount: Annotated[Number, Field(ge=0)] = MOUNT
    """Thickness of its glass and backing, mm."""


class FingerFile(Spec):
    """The whole file of a finger with a six-bar, or without a linkage."""

    finger: FingerTable
    """What the whole is called."""
    body: BodyTable
    """The three phalanges."""
    pins: PinsTable | None = None
    """Pins of the straight finger, PIP axis at the origin, x to the tip, y to the back."""
    spring: SpringTable | None = None
    """Spring and servo."""
    links: LinksTable | None = None
    """Widths and layers of the links."""
    motor: MotorTable | None = None
    """The motor's place."""
    camera: CameraTable | None = None
    """The camera."""
    pads: PadsTable | None = None
    """Clear layers on all pads."""
    mirrors: tuple[MirrorTable, ...] = ()
    """Mirrors."""


class CoupledFingerFile(FingerFile):
    """That of a coupled finger."""

    pins: CouplingPinsTable | None = None  # pyright: ignore[reportIncompatibleVariableOverride]
    """Pins of the one bar of a coupled finger."""


FILES = {"six-bar": FingerFile, "coupled": CoupledFingerFile}
"""Files by the kind of linkage."""


def read_finger(path: str | Path) -> Finger:
    """The finger that a file describes, or the folder ``specs`` of a result of ``run finger``.

    Args:
        path: the file or the folder.

    Raises:
        UserError: it cannot be read, or contradicts itself; one line names where and the cure.

    Example:
        >>> from importlib.resources import files
        >>> finger = read_finger(files("studies") / "models/finger.toml")
        >>> [mirror.phalanx for mirror in finger.mirrors]
        ['distal', 'proximal']
    """
    path = Path(path)
    if os.path.isdir(path):
        file = path / "finger.toml"
        return read_finger(file) if file.exists() else _from_specs(path)
    tables = read_tables(path, "finger", "finger")
    return parse_finger(tables, str(path), printable(path.stem))


def packaged_finger() -> Finger:
    """The finger that ``designopt run finger`` designs with its default settings.

    Example:
        >>> float(packaged_finger().body.thickness)
        25.0
    """
    with as_file(files("studies.models") / "finger.toml") as path:
        return read_finger(path)


def bare_finger() -> Finger:
    """The finger of published numbers: bare pads and a lens that is not sold, 160° in the section.

    ``designopt run finger`` designed it before its pads had layers. Studies that lay their own
    layers on the pads or take their own lenses rest on it.

    Example:
        >>> bare_finger().layers is None
        True
    """
    with as_file(files("studies.models") / "bare_finger.toml") as path:
        return read_finger(path)


def packaged_or_designed(
    spec: Spec, deciding: set[str], design: Callable[[Context], Finger]
) -> Finger:
    """The packaged finger where the deciding settings are the defaults, otherwise a designed one.

    Args:
        spec: a study's settings.
        deciding: names of those on which the design depends.
        design: designs the finger, with the seed that ``designopt run`` has by default.
    """
    if spec.model_dump(include=deciding) == type(spec)().model_dump(include=deciding):
        return packaged_finger()
    with step_display() as step:
        return design(Context(0, "float64", step, step.count))


def parse_finger(tables: dict[str, Any], source: str, name: str = "finger") -> Finger:
    """The finger that the tables of a file describe.

    Args:
        tables: as `tomllib` gives them.
        source: where they come from, for messages.
        name: of the finger, unless the tables give one.

    Raises:
        UserError: there are unknown, missing or impossible entries; all of these at once.

    Example:
        >>> import tomllib
        >>> parse_finger(tomllib.loads(format_finger(packaged_finger())), "copy").name
        'finger'
    """
    kind = _kind(tables)
    file = validated(FILES[kind], tables, source)
    pins, spring, camera = file.pins, file.spring, file.camera
    return Finger.of(
        Body.of(file.body),
        pins and PINS[kind].of(pins),
        spring and FingerSpring(**spring.model_dump()),
        camera and FingerCamera.of(camera, camera.along, camera.depth, camera.tilt_deg),
        [
            FingerMirror(np.array([part.start, part.end]), part.phalanx, part.mount)
            for part in file.mirrors
        ],
        file.links and Links.of(file.links),
        file.motor and FingerMotor(**file.motor.model_dump()),
        file.pads and file.pads.made(),
        name=file.finger.name or name,
    )


def _kind(tables: dict[str, Any]) -> KindName:
    """The kind of linkage in a file, by the names of its pins."""
    pins = tables.get("pins")
    given = isinstance(pins, dict) and {*pins} & {*COUPLED.pins}
    return COUPLED.name if given else SIX_BAR.name


def finger_tables(finger: Finger) -> dict[str, Any]:
    """The tables of a finger's file; `parse_finger` makes the same finger of them."""
    head = {"name": finger.name, "format": FORMAT}
    tables: dict[str, Any] = {"finger": head, "body": _body(finger.body)}
    if finger.pins is not None:
        places = {pin: np.asarray(getattr(finger.pins, pin)) for pin in finger.pins.names}
        tables["pins"] = {pin_name(pin): place.tolist() for pin, place in places.items()}
    if finger.spring is not None:
        spring = finger.spring
        tables["spring"] = {one.name: float(getattr(spring, one.name)) for one in fields(spring)}
    if finger.links is not None:
        tables["links"] = _links(finger.links)
    if finger.motor is not None:
        motor = finger.motor
        tables["motor"] = {one.name: float(getattr(motor, one.name)) for one in fields(motor)}
    if finger.camera is not None:
        tables["camera"] = _camera(finger.camera, finger.body)
    if finger.layers is not None:
        tables["pads"] = _pads(finger.layers)
    if finger.mirrors:
        tables["mirrors"] = []
        for mirror in finger.mirrors:
            start, end = np.asarray(mirror.ends).tolist()
            place = {"phalanx": mirror.phalanx, "from": start, "to": end}
            tables["mirrors"].append(place | {"mount": float(mirror.mount)})
    return tables


def _body(body: Body) -> dict[str, Any]:
    """``[body]``, without what it has by default."""
    apart = ("flexion", "dip_flexion", "protrusion", "pad_clearance")
    table: dict[str, Any] = {
        one.name: float(getattr(body, one.name)) for one in fields(body) if one.name not in apart
    }
    pip, dip = body.ranges_deg
    table["range_deg"] = pip if body.dip_flexion is None else [pip, dip]
    more = {name: float(getattr(body, name)) for name in apart[2:]}
    return table | {name: value for name, value in more.items() if value}


def _camera(camera: FingerCamera, body: Body) -> dict[str, Any]:
    """``[camera]``; of the lens no key that it has by default, and so of the phalanx."""
    optics = camera_table(camera.at(body))
    bare = {key: value for key, value in optics.items() if key not in FOREIGN}
    if bare["projection"] == "equidistant" and camera.sensor is None:
        del bare["projection"]
    host = {} if camera.phalanx == "intermediate" else {"phalanx": camera.phalanx}
    places = {"along": float(camera.along), "depth": float(camera.depth)}
    own = {"tilt_deg": degrees_of(float(camera.tilt))}
    box = {"width": float(camera.width), "back": float(camera.back)}
    grazing = {"min_grazing_deg": degrees_of(float(camera.grazing))}
    return host | places | own | bare | box | grazing


def _pads(layers: PadLayers) -> dict[str, Any]:
    """``[pads]``."""
    names = LayerTable.model_fields
    columns = zip(*(np.asarray(getattr(layers, name)).tolist() for name in names), strict=True)
    return {
        "ends": layers.ends,
        "wall": float(layers.wall),
        "min_transmission": float(layers.transmission),
        "layers": [dict(zip(names, column, strict=True)) for column in columns],
    }


def _links(links: Links) -> dict[str, Any]:
    """``[links]``."""
    apart = ("thickness", "layers")
    numbers = {
        one.name: float(getattr(links, one.name)) for one in fields(links) if one.name not in apart
    }
    thickness = np.asarray(links.thickness).tolist()
    return numbers | {"thickness": thickness, "layers": [list(parts) for parts in links.layers]}


def format_finger(finger: Finger) -> str:
    """The text of a finger's file; `read_finger` reads the same back.

    Example:
        >>> "[body]" in format_finger(packaged_finger()).splitlines()
        True
    """
    return format_toml(
        finger_tables(finger),
        "A finger: lengths in mm; pins in the straight finger, PIP axis at the origin, x to the\n"
        "tip, y to the back. depth: below the dorsal face; mirrors: [along from its axis, depth].",
    )


def write_finger(finger: Finger, path: str | Path) -> None:
    """Write a finger's file; an existing one is replaced when the new one is complete.

    Args:
        finger: a single one.
        path: of the file.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_finger(packaged_finger(), f"{folder}/finger.toml")
        ...     copy = read_finger(f"{folder}/finger.toml")
        >>> float(copy.body.thickness)
        25.0
    """
    with replaced_when_complete(Path(path)) as partial:
        partial.write_text(format_finger(finger), encoding="utf-8")


def _from_specs(folder: Path) -> Finger:
    """The finger of an earlier result, from its linkage and its scene."""
    linkage = DesignedLinkage.read(folder / "linkage.toml")
    scene = DesignedScene.read(folder / "scene.toml")
    joints, camera = linkage.sketch.joints, scene.file.camera
    try:
        pins = {pin: joints[pin_name(pin)] for pin in "FEDCGH"}
        (root, _), (middle, _), (tip, _) = (joints[name] for name in "OBT")
        pads = {pad.name: pad for pad in scene.file.pads}
        blockers = {part.name: part for part in scene.file.blockers}
        palmar = pads["proximal"].start[1]
        dorsal = blockers["intermediate shell"].start[1]
        rear = pads["proximal"].start[0]
        body_ends = np.array([blockers["camera body"].start, blockers["camera body"].end])
    except KeyError as error:
        raise UserError(
            f"{folder}: it lacks {error.args[0]!r}, so that it is no finger; name the folder "
            "'specs' of a result of 'designopt run finger'"
        ) from error
    settings = _settings_beside(folder)
    axes = {"proximal": 0.0, "distal": middle}
    range_deg = settings.get("body", {}).get("range_deg", 90.0)
    # The pads stand where they are; what that leaves between them follows.
    half, gap = math.radians(range_deg) / 2, -pads["proximal"].end[0]
    between = 2 * (gap * math.cos(half) + palmar * math.sin(half))

    def mirror(phalanx: str, *ends: tuple[float, float]) -> dict[str, Any]:
        start, end = ([x - axes[phalanx], dorsal - y] for x, y in ends)
        return {"phalanx": phalanx, "from": start, "to": end}

    tables: dict[str, Any] = {
        "finger": {"name": scene.name},
        "body": {
            "proximal": -root,
            "intermediate": middle,
            "distal": tip - middle,
            "thickness": dorsal - palmar,
            "axis_height": -palmar,
            "range_deg": range_deg,
            "pad_clearance": 0.0 if abs(between) < SAME else between,
            "rim": rear - root,
        },
        "pins": {pin_name(pin): place for pin, place in pins.items()},
        "camera": {
            "along": camera.position[0],
            "depth": dorsal - camera.position[1],
            "tilt_deg": camera.direction_deg + 90.0,
            "fov_deg": camera.section_fov_deg,
            "pixels": camera.section_pixels,
            "width": float(np.hypot(*(body_ends[1] - body_ends[0]))),
            "min_grazing_deg": pads["proximal"].min_grazing_deg,
        },
        "mirrors": [mirror(part.name, part.start, part.end) for part in scene.file.mirrors],
    }
    if "spring" in settings:
        names = SpringTable.model_fields
        tables["spring"] = {k: v for k, v in settings["spring"].items() if k in names}
    finger = parse_finger(tables, str(folder))
    _check_agreement(folder, finger, linkage, scene)
    return finger


def _settings_beside(folder: Path) -> dict[str, Any]:
    """The settings of the result that a folder ``specs`` belongs to; empty without it."""
    try:
        document = json.loads((folder.parent / "results.json").read_text(encoding="utf-8"))
        return {name: part for name, part in document["spec"].items() if isinstance(part, dict)}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def _check_agreement(
    folder: Path, finger: Finger, linkage: DesignedLinkage, scene: DesignedScene
) -> None:
    """Refuse files of which some number contradicts the others."""
    for name, made, read in (
        ("scene.toml", finger.scene(), scene.scene),
        ("linkage.toml", finger.linkage(), linkage.linkage),
    ):
        wanted = jax.tree.leaves_with_path(made)
        for (place, one), other in zip(wanted, jax.tree.leaves(read), strict=True):
            off = np.max(np.abs(np.asarray(one) - np.asarray(other)), initial=0.0)
            if off > SAME:
                part = jax.tree_util.keystr(place)[1:]
                raise UserError(
                    f"{folder / name}: {part} differs by {off:.3g} from what body, pins, camera "
                    "and mirrors of the other entries give; make them agree, or write the finger "
                    "anew"
                )
