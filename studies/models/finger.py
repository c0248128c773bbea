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

from designopt import UserError, as_float
from designopt.io.toml_writing import degrees_of
from designopt.numerics import optional_float
from kinematics.io.pinned import assembly_signs, pinned_linkage, pinned_tables
from kinematics.model.linkage import Linkage
from kinematics.model.linkage import Spring as LinkageSpring
from kinematics.model.topology import BodyPart, InputPart, Structure
from optics.scene.camera import Camera, Equidistant, Projection, Sensor
from optics.scene.camera_module import LINES, NAME, CameraModule
from optics.scene.layers import LayerKinds
from optics.scene.scene import WORLD, Frame, Layout, Scene, Surface
from optics.scene.thin_lens import ThinLens
from studies.models.body import BodyTable
from studies.models.link_layers import Links
from studies.models.linkage_kinds import PARALLELOGRAM, LinkageKind
from studies.models.pad_layers import PadLayers, Room
from studies.models.pins import AnyPins, CouplingPins, Pins, pin_name

Drive = Literal["joints", "crank"]
Phalanx = Literal["proximal", "intermediate", "distal"]
PHALANGES: tuple[Phalanx, ...] = ("proximal", "intermediate", "distal")

DRIVES: tuple[Drive, Drive] = ("joints", "crank")

AXES: dict[Phalanx, str] = {"proximal": "A", "intermediate": "A", "distal": "B"}
"""A phalanx's own joint axis: A is PIP's, B that of DIP. Places in the phalanx are from there."""

OUTWARD: dict[Phalanx, int] = {"proximal": -1, "intermediate": 1, "distal": 1}
"""The direction of x in which a phalanx lies from its own joint axis."""

SIDES: dict[Phalanx, int] = {phalanx: -out for phalanx, out in OUTWARD.items()}
"""The reflecting side of the mirrors of a phalanx from their first end to their second: 1 is left,
-1 right. All look at the pads."""

MOUNT = 1.0
"""Thickness of a mirror's glass and backing, mm: an assumption of this project."""

SETBACK = 0.5
"""The front of the camera's opaque body lies so far behind the pinhole, mm."""

Number = Float[Array, "*batch"]
Part = TypeVar("Part")
Kind = TypeVar("Kind", Pins, CouplingPins)


def joints_between(one: Phalanx, other: Phalanx) -> range:
    """Indices (0: PIP, 1: DIP) of the joints that move two phalanges against each other.

    Example:
        >>> list(joints_between("distal", "proximal"))
        [0, 1]
    """
    first, last = sorted(map(PHALANGES.index, (one, other)))
    return range(first, last)


class Body(eqx.Module):
    """The three phalanges.

    Attributes:
        proximal: length of the proximal phalanx, mm.
        intermediate: from the PIP to the DIP axis, mm.
        distal: from the DIP axis to the finger tip, mm.
        thickness: from the palmar to the dorsal face, mm.
        axis_height: from the palmar face to the axes, mm.
        flexion: greatest flexion of each joint, or of PIP if that of DIP is another, rad.
        rim: from a pad's other end to the end of the finger, mm.
        protrusion: by which the membranes stand out of the palmar face, mm.
        pad_clearance: what is left between the membranes of neighbouring phalanges, and between
            the layers behind them, when a joint is bent as far as it goes, mm.
        dip_flexion: greatest flexion of DIP, rad; ``None``: that of PIP.
    """

    proximal: Number = eqx.field(converter=as_float)
    intermediate: Number = eqx.field(converter=as_float)
    distal: Number = eqx.field(converter=as_float)
    thickness: Number = eqx.field(converter=as_float)
    axis_height: Number = eqx.field(converter=as_float)
    flexion: Number = eqx.field(converter=as_float)
    rim: Number = eqx.field(converter=as_float)
    protrusion: Number = eqx.field(default=0.0, converter=as_float)
    pad_clearance: Number = eqx.field(default=0.0, converter=as_float)
    dip_flexion: Number | None = eqx.field(default=None, converter=optional_float)

    @classmethod
    def of(cls, table: BodyTable) -> Body:
        """That of a file or of settings."""
        lengths = table.model_dump(exclude={"range_deg", "dip_range_deg"})
        pip, dip = np.deg2rad(table.ranges_deg)
        return cls(**lengths, flexion=pip, dip_flexion=None if dip == pip else dip)

    @property
    def range_deg(self) -> float:
        """Greatest flexion of any joint in degrees, a plain number: grids go so far."""
        return max(self.ranges_deg)

    @property
    def ranges_deg(self) -> tuple[float, float]:
        """Greatest flexion of PIP and DIP in degrees, plain numbers."""
        pip, dip = (degrees_of(float(end)) for end in self.flexions)
        return pip, dip

    @property
    def flexions(self) -> tuple[Number, Number]:
        """Greatest flexion of PIP and DIP, rad."""
        return self.flexion, self.flexion if self.dip_flexion is None else self.dip_flexion

    @property
    def gaps(self) -> tuple[Number, Number]:
        """From PIP and DIP axis to the ends of the membranes beside it, mm.

        Membranes of neighbouring phalanges that begin g from an axis, h + p below it, are
        2 (g cos r/2 − (h + p) sin r/2) apart when the joint is bent by r: each is half of that
        from the plane that halves the joint. The gap is the one that leaves ``pad_clearance`` at
        the end of the range, where this is least. tan r/2 and 1 / cos r/2 are written so that a
        range of 90° gives h + p exactly.
        """
        pip, dip = (
            (self.axis_height + self.protrusion) * jnp.sin(end) / (1 + jnp.cos(end))
            + self.pad_clearance * jnp.sqrt(0.5 / (1 + jnp.cos(end)))
            for end in self.flexions
        )
        return pip, dip

    @property
    def room(self) -> Room:
        """What is free for layers on the pads."""
        return Room(self.gaps, self.flexions, self.pad_clearance, self.rim)

    @property
    def membrane(self) -> Number:
        """Length of the three membranes together, mm."""
        pip, dip = self.gaps
        whole = self.proximal + self.intermediate + self.distal
        return whole - 2 * (pip + dip + self.rim)

    def axis(self, phalanx: Phalanx) -> Number:
        """Place of a phalanx's own joint axis along the straight finger, mm."""
        middle = self.intermediate
        return middle if phalanx == "distal" else jnp.zeros_like(middle)

    def place(self, phalanx: Phalanx, at: Float[Array, "*places 2"]) -> Float[Array, "*places 2"]:
        """Where places of a phalanx, each (along, depth), are in the straight finger, mm.

        Args:
            phalanx: from whose own joint axis ``along`` is measured, towards the tip.
            at: ``depth`` is below the dorsal face.
        """
        return jnp.stack([at[..., 0] + self.axis(phalanx), self.dorsal - at[..., 1]], axis=-1)

    @property
    def palmar(self) -> Number:
        """Height of the palmar face over the axes, mm (negative)."""
        return -self.axis_height

    @property
    def dorsal(self) -> Number:
        """Height of the dorsal face over the axes, mm."""
        return self.thickness - self.axis_height


class FingerSpring(eqx.Module):
    """The torsion spring between distal phalanx and plate, and the motor.

    Attributes:
        stiffness: N mm/rad.
        preload: how far it is wound in the straight finger, rad.
        servo: stiffness of the motor, N mm/rad.
    """

    stiffness: Number = eqx.field(converter=as_float)
    preload: Number = eqx.field(converter=as_float)
    servo: Number = eqx.field(converter=as_float)

    @property
    def contrast(self) -> Number:
        """κ = √(k / k_s) of spring and motor."""
        return jnp.sqrt(self.stiffness / self.servo)

    @property
    def moment_unit(self) -> Number:
        """√(k k_s), N mm/rad: a moment of the size that both springs' moments have."""
        return jnp.sqrt(self.stiffness * self.servo)


class FingerMotor(eqx.Module):
    """The motor, which turns the crank through a parallelogram.

    Its driver M-N is parallel to F-K of the crank, and the coupler N-K to M-F. The crank of a
    coupled finger is its intermediate phalanx, and F is then A.

    Attributes:
        behind: of its axis M behind the rear end of the proximal phalanx, mm.
        above: of its axis over that of the crank, mm.
    """

    behind: Number = eqx.field(converter=as_float)
    above: Number = eqx.field(converter=as_float)

    def axis(self, body: Body, pins: AnyPins) -> Float[Array, "2"]:
        """Place of its axis M, mm."""
        return jnp.stack([-body.proximal - self.behind, pins.crank_axis[..., 1] + self.above])


class FingerCamera(eqx.Module):
    """The camera in one of the phalanges, by default the intermediate one.

    Attributes:
        along: of the pinhole from the phalanx's own joint axis towards the tip, mm: negative in the
            proximal phalanx.
        depth: of the pinhole below the dorsal face, mm.
        tilt: of the optical axis, rad: 0 looks straight at the palmar face, positive is
            counter-clockwise, towards the tip.
        field_of_view: rad.
        pixels: along the image line.
        width: of the opaque body, mm.
        grazing: least angle between a pad and a ray that shows it, rad.
        back: from the pinhole to the back of the opaque body, mm.
        projection: of the lens.
        sensor: behind the lens, as both are sold; ``None``: the field of view fills the image line.
        lens: for questions of focus; ``None`` for a camera that is sharp everywhere.
        module: its body as it is sold, instead of ``width`` and ``back``; ``None`` if not known.
        max_blur: largest blur spot that is accepted, pixels.
        phalanx: that carries it.
    """

    along: Number = eqx.field(converter=as_float)
    depth: Number = eqx.field(converter=as_float)
    tilt: Number = eqx.field(converter=as_float)
    field_of_view: Number = eqx.field(converter=as_float)
    pixels: Number = eqx.field(converter=as_float)
    width: Number = eqx.field(converter=as_float)
    grazing: Number = eqx.field(converter=as_float)
    back: Number = eqx.field(default=4.0, converter=as_float)
    projection: Projection = Equidistant()
    sensor: Sensor | None = None
    lens: ThinLens | None = None
    module: CameraModule | None = None
    max_blur: Number | None = eqx.field(default=None, converter=optional_float)
    phalanx: Phalanx = eqx.field(default="intermediate", static=True)

    @classmethod
    def of(cls, lens: Any, along: Any, depth: Any, tilt_deg: float) -> FingerCamera:
        """One at a place; all else from ``[camera]`` of a file or from settings, in degrees.

        Args:
            lens: has ``optics``, a `Camera` anywhere, ``width``, ``back``, ``min_grazing_deg`` and
                ``phalanx``.
            along: see the attributes.
            depth: likewise.
            tilt_deg: likewise.
        """
        sold: Camera = lens.optics
        return cls(
            along,
            depth,
            np.deg2rad(tilt_deg),
            sold.field_of_view,
            sold.pixels,
            lens.width,
            np.deg2rad(lens.min_grazing_deg),
            lens.back,
            sold.projection,
            sold.sensor,
            sold.lens,
            sold.module,
            sold.max_blur,
            lens.phalanx,
        )

    def at(self, body: Body) -> Camera:
        """The camera of a scene, in the straight finger.

        Args:
            body: that it is in.
        """
        return Camera(
            position=body.place(self.phalanx, jnp.stack([self.along, self.depth])),
            direction=self.tilt - jnp.pi / 2,
            field_of_view=self.field_of_view,
            pixels=self.pixels,
            projection=self.projection,
            lens=self.lens,
            sensor=self.sensor,
            module=self.module,
            max_blur=self.max_blur,
        )


class FingerMirror(eqx.Module):
    """A straight mirror in one of the phalanges; see `mirror_names`.

    It reflects on its palmar side; on its dorsal side is its mount, which hides nothing that the
    mirror does not hide itself.

    Attributes:
        ends: each (along, depth): from the phalanx's own joint axis towards the tip, and below the
            dorsal face, mm; the end near the axis first.
        phalanx: that carries it.
        mount: thickness of glass and backing behind the reflecting line, mm.
    """

    ends: Float[Array, "*batch 2 2"] = eqx.field(converter=as_float)
    phalanx: Phalanx = eqx.field(static=True)
    mount: Number = eqx.field(default=MOUNT, converter=as_float)

    @property
    def length(self) -> Number:
        """From end to end, mm."""
        step = self.ends[..., 1, :] - self.ends[..., 0, :]
        return jnp.sqrt(jnp.sum(step * step, axis=-1))

    @property
    def corners(self) -> Float[Array, "*batch 4 2"]:
        """Corners of mirror and mount, one after the other, each (along, depth), mm.

        First the ends, then the corners behind the far and the near one.
        """
        near, far = self.ends[..., 0, :], self.ends[..., 1, :]
        step = (far - near) / self.length[..., None]
        # Depths grow downwards.
        normal = jnp.stack([step[..., 1], -step[..., 0]], axis=-1) * -SIDES[self.phalanx]
        back = self.mount[..., None] * normal
        return jnp.stack([near, far, far + back, near + back], axis=-2)


def mirror_names(phalanges: Sequence[Phalanx]) -> tuple[str, ...]:
    """Names of the mirrors of these phalanges, in scenes, tables and figures.

    Example:
        >>> mirror_names(["distal", "proximal", "distal"])
        ('distal', 'proximal', 'distal 2')
    """
    counts = [list(phalanges[:i]).count(one) for i, one in enumerate(phalanges)]
    return tuple(
        f"{one} {count + 1}" if count else one for one, count in zip(phalanges, counts, strict=True)
    )


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
            joints = _joints(body, pins, motor)
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
        kind, driven = linkage_pins(self).kind, self.motor is not None
        structure = _structure(kind, "joints", springs=False, driven=driven)
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
