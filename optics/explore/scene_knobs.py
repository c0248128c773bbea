"""The numbers of a scene that a person turns, and the scene as it stands then."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.explore.bench import Knob, Values
from designopt.io.toml_writing import format_toml
from optics.scene.designed import DesignedScene
from optics.scene.fabrication import turned
from optics.scene.file import NARROW
from optics.scene.reading import parse_scene
from optics.scene.scene import Scene
from optics.scene.writer import scene_tables

CAMERA_BODY = "camera body"
"""A blocker of this name in the camera's frame is the camera's own: it moves and turns with it."""

MOST = 18
"""Most knobs of dimensions."""

JOINT = (0.0, 90.0)
"""Range of a joint angle, degrees."""

TILT = 30.0
"""How far the camera is turned either way, degrees; not beyond the edge of what it sees."""

REACH = 0.09
"""How far places are moved either way, as a part of the larger side of the scene's surfaces."""

NARROWER, WIDER = 0.5, 1.5
"""Range of field of view and radii, as parts of themselves."""

SHORT = 10.0
"""Largest fields of view end so much before what a projection never reaches, degrees."""


class Dimensions(eqx.Module):
    """What of a scene the knobs turn.

    Attributes:
        position: of the camera, mm.
        direction: of the optical axis, rad.
        field_of_view: rad.
        mirrors: ends of all mirrors, mm.
        radii: of the curved ones, mm.
    """

    position: Float[Array | np.ndarray, "*batch 2"]
    direction: Float[Array | np.ndarray, "*batch"]
    field_of_view: Float[Array | np.ndarray, "*batch"]
    mirrors: Float[Array | np.ndarray, "*batch mirrors 2 2"]
    radii: Float[Array | np.ndarray, "*batch curved"]


def apply_parameters(scene: Scene, dimensions: Dimensions) -> Scene:
    """A scene with other dimensions; traced by JAX. See `CAMERA_BODY`."""
    camera, layout = scene.camera, scene.layout
    own = np.array([_is_body(part.name, part.frame, layout) for part in layout.blockers], bool)
    turn = jnp.broadcast_to(dimensions.direction - camera.direction, own.shape)
    arms = turned(scene.blockers - camera.position[None, None], turn)
    moved = arms + jnp.asarray(dimensions.position)[None, None]
    return eqx.tree_at(
        lambda scene: (
            scene.camera.position,
            scene.camera.direction,
            scene.camera.field_of_view,
            scene.mirrors,
            scene.radii,
            scene.blockers,
        ),
        scene,
        (
            dimensions.position,
            dimensions.direction,
            dimensions.field_of_view,
            dimensions.mirrors,
            dimensions.radii,
            jnp.where(own[:, None, None], moved, scene.blockers),
        ),
    )


def _is_body(name: str, frame: int, layout: Any) -> bool:
    return name == CAMERA_BODY and frame == layout.camera_frame


_arranged = jax.jit(apply_parameters)


@dataclass(frozen=True)
class Handle:
    """A knob of a dimension, and where its number stands.

    Attributes:
        knob: the knob.
        field: of `Dimensions`.
        place: in that field's array.
        zero: the file's number where the knob stands at 0.
    """

    knob: Knob
    field: str
    place: tuple[int, ...] = ()
    zero: float = 0.0

    @property
    def unit(self) -> float:
        """Of the field, for one unit of the knob."""
        return math.radians(1.0) if self.knob.unit == "°" else 1.0


@dataclass(frozen=True)
class ParameterMap:
    """All knobs of a scene.

    Attributes:
        design: the scene.
        joints: of the joint angles, in the order of ``Scene.angle_names``.
        handles: of the dimensions.
    """

    design: DesignedScene
    joints: tuple[Knob, ...]
    handles: tuple[Handle, ...]

    @classmethod
    def of(
        cls,
        design: DesignedScene,
        joint: tuple[float, float] = JOINT,
        most: int = MOST,
        straight_deg: float | None = None,
    ) -> ParameterMap:
        """The knobs of a scene.

        Args:
            design: the scene.
            joint: range of every joint angle, degrees; it holds 0.
            most: most knobs of dimensions; mirrors that come late have none.
            straight_deg: direction of a camera that is not tilted; the one in the file by default.
        """
        names = design.scene.angle_names
        joints = tuple(Knob(name, 0.0, *joint, "°", "joint") for name in names)
        handles = _of_camera(design, straight_deg)
        for index in range(len(design.scene.layout.mirrors)):
            more = _of_mirror(design, index)
            if len(handles) + len(more) > most:
                break
            handles += more
        return cls(design, joints, tuple(handles))

    @property
    def knobs(self) -> tuple[Knob, ...]:
        """Joint angles first."""
        return (*self.joints, *(handle.knob for handle in self.handles))

    def angles(self, values: Values) -> Float[np.ndarray, " joints"]:
        """Joint angles, rad."""
        return np.radians(np.array([values[knob.name] for knob in self.joints], float))

    def dimensions(self, values: Values) -> Dimensions:
        """The dimensions as they stand; those without a knob as they are in the file."""
        return self.many([values], with_one_axis=False)

    def many(self, states: Sequence[Values], *, with_one_axis: bool = True) -> Dimensions:
        """The dimensions of several states, along a first axis."""
        scene = self.design.scene
        fields = {
            "position": scene.camera.position,
            "direction": scene.camera.direction,
            "field_of_view": scene.camera.field_of_view,
            "mirrors": scene.mirrors,
            "radii": scene.radii,
        }
        arrays = {
            name: np.array(np.broadcast_to(leaf, (len(states), *leaf.shape)))
            for name, leaf in fields.items()
        }
        for handle in self.handles:
            numbers = [(values[handle.knob.name] + handle.zero) * handle.unit for values in states]
            arrays[handle.field][(slice(None), *handle.place)] = numbers
        if with_one_axis:
            return Dimensions(**arrays)
        return Dimensions(**{name: np.asarray(leaf[0]) for name, leaf in arrays.items()})

    def scene(self, values: Values) -> Scene:
        """The scene as it stands."""
        return _arranged(self.design.scene, self.dimensions(values))

    def values(self, values: Values, dimensions: Dimensions) -> dict[str, float]:
        """Values with those of dimensions, inside their knobs' ranges to rounding."""
        found = dict(values)
        for handle in self.handles:
            number = float(getattr(dimensions, handle.field)[handle.place]) / handle.unit
            number -= handle.zero
            found[handle.knob.name] = min(max(number, handle.knob.low), handle.knob.high)
        return found

    def tables(self, values: Values) -> dict[str, Any]:
        """The tables of the scene file as it stands.

        Raises:
            UserError: these values describe no scene, and why.
        """
        tables = scene_tables(self.scene(values))
        lens = self.design.file.camera.lens
        if lens is not None:
            # No knob turns it, and of the scene its numbers would come back with rounding.
            tables["camera"]["lens"] = lens.model_dump(exclude_none=True)
        parse_scene(tables, self.design.name)
        return tables

    def text(self, values: Values) -> str:
        """The scene file as it stands.

        Raises:
            UserError: these values describe no scene, and why.
        """
        pose = ",".join(f"{knob.name}={values[knob.name]:.10g}" for knob in self.joints)
        posed = f"; in the picture it had --pose {pose}" if pose else ""
        return format_toml(self.tables(values), f"{self.design.name} as explored{posed}")


def _of_camera(design: DesignedScene, straight_deg: float | None) -> list[Handle]:
    file, reach = design.file.camera, _reach(design)
    projection, field = file.section_projection, file.section_fov_deg
    widest = NARROW[projection] - SHORT if projection in NARROW else 360.0
    straight = straight_deg
    straight = file.direction_deg if straight is None else straight
    tilt = file.direction_deg - straight
    turn = min(TILT, field / 2)
    tilted = Knob("camera tilt", tilt, tilt - turn, tilt + turn, "°", "dimension")
    seen = Knob(
        "field of view",
        field,
        NARROWER * field,
        max(min(WIDER * field, widest), field),
        "°",
        "dimension",
    )
    places = [
        Handle(_around(f"camera {axis}", file.position[at], reach), "position", (at,))
        for at, axis in enumerate("xy")
    ]
    return [
        Handle(tilted, "direction", zero=straight),
        *places,
        # A lens that is sold has the field of view that it has.
        *([Handle(seen, "field_of_view")] if file.format is None else []),
    ]


def _of_mirror(design: DesignedScene, index: int) -> list[Handle]:
    table, reach, curved = design.file.mirrors[index], _reach(design), design.scene.layout.curved
    names = [part.name for part in design.file.mirrors]
    told = any("mirror" in name.lower() for name in names)
    name = table.name if told else f"{table.name} mirror"
    handles = [
        Handle(
            _around(f"{name}: {end} {axis}", place[at], reach),
            "mirrors",
            (index, which, at),
        )
        for which, (end, place) in enumerate((("from", table.start), ("to", table.end)))
        for at, axis in enumerate("xy")
    ]
    if table.radius is not None:
        low, high = sorted((NARROWER * table.radius, WIDER * table.radius))
        radius = Knob(f"{name}: radius", table.radius, low, high, "mm", "dimension")
        handles.append(Handle(radius, "radii", (curved.index(index),)))
    return handles


def _around(name: str, value: float, reach: float) -> Knob:
    return Knob(name, value, value - reach, value + reach, "mm", "dimension")


def _reach(design: DesignedScene) -> float:
    """How far places are moved, mm: a round number."""
    scene = design.scene
    ends = np.concatenate([np.asarray(s) for s in (scene.mirrors, scene.pads, scene.blockers)])
    return float(f"{REACH * float(np.max(np.ptp(ends.reshape(-1, 2), axis=0))):.0e}")
