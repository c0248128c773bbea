"""Parts of a finger: its body, and what is built into it; `finger.Finger` puts them together.

Places in a phalanx are from its own joint axis, along the straight finger and below the dorsal
face, mm. Flexion is positive and 0 in the straight finger.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt import as_float
from designopt.io.toml_writing import degrees_of
from designopt.numerics import optional_float
from optics.scene.camera import Camera, Equidistant, Projection, Sensor
from optics.scene.camera_module import CameraModule
from optics.scene.thin_lens import ThinLens
from studies.models.body import BodyTable
from studies.models.pad_layers import Room
from studies.models.pins import AnyPins

Phalanx = Literal["proximal", "intermediate", "distal"]
PHALANGES: tuple[Phalanx, ...] = ("proximal", "intermediate", "distal")

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
