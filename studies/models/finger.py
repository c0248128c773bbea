"""Paper B's finger as one pytree: every independent dimension is a leaf, all else follows.

Coordinates are those of the straight finger: PIP axis A at the origin, DIP axis B at
(intermediate, 0), x towards the tip, y towards the back of the hand, mm. Flexion is positive and 0
in the straight finger, which is the reference configuration.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.numerics import as_float
from kinematics.io.pinned import assembly_signs, pinned_linkage
from kinematics.model.linkage import Linkage
from kinematics.model.linkage import Spring as LinkageSpring
from kinematics.model.topology import BodyPart, InputPart, Structure
from optics.scene.camera import Camera, Equidistant
from optics.scene.scene import WORLD, Frame, Layout, Scene, Surface
from studies.models.pins import Drive, Pins, told

Phalanx = Literal["proximal", "intermediate", "distal"]

DRIVES: tuple[Drive, Drive] = ("joints", "crank")

SETBACK = 0.5
"""The front of the camera's opaque body lies so far behind the pinhole, mm."""

Number = Float[Array, "*batch"]


class Body(eqx.Module):
    """The three phalanges.

    Attributes:
        proximal: length of the proximal phalanx, mm.
        intermediate: from the PIP to the DIP axis, mm.
        distal: from the DIP axis to the finger tip, mm.
        thickness: from the palmar to the dorsal face, mm.
        axis_height: from the palmar face to the axes, mm. Pads begin as far from an axis, so that
            those of neighbouring phalanges just meet when the joint is bent by 90°.
        flexion: greatest flexion of each joint, rad.
        rim: from a pad's other end to the end of the finger, mm.
    """

    proximal: Number = eqx.field(converter=as_float)
    intermediate: Number = eqx.field(converter=as_float)
    distal: Number = eqx.field(converter=as_float)
    thickness: Number = eqx.field(converter=as_float)
    axis_height: Number = eqx.field(converter=as_float)
    flexion: Number = eqx.field(converter=as_float)
    rim: Number = eqx.field(converter=as_float)

    @property
    def palmar(self) -> Number:
        """Height of the palmar face over the axes, mm (negative)."""
        return -self.axis_height

    @property
    def dorsal(self) -> Number:
        """Height of the dorsal face over the axes, mm."""
        return self.thickness - self.axis_height


class Spring(eqx.Module):
    """The torsion spring between distal phalanx and plate, and the motor.

    Attributes:
        stiffness: N mm/rad.
        preload: how far it is wound in the straight finger, rad.
        servo: stiffness of the motor, N mm/rad.
    """

    stiffness: Number = eqx.field(converter=as_float)
    preload: Number = eqx.field(converter=as_float)
    servo: Number = eqx.field(converter=as_float)


class FingerCamera(eqx.Module):
    """The camera in the intermediate phalanx; its lens is equidistant.

    Attributes:
        along: of the pinhole from the PIP axis towards the tip, mm.
        depth: of the pinhole below the dorsal face, mm.
        tilt: of the optical axis, rad: 0 looks straight at the palmar face, positive is
            counter-clockwise, towards the tip.
        field_of_view: rad.
        pixels: along the image line.
        width: of the opaque body, mm.
        grazing: least angle between a pad and a ray that shows it, rad.
    """

    along: Number = eqx.field(converter=as_float)
    depth: Number = eqx.field(converter=as_float)
    tilt: Number = eqx.field(converter=as_float)
    field_of_view: Number = eqx.field(converter=as_float)
    pixels: Number = eqx.field(converter=as_float)
    width: Number = eqx.field(converter=as_float)
    grazing: Number = eqx.field(converter=as_float)


class FingerMirror(eqx.Module):
    """A straight mirror in the proximal or the distal phalanx; it is named after it.

    Attributes:
        ends: each (along, depth): from the phalanx's own joint axis towards the tip, and below the
            dorsal face, mm; the end near the axis first.
        phalanx: that carries it.
    """

    ends: Float[Array, "*batch 2 2"] = eqx.field(converter=as_float)
    phalanx: Phalanx = eqx.field(static=True)


class Finger(eqx.Module):
    """A finger: body, linkage, spring, camera and mirrors.

    `jax.grad`, `jax.vmap` and `jax.jit` apply to it: hinges, pads, shells and the camera's body are
    computed from its leaves, so thickness and axis height move what they move in the metal. Which
    way the linkage is assembled is static; `Finger.of` takes it from the pins.

    Attributes:
        body: the phalanges.
        pins: of the linkage.
        spring: ``None`` where the finger has none.
        camera: ``None`` where the finger sees nothing.
        mirrors: in order.
        name: in titles and file names.
        assembly: one sign per closed-form group of the linkage, driven at its joints and by its
            crank.
    """

    body: Body
    pins: Pins
    spring: Spring | None
    camera: FingerCamera | None
    mirrors: tuple[FingerMirror, ...]
    name: str = eqx.field(static=True)
    assembly: tuple[tuple[int, ...], tuple[int, ...]] = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        body: Body,
        pins: Pins,
        spring: Spring | None = None,
        camera: FingerCamera | None = None,
        mirrors: Sequence[FingerMirror] = (),
        *,
        name: str = "finger",
    ) -> Finger:
        """A finger from its parts; the pins, plain numbers, choose how it is assembled."""
        places = {joint: np.asarray(at, float) for joint, at in _joints(body, pins).items()}
        by_joints, by_crank = (
            assembly_signs(_structure(drive, springs=False), places) for drive in DRIVES
        )
        return cls(body, pins, spring, camera, tuple(mirrors), name, (by_joints, by_crank))

    def linkage(self, drive: Drive = "joints") -> Linkage:
        """The linkage in the frame of the proximal phalanx; flexion is negative there.

        Args:
            drive: inputs are the joints ``pip`` and ``dip``, or ``theta`` of the crank and
                ``gamma`` of the plate relative to the distal phalanx.
        """
        springs: tuple[LinkageSpring, ...] = ()
        if drive == "crank" and self.spring is not None:
            springs = (LinkageSpring(self.spring.stiffness, self.spring.preload),)
        return pinned_linkage(
            _structure(drive, springs=bool(springs)),
            _joints(self.body, self.pins),
            self.assembly[DRIVES.index(drive)],
            springs,
        )

    def scene(self) -> Scene:
        """Camera, mirrors, pads and shells; the intermediate phalanx is the world.

        Blockers are the camera's body, shells on the back from axis to axis (flexion opens gaps
        between them, so none swings into the finger) and walls at both ends.

        Raises:
            UserError: the finger has no camera.
        """
        if self.camera is None:
            raise UserError(f"{self.name}: it has no camera; add [camera]")
        body, camera = self.body, self.camera
        middle, palmar, dorsal, gap = body.intermediate, body.palmar, body.dorsal, body.axis_height
        tip, root = middle + body.distal, -body.proximal
        axis_of = {"proximal": jnp.zeros_like(middle), "distal": middle}

        def line(start: Sequence[Number], end: Sequence[Number]) -> Float[Array, "2 2"]:
            return jnp.stack([jnp.stack(list(start)), jnp.stack(list(end))])

        def mirror(part: FingerMirror) -> Float[Array, "2 2"]:
            along, depth = part.ends[..., 0], part.ends[..., 1]
            return jnp.stack([along + axis_of[part.phalanx], dorsal - depth], axis=-1)

        position = jnp.stack([camera.along, dorsal - camera.depth])
        sine, cosine = jnp.sin(camera.tilt), jnp.cos(camera.tilt)
        ahead, across = jnp.stack([sine, -cosine]), jnp.stack([cosine, sine])
        behind = position - SETBACK * ahead
        half = camera.width / 2 * across
        zero = jnp.zeros_like(middle)
        blockers = [
            jnp.stack([behind - half, behind + half]),
            line((root, dorsal), (zero, dorsal)),
            line((zero, dorsal), (middle, dorsal)),
            line((middle, dorsal), (tip, dorsal)),
            line((root, palmar), (root, dorsal)),
            line((tip, palmar), (tip, dorsal)),
        ]
        pads = [
            line((root + body.rim, palmar), (-gap, palmar)),
            line((gap, palmar), (middle - gap, palmar)),
            line((middle + gap, palmar), (tip - body.rim, palmar)),
        ]
        none = jnp.zeros((0,), position.dtype)
        mirrors = [mirror(part) for part in self.mirrors]
        return Scene(
            camera=Camera(
                position=position,
                direction=camera.tilt - jnp.pi / 2,
                field_of_view=camera.field_of_view,
                pixels=camera.pixels,
                projection=Equidistant(),
            ),
            mirrors=jnp.stack(mirrors) if mirrors else jnp.zeros((0, 2, 2), position.dtype),
            radii=none,
            conics=none,
            pads=jnp.stack(pads),
            grazing=jnp.broadcast_to(camera.grazing, (3,)),
            blockers=jnp.stack(blockers),
            hinges=jnp.stack([jnp.stack([zero, zero]), jnp.stack([middle, zero])]),
            layout=_layout(self.name, tuple(part.phalanx for part in self.mirrors)),
        )


def _joints(body: Body, pins: Pins) -> dict[str, Float[Array, "2"]]:
    """Every joint of the linkage in the straight finger, by its name in files."""
    zero = jnp.zeros_like(body.intermediate)
    along = {
        "O": -body.proximal,
        "A": zero,
        "B": body.intermediate,
        "T": body.intermediate + body.distal,
    }
    axes = {name: jnp.stack([x, zero]) for name, x in along.items()}
    return axes | {told(name): getattr(pins, name) for name in "FEDCGH"}


@functools.cache
def _structure(drive: Drive, *, springs: bool) -> Structure:
    inputs = {
        "joints": (
            InputPart("pip", "intermediate", None, "proximal"),
            InputPart("dip", "distal", None, "intermediate"),
        ),
        "crank": (
            InputPart("theta", "crank", None),
            InputPart("gamma", "plate", None, "distal"),
        ),
    }
    bodies = {
        "proximal": ("O", "A", "F"),
        "intermediate": ("A", "B", "G"),
        "distal": ("B", "T", "C"),
        "plate": ("C", "D", told("H")),
        "rod": ("D", "E"),
        "crank": ("F", "E"),
        "bar": ("G", told("H")),
    }
    return Structure(
        name="finger" if drive == "joints" else "finger, driven by its crank",
        joints=("O", "A", "B", "T", *(told(name) for name in "FEDCGH")),
        bodies=tuple(BodyPart(name, at, name == "proximal") for name, at in bodies.items()),
        sliders=(),
        inputs=inputs[drive],
        springs=(("distal", "plate"),) if springs else (),
    )


@functools.cache
def _layout(name: str, phalanges: tuple[Phalanx, ...]) -> Layout:
    proximal, distal = 0, 1
    frame_of = {"proximal": proximal, "intermediate": WORLD, "distal": distal}
    side_of = {"proximal": 1, "distal": -1}
    hosts: dict[str, Phalanx] = {
        "camera body": "intermediate",
        "proximal shell": "proximal",
        "intermediate shell": "intermediate",
        "distal shell": "distal",
        "proximal end": "proximal",
        "tip": "distal",
    }
    return Layout(
        name=name,
        mirrors=tuple(Surface(one, side_of[one], frame_of[one]) for one in phalanges),
        curved=(),
        pads=tuple(Surface(one, 1, frame) for one, frame in frame_of.items()),
        blockers=tuple(Surface(one, 0, frame_of[host]) for one, host in hosts.items()),
        frames=(Frame("proximal", WORLD, 0, 1), Frame("distal", WORLD, 1, -1)),
        angles=("pip", "dip"),
        camera_frame=WORLD,
        bounces=1,
    )
