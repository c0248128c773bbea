"""What is free: where the camera and the mirrors are; and the scene that follows from it.

Coordinates are those of the phalanges themselves: the camera's in the intermediate one (PIP axis at
the origin, which is the scene's world), a mirror's in its own, with the origin at its joint's axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.io.spec_files import FORMAT
from designopt.numerics import as_float
from optics.scene.reading import scene_from
from optics.scene.scene import Scene
from studies.models.body import RIM, BodySpec
from studies.models.mirror_design.spec import MirrorSpec

SETBACK = 0.5
"""The front of the camera's opaque body lies so far behind the pinhole, mm."""


class Arrangement(eqx.Module):
    """Camera and mirrors; also a bound of all of them, or a scale.

    Attributes:
        camera: position of the pinhole in the intermediate phalanx, mm.
        tilt: of the optical axis, rad: 0 looks straight at the palmar face, positive is
            counter-clockwise, towards the finger's tip.
        distal: ends of the distal mirror in its phalanx, the one near the DIP axis first, mm.
        proximal: ends of the proximal mirror in its phalanx, the one near the PIP axis first, mm.
    """

    camera: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    tilt: Float[Array, "*batch"] = eqx.field(converter=as_float)
    distal: Float[Array, "*batch 2 2"] = eqx.field(converter=as_float)
    proximal: Float[Array, "*batch 2 2"] = eqx.field(converter=as_float)

    @classmethod
    def of(
        cls,
        camera: Sequence[float],
        tilt: float,
        distal: Sequence[Sequence[float]],
        proximal: Sequence[Sequence[float]],
    ) -> Arrangement:
        """From plain numbers, mm and rad."""
        return cls(*(np.asarray(part, float) for part in (camera, tilt, distal, proximal)))

    @property
    def mirrors(self) -> Float[Array, "*batch 2 2 2"]:
        """Ends of both mirrors, each in its phalanx: distal, proximal; mm."""
        return jnp.stack([self.distal, self.proximal], axis=-3)

    @property
    def lengths(self) -> Float[Array, "*batch 2"]:
        """Lengths of both mirrors, mm."""
        along = self.mirrors[..., 1, :] - self.mirrors[..., 0, :]
        return jnp.sqrt(jnp.sum(along * along, axis=-1))


def robust_layout() -> Arrangement:
    """The reference layout for T = 25 mm: that of an earlier, independent search with errors."""
    return Arrangement.of(
        camera=[15.75, 16.99],
        tilt=math.radians(-6.3),
        distal=[[0.24, 19.04], [30.81, 0.34]],
        proximal=[[4.16, 18.50], [-28.35, 9.30]],
    )


def poor_start(body: BodySpec) -> Arrangement:
    """Where the search begins on purpose: mirrors along the back of the finger, which show little.

    The camera sits 5 mm over the middle of the intermediate pad and looks straight at it.
    """
    high = body.dorsal - 2
    return Arrangement.of(
        camera=[body.intermediate / 2, body.palmar + 5],
        tilt=0.0,
        distal=[[2.0, high], [body.distal - 4, high]],
        proximal=[[-2.0, high], [4 - body.proximal, high]],
    )


def bounds(body: BodySpec, spec: MirrorSpec) -> tuple[Arrangement, Arrangement]:
    """Least and greatest values of everything that is free: inside its phalanx.

    The camera's body lies over the intermediate phalanx and its depth below the dorsal face. A
    mirror's ends keep the clearance from the palmar plane, the dorsal face and the end wall. One
    end lies in the half next to the joint, and may reach beyond the joint's axis by the overhang
    (the reference layout's proximal mirror does so by 4.16 mm: the cheeks that carry it enclose the
    joint), the other in the far half. That the overhanging ends keep away from the camera's body is
    an inequality (`problem.clearances`).

    Returns:
        The least and the greatest arrangement, mm and rad.
    """
    clear, over = spec.room.clearance, spec.room.overhang
    low, high = body.palmar + clear, body.dorsal - clear
    half = spec.camera.width / 2
    top = body.dorsal - spec.camera.depth
    outer, inner = body.distal, body.proximal
    least = Arrangement.of(
        camera=[half, body.palmar + 2 * clear],
        tilt=-0.6,
        distal=[[-over, low], [outer / 2, low]],
        proximal=[[-inner / 2, low], [clear - inner, low]],
    )
    greatest = Arrangement.of(
        camera=[body.intermediate - half, top],
        tilt=0.6,
        distal=[[outer / 2, high], [outer - clear, high]],
        proximal=[[over, high], [-inner / 2, high]],
    )
    return least, greatest


def scale() -> Arrangement:
    """A change of each number that matters about as much as that of the others: 1 mm, 0.1 rad."""
    ones = [[1.0, 1.0], [1.0, 1.0]]
    return Arrangement.of([1.0, 1.0], 0.1, ones, ones)


def camera_body(arrangement: Arrangement, width: Float[Array, ""] | float) -> Float[Array, "2 2"]:
    """Ends of the opaque line behind the camera, in the intermediate phalanx, mm."""
    sine, cosine = jnp.sin(arrangement.tilt), jnp.cos(arrangement.tilt)
    axis, across = jnp.stack([sine, -cosine]), jnp.stack([cosine, sine])
    middle = arrangement.camera - SETBACK * axis
    return jnp.stack([middle - width / 2 * across, middle + width / 2 * across])


def scene_table(
    arrangement: Arrangement, body: BodySpec, spec: MirrorSpec | None = None
) -> dict[str, Any]:
    """The tables of a scene file of the finger, as ``designopt trace`` reads them.

    Blockers are the camera's body, shells on the back from axis to axis (flexion opens gaps
    between them, so none swings into the finger) and walls at both ends.

    Args:
        arrangement: a single one.
        body: the finger's body.
        spec: its camera; default settings if none.
    """
    camera = (spec or MirrorSpec()).camera
    middle, palmar, dorsal, gap = body.intermediate, body.palmar, body.dorsal, body.axis_height
    tip, root = middle + body.distal, -body.proximal

    def surface(name: str, corners: Any, frame: str | None, **more: Any) -> dict[str, Any]:
        start, end = (_plain(corner) for corner in corners)
        ends = {"from": start, "to": end}
        return {"name": name, **ends, **more, **({"body": frame} if frame else {})}

    def pad(name: str, start: float, end: float, frame: str | None) -> dict[str, Any]:
        seen = {"side": "left", "min_grazing_deg": camera.min_grazing_deg}
        return surface(name, ((start, palmar), (end, palmar)), frame, **seen)

    distal = np.asarray(arrangement.distal) + np.array([[middle, 0.0]])
    return {
        "scene": {"name": "finger", "format": FORMAT, "bounces": 1},
        "camera": {
            "position": _plain(arrangement.camera),
            "direction_deg": math.degrees(float(arrangement.tilt)) - 90,
            "fov_deg": camera.fov_deg,
            "pixels": camera.pixels,
            "projection": "equidistant",
        },
        "mirrors": [
            surface("distal", distal, "distal", side="right"),
            surface("proximal", arrangement.proximal, "proximal", side="left"),
        ],
        "pads": [
            pad("proximal", root + RIM, -gap, "proximal"),
            pad("intermediate", gap, middle - gap, None),
            pad("distal", middle + gap, tip - RIM, "distal"),
        ],
        "blockers": [
            surface("camera body", camera_body(arrangement, camera.width), None),
            surface("proximal shell", ((root, dorsal), (0, dorsal)), "proximal"),
            surface("intermediate shell", ((0, dorsal), (middle, dorsal)), None),
            surface("distal shell", ((middle, dorsal), (tip, dorsal)), "distal"),
            surface("proximal end", ((root, palmar), (root, dorsal)), "proximal"),
            surface("tip", ((tip, palmar), (tip, dorsal)), "distal"),
        ],
        "frames": {
            "proximal": {"hinge": [0.0, 0.0], "angle": "pip", "positive": "counterclockwise"},
            "distal": {"hinge": [middle, 0.0], "angle": "dip", "positive": "clockwise"},
        },
    }


def finger_scene(body: BodySpec, spec: MirrorSpec) -> Scene:
    """The finger with an arrangement that only holds its place: `scene_of` puts another in."""
    return scene_from(scene_table(poor_start(body), body, spec), "finger")


def scene_of(arrangement: Arrangement, finger: Scene) -> Scene:
    """The finger with a given arrangement; differentiable.

    Args:
        arrangement: a single one.
        finger: what `finger_scene` made; its camera body's width is kept.
    """
    hinges = jnp.stack([finger.hinges[1], finger.hinges[0]])  # distal, proximal
    old = finger.blockers[0, 1] - finger.blockers[0, 0]
    behind = camera_body(arrangement, jnp.sqrt(jnp.sum(old * old)))
    return eqx.tree_at(
        lambda scene: (
            scene.mirrors,
            scene.camera.position,
            scene.camera.direction,
            scene.blockers,
        ),
        finger,
        (
            arrangement.mirrors + hinges[:, None],
            arrangement.camera,
            arrangement.tilt - jnp.pi / 2,
            finger.blockers.at[0].set(behind),
        ),
    )


def _plain(place: Any) -> list[float]:
    return [float(number) for number in place]
