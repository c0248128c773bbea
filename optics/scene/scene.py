"""An optical scene in the section as a pytree, and its surfaces placed in a pose."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from designopt.vectors import Vector, rotation, stack, vector
from optics.scene.camera import Camera
from optics.scene.layers import (
    BodyFace,
    LayerKinds,
    Layers,
    MirrorLayers,
    Profile,
    along_and_normal,
    body_faces,
    profile_faces,
)

WORLD = -1
"""Index of the frame that does not move."""

Kind = Literal["mirror", "pad", "blocker", "layer"]


@dataclass(frozen=True)
class Surface:
    """What is static of a mirror, pad or blocker.

    Attributes:
        name: its name, unique among those of its kind.
        side: +1 if its left side (seen from its first end to its second) reflects, senses or
            blocks, −1 if its right does, 0 if both do.
        frame: index of the frame it moves with, or `WORLD`.
    """

    name: str
    side: int
    frame: int = WORLD


@dataclass(frozen=True)
class Frame:
    """What is static of a moving frame.

    Attributes:
        name: its name.
        parent: index of the frame it is hinged in, or `WORLD`; parents come before children.
        angle: index of its joint angle.
        sign: +1 if that angle is counted counter-clockwise, −1 if clockwise.
    """

    name: str
    parent: int
    angle: int
    sign: int


class Solids(NamedTuple):
    """Surfaces by the solids that they bound.

    Attributes:
        alone: those that stand alone.
        together: those that bound a convex solid together, a row for each: a layer, or a part of a
            bezel. Short rows repeat their last member.
    """

    alone: tuple[int, ...]
    together: tuple[tuple[int, ...], ...]

    @property
    def order(self) -> Int[np.ndarray, " order"]:
        """All surfaces in one row, those that stand alone first; some more than once."""
        return np.array([*self.alone, *itertools.chain(*self.together)], int)

    @property
    def size(self) -> int:
        """How many solids there are, with the surfaces that stand alone."""
        return len(self.alone) + len(self.together)

    def arranged(self, of_surfaces: Any) -> Any:
        """What belongs to all surfaces along a first axis, in this order."""
        if not self.together:
            return of_surfaces
        return jax.tree.map(lambda leaf: leaf[self.order], of_surfaces)

    def place(self, surface: Int[Array, "..."]) -> Int[Array, "..."]:
        """The first place of a surface in this order."""
        if not self.together:
            return surface
        return jnp.asarray(np.unique(self.order, return_index=True)[1])[surface]


@dataclass(frozen=True)
class Layout:
    """Everything structural of a scene.

    Attributes:
        name: the scene's name.
        mirrors: straight and curved ones, in order.
        curved: which of the mirrors are curved.
        pads: in order.
        blockers: in order.
        frames: the moving frames, parents before children.
        angles: names of the joint angles, in the order of their values.
        camera_frame: index of the frame that the camera moves with, or `WORLD`.
        bounces: how many reflections a view may have, unless a call states another number.
        layers: of every pad, what the faces of its layers are, the outermost first; empty if no pad
            has layers.
        bezels: which of the pads have a bezel.
        module: lines of the camera's module, which hide what is behind them.
        sheets: how many layers each mirror has, whose line is then the outermost surface; empty if
            none has any.
    """

    name: str
    mirrors: tuple[Surface, ...]
    curved: tuple[int, ...]
    pads: tuple[Surface, ...]
    blockers: tuple[Surface, ...]
    frames: tuple[Frame, ...]
    angles: tuple[str, ...]
    camera_frame: int
    bounces: int
    layers: tuple[tuple[LayerKinds, ...], ...] = ()
    bezels: tuple[bool, ...] = ()
    module: tuple[Surface, ...] = ()
    sheets: tuple[int, ...] = ()

    @cached_property
    def bodies(self) -> tuple[BodyFace, ...]:
        """Faces of the layers' bodies besides their outermost surfaces, pad by pad."""
        return tuple(
            face
            for pad, kinds in enumerate(self.layers)
            for face in body_faces(pad, kinds, self.bezels[pad])
        )

    @cached_property
    def sheet_ends(self) -> tuple[Surface, ...]:
        """Black ends of the layers on mirrors, at the first and the second end of each."""
        return tuple(
            Surface(f"{mirror.name}, ends of layers at {at}", 0, mirror.frame)
            for mirror, count in zip(self.mirrors, self.sheets, strict=bool(self.sheets))
            if count
            for at in ("from", "to")
        )

    @cached_property
    def surfaces(self) -> tuple[Surface, ...]:
        """All surfaces, in their order.

        Mirrors, pads, blockers, the camera's module, ends of the layers on mirrors, and faces of
        the layers' bodies. That of a layered pad is the outermost surface of its layers.
        """
        bodies = (
            Surface(f"{pad.name}: {face.name}", 0, pad.frame)
            for face in self.bodies
            for pad in [self.pads[face.pad]]
        )
        dark = (*self.blockers, *self.module, *self.sheet_ends)
        return (*self.mirrors, *self.pads, *dark, *bodies)

    @cached_property
    def behind_face(self) -> np.ndarray:
        """Of every surface, the pad whose outermost surface it is or lies behind, or −1."""
        others = [-1] * len(self.blockers + self.module + self.sheet_ends)
        bodies = [-1 if face.part in ("rim", "lip") else face.pad for face in self.bodies]
        return np.array([*[-1] * len(self.mirrors), *range(len(self.pads)), *others, *bodies], int)

    @cached_property
    def solids(self) -> Solids:
        """All surfaces by the solids that they bound; all stand alone if no pad has layers."""
        first = len(self.surfaces) - len(self.bodies)
        of_solid: dict[tuple[int, int, int | None], list[int]] = {}
        for i, face in enumerate(self.bodies, first):
            bezel = face.end if face.part in ("rim", "lip") else None
            of_solid.setdefault((face.pad, face.layer, bezel), []).append(i)
        for (pad, layer, bezel), members in of_solid.items():
            if layer == 0 and bezel is None:
                members.insert(0, len(self.mirrors) + pad)
        within = {i for members in of_solid.values() for i in members}
        alone = [i for i in range(len(self.surfaces)) if i not in within]
        most = max(map(len, of_solid.values()), default=0)
        rows = [(*own, *[own[-1]] * (most - len(own))) for own in of_solid.values()]
        return Solids(tuple(alone), tuple(rows))

    @property
    def sides(self) -> np.ndarray:
        """The side of every surface, in the order of `surfaces`."""
        return np.array([part.side for part in self.surfaces], int)

    @property
    def one_way(self) -> np.ndarray:
        """Which surfaces let rays pass from one side: one-sided blockers, not mirrors and pads."""
        behind = len(self.mirrors) + len(self.pads)
        return (np.arange(len(self.sides)) >= behind) & (self.sides != 0)

    def kind(self, surface: int) -> Kind:
        """What a surface is, by its index in `surfaces`."""
        kinds: tuple[Kind, ...] = ("mirror", "pad", "blocker", "layer")
        dark = self.blockers + self.module + self.sheet_ends
        ends = np.cumsum([len(self.mirrors), len(self.pads), len(dark)])
        return kinds[int(np.searchsorted(ends, surface, side="right"))]

    def title(self, surface: int) -> str:
        """A surface in words, such as ``mirror 'lid'`` or ``pad 'tip', layer 1 at 'to'``."""
        if self.kind(surface) != "layer":
            return f"{self.kind(surface)} '{self.surfaces[surface].name}'"
        face = self.bodies[surface - len(self.surfaces)]
        return f"pad '{self.pads[face.pad].name}', {face.name}"


class Scene(eqx.Module):
    """Camera, mirrors, pads and blockers. Read one from a file with `read_scene`.

    Dimensions are array leaves, so `jax.grad` and `jax.vmap` apply to the scene itself. All
    coordinates are those of the reference pose, in which every joint angle is 0.

    Attributes:
        camera: the camera.
        mirrors: first and second end of every mirror, mm.
        radii: of the curved mirrors, mm; positive if the centre lies to the left. With the conic
            constant k, (1 + k) (chord / 2)² < radius², or there is no such arc.
        conics: of the curved mirrors: 0 for a circle, −1 for a parabola.
        pads: ends of the pads, mm.
        grazing: least angle between a pad and a ray that shows it, rad, one per pad.
        blockers: ends of the blockers, mm.
        hinges: of the frames, mm.
        layout: names, sides, frames: everything structural.
        layers: of the pads; ``None`` if no pad has layers.
        widths: of the pads across the section, mm; NaN where a file states none.
        mirror_layers: layers on flat mirrors, whose ends are then those of the coat behind them;
            ``None`` if no mirror has layers.
    """

    camera: Camera
    mirrors: Float[Array, "mirrors 2 2"]
    radii: Float[Array, " curved"]
    conics: Float[Array, " curved"]
    pads: Float[Array, "pads 2 2"]
    grazing: Float[Array, " pads"]
    blockers: Float[Array, "blockers 2 2"]
    hinges: Float[Array, "frames 2"]
    layout: Layout = eqx.field(static=True)
    layers: Layers | None = None
    widths: Float[Array, " pads"] | None = None
    mirror_layers: MirrorLayers | None = None

    @property
    def surface_ends(self) -> Float[Array, "surfaces 2 2"]:
        """Ends of all surfaces, mm, in the order of ``layout.surfaces``."""
        camera, ends = self.camera, [self.mirrors, self.pads, self.blockers]
        if camera.module is not None:
            ends.append(camera.module.outline(camera.position, camera.direction))
        return jnp.concatenate(ends)

    @property
    def own_layers(self) -> Layers | None:
        """The layers that pads have: `layers` with nothing in the place of others."""
        layers, layout = self.layers, self.layout
        return None if layers is None else layers.own(layout.layers, layout.bezels)

    @property
    def own_mirror_layers(self) -> MirrorLayers | None:
        """The layers that mirrors have, likewise."""
        layers = self.mirror_layers
        return None if layers is None else layers.own(self.layout.sheets)

    @property
    def rays_slide(self) -> bool:
        """Whether rays come from other places than the camera's position or its images."""
        return self.camera.pupil_shift is not None or self.mirror_layers is not None

    @property
    def angle_names(self) -> tuple[str, ...]:
        """Names of the joint angles, in the order in which their values are given."""
        return self.layout.angles

    def pose(self, angles: Mapping[str, float] | None = None) -> Float[Array, " joints"]:
        """Joint angles as an array, from their names, rad; those not named are 0.

        Raises:
            KeyError: the scene has no joint angle of a name.
        """
        given = dict(angles or {})
        values = [given.pop(name, 0.0) for name in self.angle_names]
        if given:
            known = ", ".join(self.angle_names) or "none"
            raise KeyError(f"no joint angle is named {', '.join(given)}; there are: {known}")
        return jnp.asarray(values, self.mirrors.dtype)


class Placed(eqx.Module):
    """A scene in one pose, relative to `origin` and in units of `size`.

    So no result depends on where the scene lies or on its unit of length.

    Attributes:
        camera: position of the camera.
        axis: unit vector of the optical axis.
        corners: first and second ends of all surfaces, in the order of `Layout.surfaces`.
        radii: of the curved mirrors.
        hinges: of the frames.
        origin: what has been subtracted, mm: the camera's position in the reference pose.
        size: what has been divided by, mm; it has no derivative.
        pupil: of a camera whose entrance pupil moves, e₂ and e₄, in units of ``size``, and half the
            field of view, rad.
        sheets: layers on mirrors, whose corners are then those of the outermost surfaces.
    """

    camera: Vector
    axis: Vector
    corners: Vector
    radii: Float[Array, " curved"]
    hinges: Vector
    origin: Vector
    size: Float[Array, ""]
    pupil: tuple[Float[Array, "2"], Float[Array, ""]] | None = None
    sheets: MirrorLayers | None = None

    @property
    def starts(self) -> Vector:
        """First ends of all surfaces."""
        return self.corners[..., 0]

    @property
    def ends(self) -> Vector:
        """Second ends of all surfaces."""
        return self.corners[..., 1]

    def segment(self, surface: Int[ArrayLike, "*surfaces"]) -> tuple[Vector, Vector]:
        """Both ends of a surface, or of several, by index."""
        corners = self.corners[surface]
        return corners[..., 0], corners[..., 1]

    def absolute(self, place: Vector) -> Vector:
        """Coordinates in mm of a place that is relative to the placed scene."""
        return Vector(place.x * self.size + self.origin.x, place.y * self.size + self.origin.y)


def place(scene: Scene, angles: Float[Array, " joints"]) -> Placed:
    """All surfaces and the camera of a scene in a pose.

    Args:
        scene: the scene.
        angles: joint angles in the order of ``scene.angle_names``, rad.
    """
    layout, origin = scene.layout, vector(scene.camera.position)
    corners = vector(scene.surface_ends) - origin
    if (sheets := scene.own_mirror_layers) is not None:
        corners = _with_sheets(layout, sheets, corners)
    if (layers := scene.own_layers) is not None:
        corners = _with_bodies(scene, layers, corners)
    hinges = vector(scene.hinges) - origin
    size = _size(corners, hinges)
    corners, hinges = jax.tree.map(lambda leaf: leaf / size, (corners, hinges))
    zero = jnp.zeros_like(size)
    # Of each frame, parents first: its hinge in the reference pose and now, and how it is turned.
    # The fixed frame comes last, so that its index is `WORLD`.
    still = (Vector(zero, zero), Vector(zero, zero), Vector(jnp.ones_like(size), zero))
    moved: list[tuple[Vector, Vector, Vector]] = []
    signs = jnp.array([frame.sign for frame in layout.frames], size.dtype)
    turns = rotation(signs * angles[np.array([frame.angle for frame in layout.frames], int)])
    for index, frame in enumerate(layout.frames):
        hinge, turn = hinges[index], turns[index]
        if frame.parent == WORLD:
            moved.append((hinge, hinge, turn))
        else:
            parent = moved[frame.parent]
            moved.append((hinge, _moved(parent, hinge), turn.turned(parent[2])))
    moved.append(still)
    # The surfaces frame by frame, and then back in their order.
    frame_of = np.array([part.frame for part in layout.surfaces], int) % len(moved)
    order = np.argsort(frame_of, kind="stable")
    parts = [
        _moved(frame, corners[order[frame_of[order] == index]]) for index, frame in enumerate(moved)
    ]
    joined = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *parts)
    camera, shift = moved[layout.camera_frame], scene.camera.pupil_shift
    if sheets is not None:
        sheets = MirrorLayers(sheets.thickness / size, sheets.index)
    return Placed(
        _moved(camera, still[0]),
        rotation(scene.camera.direction).turned(camera[2]),
        joined[np.argsort(order)],
        scene.radii / size,
        stack(*(now for _, now, _ in moved))[:-1],
        origin,
        size,
        None if shift is None else (shift / size, scene.camera.field_of_view / 2),
        sheets,
    )


def _with_sheets(layout: Layout, sheets: MirrorLayers, corners: Vector) -> Vector:
    """Surfaces with outermost surfaces instead of coats, and with the ends of mirrors' layers."""
    count = len(layout.mirrors)
    coats, sides = corners[:count], jnp.asarray(layout.sides[:count], corners.x.dtype)
    _, normal, _ = along_and_normal(coats, sides)
    fronts = coats + normal.scaled(jnp.sum(sheets.thickness, axis=1))[:, None]
    chosen = np.flatnonzero(layout.sheets)
    ends = stack(coats[chosen], fronts[chosen])  # coat and front, mirrors, both ends
    ends = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1).reshape(-1, 2), ends)
    parts = fronts, corners[count:], ends
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *parts)


def _with_bodies(scene: Scene, layers: Layers, corners: Vector) -> Vector:
    """Surfaces in the reference pose: outermost surfaces instead of membranes, and all bodies."""
    layout, first = scene.layout, len(scene.layout.mirrors)
    pads = slice(first, first + len(layout.pads))
    ends, sides = corners[pads], jnp.asarray(layout.sides[pads], corners.x.dtype)
    along, normal, length = along_and_normal(ends, sides)
    faces = profile_faces(Profile.of(layers, length), layers, layout.bodies)
    pad = np.array([face.pad for face in layout.bodies], int)
    pad = np.concatenate([np.arange(len(layout.pads)), pad])

    def placed(places: Float[Array, "faces 2 2"]) -> Vector:
        columns = (ends[..., 0][pad], along[pad], normal[pad])
        start, along_pad, up = (jax.tree.map(lambda leaf: leaf[:, None], v) for v in columns)
        return start + along_pad.scaled(places[..., 0]) + up.scaled(places[..., 1])

    moved = placed(faces)
    parts = (
        corners[:first],
        moved[: len(layout.pads)],
        corners[pads.stop :],
        moved[len(layout.pads) :],
    )
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *parts)


def _moved(frame: tuple[Vector, Vector, Vector], place: Vector) -> Vector:
    """Where a place of a frame goes: about the hinge, so that it is as exact as its distance."""
    hinge, now, turn = frame
    return now + (place - hinge).turned(turn)


def _size(*places: Vector) -> Float[Array, ""]:
    largest = jnp.max(jnp.abs(jnp.concatenate([jnp.append(p.x, p.y) for p in places])), initial=0.0)
    return jax.lax.stop_gradient(jnp.where(largest > 0, largest, 1.0))
