"""What lies between mirrors with their mounts and all that is near them, over the joints' range.

Mirrors, the camera's body and the layers of pads are convex outlines in their phalanges, so that
distances are exact (`kinematics.solve.clearance`). Looked at from the intermediate phalanx those of
another one turn about its joint alone: of two outer ones all pairs of angles are looked at. The
back of the finger is that of `studies.models.linkage_design.clearances`: beyond a joint's axis an
arc about it.

A part keeps clear of the pads of the neighbouring phalanges. (An argument of this project: while
joints bend by 90° at most a pad two joints away stays on the palmar side of a phalanx's own pad.)
"""

from __future__ import annotations

from functools import partial
from itertools import combinations
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_sqrt
from kinematics.solve.clearance import find_separation
from studies.models.checks import Check
from studies.models.finger import Finger, camera_of
from studies.models.finger_parts import (
    OUTWARD,
    PHALANGES,
    Body,
    FingerMirror,
    Phalanx,
    joints_between,
)
from studies.models.linkage_design.judging import STEP_DEG
from studies.models.linkage_design.problem import grids

ANGLES = (19, 19)
"""Angles of PIP and of DIP at which the search looks: 5° apart over 90°."""

ENDS: dict[Phalanx, str] = {"proximal": "rear end", "distal": "tip"}
"""Of the finger, by the phalanx that has it."""


class Swept(NamedTuple):
    """A part of a phalanx over the angles of its joint, seen from the intermediate phalanx.

    Attributes:
        phalanx: that carries it.
        outlines: its convex outlines, mm.
    """

    phalanx: Phalanx
    outlines: Float[Array, "angles outlines corners 2"]

    def apart(self, other: Swept) -> Float[Array, "..."]:
        """Signed distances of its outlines from those of another part at all angles, mm."""
        first, second = self.outlines, other.outlines
        if self.phalanx == other.phalanx:  # they do not move against each other
            first, second = first[:1], second[:1]
        return find_separation(first[:, None, :, None], second[None, :, None])


@partial(jax.jit, static_argnames="angles")
def find_clearances(
    finger: Finger, angles: tuple[int, int] = ANGLES
) -> dict[str, Float[Array, ""]]:
    """Least clearances of mirrors with their mounts, mm; negative where one runs into something.

    Args:
        finger: with a camera.
        angles: how many of PIP and of DIP, over their ranges.

    Returns:
        By what people read: from the faces of its phalanx and from the layers on its pad (from the
        palmar face, if that is higher), from the camera's body, from the layers on the pads of the
        neighbouring phalanges (from these pads, if they are bare), and from the other mirrors. Of a
        camera in an outer phalanx, too: from the end of the finger and from the neighbouring pad.
        (Amid the intermediate phalanx, between the joints, neither is near.)
    """
    body, names = finger.body, finger.mirror_names
    ends = zip(ENDS, body.flexions, angles, strict=True)
    turns = {phalanx: jnp.linspace(0.0, end, count) for phalanx, end, count in ends}
    turns["intermediate"] = jnp.zeros(1)

    def swept(phalanx: Phalanx, outlines: Float[Array, "outlines corners 2"]) -> Swept:
        return Swept(phalanx, seen_from_intermediate(body, phalanx, outlines, turns[phalanx]))

    def from_pads(what: str, part: Swept) -> dict[str, Float[Array, "..."]]:
        beside = [one for one in PHALANGES if len(joints_between(one, part.phalanx)) == 1]
        return {f"{what} from the {one} pad": part.apart(pads[one]) for one in beside}

    top = body.palmar - body.protrusion
    if finger.layers is not None:
        top = top + jnp.sum(finger.layers.thickness)
    pads = {one: swept(one, outlines) for one, outlines in _own_pads(finger).items()}
    host = camera_of(finger).phalanx
    boxes = _from_axis(body, host, finger.camera_boxes())
    camera, mirrors, found = swept(host, boxes), {}, {}
    for name, mirror in zip(names, finger.mirrors, strict=True):
        own, what = _above_axes(finger, mirror), f"{name} mirror"
        mirrors[name] = swept(mirror.phalanx, own[None])
        found |= {
            f"{what} inside the {side}": room
            for side, room in _inside(body, mirror.phalanx, own).items()
        }
        found[f"{what} above its pad"] = own[:, 1] - jnp.maximum(top, body.palmar)
        found[f"{what} from the camera"] = mirrors[name].apart(camera)
        found |= from_pads(what, mirrors[name])
    for (one, first), (other, second) in combinations(mirrors.items(), 2):
        found[f"{one} mirror from the {other} mirror"] = first.apart(second)
    if host in ENDS:
        end = ENDS[host]
        found[f"camera inside the {end}"] = _inside(body, host, boxes)[end]
        found |= from_pads("camera", camera)
    return {name: _least(values) for name, values in found.items()}


def _least(values: Float[Array, "..."]) -> Float[Array, ""]:
    """The least, with the slope of one of them."""
    return values.reshape(-1)[jnp.argmin(values)]


def _above_axes(finger: Finger, mirror: FingerMirror) -> Float[Array, "4 2"]:
    """Corners in the phalanx: from its joint's axis towards the tip, and up, mm."""
    corners = mirror.corners
    return jnp.stack([corners[:, 0], finger.body.dorsal - corners[:, 1]], axis=-1)


def _from_axis(
    body: Body, phalanx: Phalanx, outlines: Float[Array, "*outlines 2"]
) -> Float[Array, "*outlines 2"]:
    """Places in the straight finger as places of a phalanx, from its joint's axis, mm."""
    return jnp.stack([outlines[..., 0] - body.axis(phalanx), outlines[..., 1]], axis=-1)


def _inside(
    body: Body, phalanx: Phalanx, corners: Float[Array, "*corners 2"]
) -> dict[str, Float[Array, "*corners"]]:
    """Room between corners in a phalanx and its back and, of an outer one, its end, mm."""
    x, y, length = OUTWARD[phalanx] * corners[..., 0], corners[..., 1], getattr(body, phalanx)
    beyond = x if phalanx in ENDS else jnp.minimum(x, length - x)
    height = jnp.where(beyond < 0, safe_sqrt(beyond * beyond + y * y), y)
    room = {"dorsal face": body.dorsal - height}
    return room | ({ENDS[phalanx]: length - x} if phalanx in ENDS else {})


def seen_from_intermediate(
    body: Body,
    phalanx: Phalanx,
    outlines: Float[Array, "outlines corners 2"],
    angles: Float[Array, " angles"],
) -> Float[Array, "angles outlines corners 2"]:
    """Outlines of a phalanx in the frame of the intermediate one, mm.

    Args:
        body: the phalanges.
        phalanx: that carries them; those of the intermediate one do not move.
        outlines: from its joint's axis towards the tip, and up, mm.
        angles: flexion of its joint, rad.
    """
    if phalanx == "intermediate":
        return outlines[None]
    x, y = outlines[None, ..., 0], outlines[None, ..., 1]
    # Bent, the outer end goes down: the distal phalanx turns clockwise, the proximal one does not.
    cosine = jnp.cos(angles)[:, None, None]
    sine = jnp.sin(angles)[:, None, None] * -OUTWARD[phalanx]
    moved = body.axis(phalanx) + cosine * x - sine * y
    return jnp.stack([moved, sine * x + cosine * y], axis=-1)


def mirror_outlines(
    finger: Finger, mirror: FingerMirror, angles: Float[Array, " angles"]
) -> Float[Array, "angles 4 2"]:
    """Corners of a mirror with its mount, seen from the intermediate phalanx, mm.

    Args:
        finger: whose mirror it is.
        mirror: on one of its phalanges.
        angles: flexion of this phalanx' joint, rad.
    """
    own = _above_axes(finger, mirror)[None]
    return seen_from_intermediate(finger.body, mirror.phalanx, own, angles)[:, 0]


def _own_pads(finger: Finger) -> dict[Phalanx, Float[Array, "parts corners 2"]]:
    """Layers of every pad as convex outlines in its phalanx, mm; the pad itself, if it is bare."""
    bare = finger.layers is None
    outlines = finger.pads()[:, None] if bare else layer_outlines(finger)
    pairs = zip(PHALANGES, outlines, strict=True)
    return {phalanx: _from_axis(finger.body, phalanx, own) for phalanx, own in pairs}


def layer_outlines(finger: Finger) -> Float[Array, "pads layers 4 2"]:
    """Corners of every pad's layers in the straight finger, one after the other, mm.

    The layer on the camera's side is the first; a bare pad has none.
    """
    pads, layers = finger.pads(), finger.layers
    if layers is None:
        return jnp.zeros((len(pads), 0, 4, 2))
    out = layers.reaches(finger.body.room)  # of each pad and layer: ends, edges
    left, right = pads[:, None, :1, 0] - out[:, :, 0], pads[:, None, 1:, 0] + out[:, :, 1]
    x = jnp.stack([left[..., 0], right[..., 0], right[..., 1], left[..., 1]], axis=-1)
    up = pads[:, None, :1, 1] + layers.levels[None, :, jnp.array([0, 0, 1, 1])]
    return jnp.stack([x, jnp.broadcast_to(up, x.shape)], axis=-1)


def dorsal_room(finger: Finger) -> Float[Array, ""]:
    """Room between the camera's body, tilted as it is, and the wall of the back, mm.

    The wall is as thick as the links' ``shell``; without links it is the dorsal face.
    """
    room = finger.body.dorsal - jnp.max(finger.camera_corners()[:, 1])
    return room if finger.links is None else room - finger.links.shell


def clearance_checks(finger: Finger, clearance: float) -> tuple[Check, ...]:
    """Whether everything keeps a clearance (mm) at every degree of both joints.

    The camera's body only has to be inside the wall of the back.
    """
    pip, dip = grids(finger.body, STEP_DEG)
    angles = len(pip), len(dip)
    found = {name: float(least) for name, least in find_clearances(finger, angles).items()}
    inside = Check("camera inside the wall of the back", 0.0, float(dorsal_room(finger)))
    return (*(Check(name, clearance, least) for name, least in found.items()), inside)
