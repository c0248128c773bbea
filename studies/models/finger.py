"""Paper B's finger as one pytree: every independent dimension is a leaf, all else follows.

Coordinates are those of the straight finger: PIP axis A at the origin, DIP axis B at
(intermediate, 0), x towards the tip, y towards the back of the hand, mm. Flexion is positive and 0
in the straight finger, which is the reference configuration.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, Literal, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt import UserError
from designopt.interpreter import interpret
from kinematics.io.pinned import assembly_signs, pinned_linkage, pinned_tables
from kinematics.model.linkage import Linkage
from kinematics.model.linkage import Spring as LinkageSpring
from kinematics.model.topology import BodyPart, InputPart, Structure
from optics.scene.camera_module import LINES, NAME
from optics.scene.layers import LayerKinds
from optics.scene.scene import WORLD, Frame, Layout, Scene, Surface
from studies.models.finger_parts import (
    PHALANGES,
    SETBACK,
    SIDES,
    Body,
    FingerCamera,
    FingerMirror,
    FingerMotor,
    FingerSpring,
    Number,
    Phalanx,
    mirror_names,
)
from studies.models.link_layers import Links
from studies.models.linkage_kinds import PARALLELOGRAM, LinkageKind
from studies.models.pad_layers import PadLayers
from studies.models.pins import AnyPins, CouplingPins, Pins, pin_name

Drive = Literal["joints", "crank"]
DRIVES: tuple[Drive, Drive] = ("joints", "crank")

Part = TypeVar("Part")
Kind = TypeVar("Kind", Pins, CouplingPins)


class Finger(eqx.Module):
    """A finger: body, linkage, spring, camera, mirrors and the layers on its pads.

    `jax.grad`, `jax.vmap` and `jax.jit` apply to it: hinges, pads, shells and the camera's body are
    computed from its leaves, so thickness and axis height move what they move in the metal. Which
    way the linkage is assembled is static; `Finger.of` takes it from the pins.

    Attributes:
        body: the phalanges.
        pins: of the linkage, whose kind they decide; ``None`` where the finger has none.
        spring: ``None`` where the finger has none.
        camera: ``None`` where the finger sees nothing.
        mirrors: in order; several may be on one phalanx.
        links: widths and layers of the linkage's links; ``None`` where they are lines.
        motor: and the parallelogram through which it turns the crank; ``None`` where the motor
            turns the crank itself.
        name: in titles and file names.
        assembly: one sign per closed-form group of the linkage, driven at its joints and by its
            crank; ``None`` without pins.
        layers: clear layers on the pads; ``None`` where these are bare.
    """

    body: Body
    pins: AnyPins | None
    spring: FingerSpring | None
    camera: FingerCamera | None
    mirrors: tuple[FingerMirror, ...]
    links: Links | None
    motor: FingerMotor | None
    name: str = eqx.field(static=True)
    assembly: tuple[tuple[int, ...], tuple[int, ...]] | None = eqx.field(static=True)
    layers: PadLayers | None = None

    @classmethod
    def of(
        cls,
        body: Body,
        pins: AnyPins | None = None,
        spring: FingerSpring | None = None,
        camera: FingerCamera | None = None,
        mirrors: Sequence[FingerMirror] = (),
        links: Links | None = None,
        motor: FingerMotor | None = None,
        layers: PadLayers | None = None,
        *,
        name: str = "finger",
    ) -> Finger:
        """A finger from its parts; the pins, plain numbers, choose how it is assembled."""
        assembly = None
        if pins is not None and links is not None and pins.kind != links.kind:
            raise UserError(
                f"{name}: [pins] are of a {pins.kind.name} linkage and the layers of [links] of a "
                f"{links.kind.name} one; correct 'layers'"
            )
        if pins is not None and (motor is None) != (pins.K is None):
            raise UserError(
                f"{name}: the motor's parallelogram has pin K on the crank and its axis in "
                "[motor]; give both or neither"
            )
        if pins is not None:
            joints = interpret(_joints, body, pins, motor)
            places = {joint: np.asarray(at, float) for joint, at in joints.items()}
            by_joints, by_crank = (
                assembly_signs(
                    _structure(pins.kind, drive, springs=False, driven=motor is not None), places
                )
                for drive in DRIVES
            )
            assembly = by_joints, by_crank
        return cls(body, pins, spring, camera, tuple(mirrors), links, motor, name, assembly, layers)

    @property
    def mirror_names(self) -> tuple[str, ...]:
        """Names of its mirrors, in their order; see `mirror_names`."""
        return mirror_names([mirror.phalanx for mirror in self.mirrors])

    @property
    def kind(self) -> LinkageKind:
        """The kind of its linkage: that of its links, which are there where pins are looked for.

        Raises:
            UserError: it has neither links nor pins.
        """
        return linkage_pins(self).kind if self.links is None else self.links.kind

    def with_pins(self, pins: AnyPins) -> Finger:
        """The same finger with other pins, plain numbers, assembled as they stand.

        In traced code, ``dataclasses.replace(finger, pins=pins)`` keeps how it is assembled.
        """
        parts = self.spring, self.camera, self.mirrors, self.links, self.motor, self.layers
        return Finger.of(self.body, pins, *parts, name=self.name)

    def linkage(self, drive: Drive = "joints") -> Linkage:
        """The linkage in the frame of the proximal phalanx; flexion is negative there.

        Args:
            drive: inputs are the joints ``pip`` and ``dip``, or ``theta`` of the crank and
                ``gamma`` of the plate relative to the distal phalanx. A coupled finger has the
                first of either alone; its crank is the intermediate phalanx.

        Raises:
            UserError: the finger has no pins.
        """
        structure, joints, springs = self._linkage_parts(drive)
        assert self.assembly is not None  # as it has pins
        return pinned_linkage(structure, joints, self.assembly[DRIVES.index(drive)], springs)

    def linkage_tables(self, drive: Drive = "joints") -> dict[str, Any]:
        """The tables of the linkage's file, with joints where the finger's own file has them.

        Args:
            drive: as in `linkage`.

        Raises:
            UserError: the finger has no pins.
        """
        return pinned_tables(*self._linkage_parts(drive))

    def _linkage_parts(
        self, drive: Drive
    ) -> tuple[Structure, dict[str, Float[Array, "2"]], tuple[LinkageSpring, ...]]:
        pins = linkage_pins(self)
        springs: tuple[LinkageSpring, ...] = ()
        if drive == "crank" and self.spring is not None and pins.kind.springs:
            springs = (LinkageSpring(self.spring.stiffness, self.spring.preload),)
        driven = self.motor is not None
        structure = _structure(pins.kind, drive, springs=bool(springs), driven=driven)
        return structure, _joints(self.body, pins, self.motor), springs

    def joined(self) -> dict[str, list[str]]:
        """The bodies that every pin joins, by its name; H is paper B's G'."""
        structure = _structure(self.kind, "joints", springs=False, driven=self.motor is not None)
        bodies: dict[str, list[str]] = {}
        for part in structure.bodies:
            for joint in part.joints:
                bodies.setdefault("H" if joint == pin_name("H") else joint, []).append(part.name)
        return {joint: names for joint, names in bodies.items() if len(names) > 1}

    def pads(self) -> Float[Array, "3 2 2"]:
        """Ends of the pads of the proximal, intermediate and distal phalanx, mm."""
        body, (pip, dip) = self.body, self.body.gaps
        root, middle, tip = -body.proximal, body.intermediate, body.intermediate + body.distal
        ends = [(root + body.rim, -pip), (pip, middle - dip), (middle + dip, tip - body.rim)]
        low = body.palmar - body.protrusion
        return jnp.stack([_line((one, low), (other, low)) for one, other in ends])

    def camera_body(self) -> Float[Array, "2 2"]:
        """Ends of the opaque line behind the camera in the straight finger, mm.

        Raises:
            UserError: the finger has no camera.
        """
        return self._camera_lines(SETBACK)[0]

    def camera_corners(self) -> Float[Array, "corners 2"]:
        """Corners of the camera's body in the straight finger, mm; see `FingerCamera`.

        Raises:
            UserError: the finger has no camera.
        """
        camera = camera_of(self)
        if camera.module is None:
            return self._camera_lines(SETBACK, camera.back).reshape(-1, 2)
        sold = camera.at(self.body)
        return camera.module.outline(sold.position, sold.direction).reshape(-1, 2)

    def camera_boxes(self) -> Float[Array, "boxes 4 2"]:
        """The same body as convex boxes, each with its corners one after the other, mm.

        Raises:
            UserError: the finger has no camera.
        """
        camera = camera_of(self)
        if camera.module is None:
            front, back = self._camera_lines(SETBACK, camera.back)
            return jnp.concatenate([front, back[::-1]])[None]
        sold = camera.at(self.body)
        lines = camera.module.outline(sold.position, sold.direction)
        sides = jnp.stack([lines[:2], lines[3:5]])
        return jnp.concatenate([sides[:, 0], sides[:, 1, ::-1]], axis=1)

    def _camera_lines(self, *behind: Number | float) -> Float[Array, "lines 2 2"]:
        """Lines across the camera's body so far behind the pinhole, mm."""
        camera = camera_of(self)
        position = camera.at(self.body).position
        sine, cosine = jnp.sin(camera.tilt), jnp.cos(camera.tilt)
        ahead, across = jnp.stack([sine, -cosine]), jnp.stack([cosine, sine])
        half = camera.width / 2 * across
        middles = [position - one * ahead for one in behind]
        return jnp.stack([jnp.stack([middle - half, middle + half]) for middle in middles])

    def scene(self) -> Scene:
        """Camera, mirrors, pads and shells; the intermediate phalanx is the world.

        Blockers are the camera's body (its module's outline, if that is known), shells on the back
        from axis to axis (flexion opens gaps between them, so none swings into the finger) and
        walls at both ends.

        Raises:
            UserError: the finger has no camera.
        """
        body, camera = self.body, camera_of(self)
        middle, palmar, dorsal = body.intermediate, body.palmar, body.dorsal
        tip, root = middle + body.distal, -body.proximal
        zero = jnp.zeros_like(middle)
        blockers = [
            *([self.camera_body()] if camera.module is None else []),
            _line((root, dorsal), (zero, dorsal)),
            _line((zero, dorsal), (middle, dorsal)),
            _line((middle, dorsal), (tip, dorsal)),
            _line((root, palmar), (root, dorsal)),
            _line((tip, palmar), (tip, dorsal)),
        ]
        none = jnp.zeros((0,), zero.dtype)
        mirrors = [body.place(part.phalanx, part.ends) for part in self.mirrors]
        layers, kinds = self.layers, ()
        if layers is not None:
            kinds = layers.kinds(len(PHALANGES))
        return Scene(
            camera=camera.at(body),
            mirrors=jnp.stack(mirrors) if mirrors else jnp.zeros((0, 2, 2), zero.dtype),
            radii=none,
            conics=none,
            pads=self.pads(),
            grazing=jnp.broadcast_to(camera.grazing, (3,)),
            blockers=jnp.stack(blockers),
            hinges=jnp.stack([jnp.stack([zero, zero]), jnp.stack([middle, zero])]),
            layout=_layout(
                self.name,
                tuple(part.phalanx for part in self.mirrors),
                kinds,
                camera.phalanx,
                sold=camera.module is not None,
            ),
            layers=None if layers is None else layers.on_pads(self.body.room),
        )


def linkage_pins(finger: Finger) -> AnyPins:
    """The finger's pins, of whichever kind its linkage is.

    Raises:
        UserError: it has none.
    """
    return _present(finger, finger.pins, "linkage", "pins")


def pins_of(finger: Finger) -> Pins:
    """The pins of a six-bar finger.

    Raises:
        UserError: it has none, or is coupled.
    """
    return _pins_of_kind(finger, Pins)


def coupling_pins_of(finger: Finger) -> CouplingPins:
    """The pins of a coupled finger.

    Raises:
        UserError: it has none, or a six-bar.
    """
    return _pins_of_kind(finger, CouplingPins)


def _pins_of_kind(finger: Finger, kind: type[Kind]) -> Kind:
    pins = linkage_pins(finger)
    if not isinstance(pins, kind):
        raise UserError(
            f"{finger.name}: its linkage is {pins.kind.name}, and this needs one that is "
            f"{kind.kind.name}; give [pins] {', '.join(map(pin_name, kind.kind.pins))}"
        )
    return pins


def links_of(finger: Finger) -> Links:
    """Widths and layers of the finger's links.

    Raises:
        UserError: it has none.
    """
    return _present(finger, finger.links, "widths of its links", "links")


def spring_of(finger: Finger) -> FingerSpring:
    """The finger's spring.

    Raises:
        UserError: it has none.
    """
    return _present(finger, finger.spring, "spring", "spring")


def camera_of(finger: Finger) -> FingerCamera:
    """The finger's camera.

    Raises:
        UserError: it has none.
    """
    return _present(finger, finger.camera, "camera", "camera")


def _present(finger: Finger, part: Part | None, what: str, table: str) -> Part:
    if part is None:
        raise UserError(f"{finger.name}: it has no {what}; add [{table}]")
    return part


def _line(start: Sequence[Number], end: Sequence[Number]) -> Float[Array, "2 2"]:
    return jnp.stack([jnp.stack(list(start)), jnp.stack(list(end))])


def _joints(body: Body, pins: AnyPins, motor: FingerMotor | None) -> dict[str, Float[Array, "2"]]:
    """Every joint of the linkage in the straight finger, by its name in files."""
    zero = jnp.zeros_like(body.intermediate)
    along = {
        "O": -body.proximal,
        "A": zero,
        "B": body.intermediate,
        "T": body.intermediate + body.distal,
    }
    axes = {name: jnp.stack([x, zero]) for name, x in along.items()}
    joints = axes | {pin_name(name): getattr(pins, name) for name in pins.names}
    if motor is not None:
        assert pins.K is not None  # as `Finger.of` refuses a motor without it
        axis = motor.axis(body, pins)
        joints |= {"M": axis, "N": axis + pins.K - pins.crank_axis}
    return joints


@functools.cache
def _structure(kind: LinkageKind, drive: Drive, *, springs: bool, driven: bool) -> Structure:
    bodies, pins = dict(kind.bodies), kind.pins
    if driven:
        bodies["proximal"] += "M"
        bodies[kind.crank] += "K"
        bodies |= {name: kind.outlines[name] for name in PARALLELOGRAM}
        pins += "KMN"
    return Structure(
        name="finger" if drive == "joints" else "finger, driven by its crank",
        joints=tuple(pin_name(name) for name in "OABT" + pins),
        bodies=tuple(
            BodyPart(name, tuple(map(pin_name, at)), name == "proximal")
            for name, at in bodies.items()
        ),
        sliders=(),
        inputs=tuple(
            InputPart(name, body, None, relative_to)
            for name, body, relative_to in kind.inputs[drive]
        ),
        springs=kind.springs if springs else (),
    )


@functools.cache
def _layout(
    name: str,
    phalanges: tuple[Phalanx, ...],
    layers: tuple[tuple[LayerKinds, ...], ...],
    camera: Phalanx,
    *,
    sold: bool,
) -> Layout:
    proximal, distal = 0, 1
    frame_of = {"proximal": proximal, "intermediate": WORLD, "distal": distal}
    hosts: dict[str, Phalanx] = {
        "camera body": camera,
        "proximal shell": "proximal",
        "intermediate shell": "intermediate",
        "distal shell": "distal",
        "proximal end": "proximal",
        "tip": "distal",
    }
    if sold:
        del hosts["camera body"]
    return Layout(
        name=name,
        mirrors=tuple(
            Surface(name, SIDES[one], frame_of[one])
            for name, one in zip(mirror_names(phalanges), phalanges, strict=True)
        ),
        curved=(),
        pads=tuple(Surface(one, 1, frame) for one, frame in frame_of.items()),
        blockers=tuple(Surface(one, 0, frame_of[host]) for one, host in hosts.items()),
        frames=(Frame("proximal", WORLD, 0, 1), Frame("distal", WORLD, 1, -1)),
        angles=("pip", "dip"),
        camera_frame=frame_of[camera],
        bounces=1,
        layers=layers,
        bezels=(False,) * len(layers),
        module=(Surface(NAME, 0, frame_of[camera]),) * (LINES if sold else 0),
    )
