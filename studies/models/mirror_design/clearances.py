"""What lies between mirrors with their mounts and all that is near them, over the joints' range.

A mirror moves with its phalanx: looked at from the intermediate one it turns about its joint. Its
outline is a convex quadrilateral, as the parts of the camera's body and the layers of pads are, so
that distances are exact (`kinematics.solve.clearance`). The back of the finger is that of
`studies.models.linkage_design.clearances`: beyond a joint's axis an arc about it.
"""

from __future__ import annotations

from functools import partial
from itertools import combinations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_sqrt
from kinematics.solve.clearance import find_separation
from studies.models.checks import Check
from studies.models.finger import PHALANGES, Finger, FingerMirror
from studies.models.linkage_design.judging import STEP_DEG
from studies.models.linkage_design.problem import grids

ANGLES = (19, 19)
"""Angles of PIP and of DIP at which the search looks: 5° apart over 90°."""


@partial(jax.jit, static_argnames="angles")
def find_clearances(
    finger: Finger, angles: tuple[int, int] = ANGLES
) -> dict[str, Float[Array, ""]]:
    """Least clearance of every mirror with its mount, mm; negative where it runs into something.

    Args:
        finger: with a camera.
        angles: how many of PIP and of DIP, over their ranges.

    Returns:
        By what people read: from the faces of its phalanx and from the layers on its pad (from the
        palmar face, if that is higher), from the camera's body, from the layers on the intermediate
        pad (from this pad, if it is bare), and from the other mirrors.
    """
    body, names = finger.body, finger.mirror_names
    ends = zip(("proximal", "distal"), body.flexions, angles, strict=True)
    turns = {name: jnp.linspace(0.0, end, count) for name, end, count in ends}
    top = body.palmar - body.protrusion
    if finger.layers is not None:
        top = top + jnp.sum(finger.layers.thickness)
    camera, middle = finger.camera_boxes(), _middle_pad(finger)
    outlines, found = {}, {}
    for name, mirror in zip(names, finger.mirrors, strict=True):
        own = _above_axes(finger, mirror)
        outlines[name] = mirror_outlines(finger, mirror, turns[mirror.phalanx])
        x, y = (own[:, 0] if mirror.phalanx == "distal" else -own[:, 0]), own[:, 1]
        height = jnp.where(x < 0, safe_sqrt(x * x + y * y), y)
        what, end = f"{name} mirror", "tip" if mirror.phalanx == "distal" else "rear end"
        length = body.distal if mirror.phalanx == "distal" else body.proximal
        found |= {
            f"{what} inside the dorsal face": body.dorsal - height,
            f"{what} inside the {end}": length - x,
            f"{what} above its pad": y - jnp.maximum(top, body.palmar),
            f"{what} from the camera": find_separation(outlines[name][:, None], camera),
            f"{what} from the intermediate pad": find_separation(outlines[name][:, None], middle),
        }
    for (one, first), (other, second) in combinations(zip(names, finger.mirrors, strict=True), 2):
        turned, beside = outlines[one], outlines[other]
        if first.phalanx == second.phalanx:
            turned, beside = turned[:1], beside[:1]
        apart = find_separation(turned[:, None], beside[None])
        found[f"{one} mirror from the {other} mirror"] = apart
    return {name: _least(values) for name, values in found.items()}


def _least(values: Float[Array, "..."]) -> Float[Array, ""]:
    """The least, with the slope of one of them."""
    return values.reshape(-1)[jnp.argmin(values)]


def _above_axes(finger: Finger, mirror: FingerMirror) -> Float[Array, "4 2"]:
    """Corners in the phalanx: from its joint's axis towards the tip, and up, mm."""
    corners = mirror.corners
    return jnp.stack([corners[:, 0], finger.body.dorsal - corners[:, 1]], axis=-1)


def mirror_outlines(
    finger: Finger, mirror: FingerMirror, angles: Float[Array, " angles"]
) -> Float[Array, "angles 4 2"]:
    """Corners of a mirror with its mount, seen from the intermediate phalanx, mm.

    Args:
        finger: whose mirror it is.
        mirror: on its proximal or distal phalanx.
        angles: flexion of this phalanx' joint, rad.
    """
    own, distal = _above_axes(finger, mirror), mirror.phalanx == "distal"
    # Bent, the outer end goes down: the distal phalanx turns clockwise, the proximal one does not.
    cosine, sine = jnp.cos(angles)[:, None], jnp.sin(angles)[:, None] * (-1 if distal else 1)
    x, y = own[None, :, 0], own[None, :, 1]
    axis = finger.body.intermediate if distal else jnp.zeros_like(finger.body.intermediate)
    return jnp.stack([axis + cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def _middle_pad(finger: Finger) -> Float[Array, "parts corners 2"]:
    """Layers of the intermediate pad as convex outlines, mm; the pad itself, if it is bare."""
    number = PHALANGES.index("intermediate")
    return finger.pads()[number][None] if finger.layers is None else layer_outlines(finger)[number]


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
