"""What is free: where camera, mirrors and ends of layers are, and between which bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from studies.models.finger import Finger, FingerCamera, FingerMirror, Phalanx
from studies.models.mirror_design.spec import CameraSpec, MirrorSpec

Placement = Finger
"""A finger of which only the places of camera and mirrors and the reaches of layers are left, also
as a bound or a scale; all other leaves are ``None``."""

Place = tuple[ArrayLike, ArrayLike, float]
Ends = Sequence[Sequence[ArrayLike]]

DISTAL, PROXIMAL = 0, 1
"""The order of the mirrors."""


def with_layout(
    finger: Finger, lens: CameraSpec, place: Place, distal: Ends, proximal: Ends
) -> Finger:
    """A finger with a camera and two mirrors.

    Args:
        finger: its own camera and mirrors are replaced.
        lens: the camera's settings.
        place: of the camera: along from the PIP axis and depth of the pinhole, mm, and tilt,
            degrees; see `FingerCamera`.
        distal: ends of the mirror; see `FingerMirror`.
        proximal: ends of the other.
    """
    ends: dict[Phalanx, Ends] = {"distal": distal, "proximal": proximal}
    mirrors = tuple(FingerMirror(jnp.asarray(own), phalanx) for phalanx, own in ends.items())
    return replace(finger, camera=FingerCamera.of(lens, *place), mirrors=mirrors)


def reference_layout(finger: Finger, lens: CameraSpec) -> Finger:
    """The layout that an earlier, independent search with errors found for T = 25, h = 4 mm."""
    distal, proximal = [[0.24, 1.96], [30.81, 20.66]], [[4.16, 2.5], [-28.35, 11.7]]
    return with_layout(finger, lens, (15.75, 4.01, -6.3), distal, proximal)


def poor_layout(finger: Finger, lens: CameraSpec) -> Finger:
    """Where the search begins on purpose: mirrors along the back of the finger, which show little.

    The camera sits 5 mm over the middle of the intermediate pad and looks straight at it.
    """
    body = finger.body
    place = (body.intermediate / 2, body.thickness - 5, 0.0)
    distal = [[2.0, 2.0], [body.distal - 4, 2.0]]
    return with_layout(finger, lens, place, distal, [[-2.0, 2.0], [4 - body.proximal, 2.0]])


def free_part(finger: Finger) -> Placement:
    """What is free alone; ``equinox.combine(part, finger)`` puts other numbers in."""
    nothing = jax.tree.map(lambda _: False, finger)
    return eqx.filter(finger, eqx.tree_at(_free, nothing, replace_fn=lambda _: True))


def _free(finger: Finger) -> list[Any]:
    camera = finger.camera
    assert camera is not None  # a layout has one
    places = camera.along, camera.depth, camera.tilt, *(mirror.ends for mirror in finger.mirrors)
    layers = finger.layers
    return [*places, *([] if layers is None else [layers.reach, layers.outer_reach])]


def _placement(
    finger: Finger, place: Place, distal: Ends, proximal: Ends, reach: float
) -> Placement:
    parts = [jnp.asarray(part, float) for part in (*place, distal, proximal)]
    if finger.layers is not None:
        parts += [jnp.full_like(finger.layers.reach, reach)] * 2
    return eqx.tree_at(_free, free_part(finger), parts)


def bounds(finger: Finger, spec: MirrorSpec) -> tuple[Placement, Placement]:
    """Least and greatest values of everything that is free: inside its phalanx.

    The camera's body lies over the intermediate phalanx and no more than its length below the
    dorsal face. A mirror's ends keep the clearance from the layers (the palmar plane, if there are
    none), the dorsal face and the end wall. One end lies in the half next to the joint, and may
    reach beyond the joint's axis by the overhang (the reference layout's proximal mirror does so by
    4.16 mm: the cheeks that carry it enclose the joint), the other in the far half. That the
    overhanging ends keep away from the camera's body is an inequality (`problem.clearances`), and
    that this stays inside the dorsal face, however it is tilted, is so by construction
    (`problem.put_in`). Reaches of layers are shares of what is free; those of
    layers that end at the membrane stay 0.

    Returns:
        The least and the greatest placement, mm and rad.
    """
    body, clear, over = finger.body, spec.room.clearance, spec.room.overhang
    half, outer, inner = spec.camera.width / 2, body.distal, body.proximal
    low, room = clear, body.thickness + body.protrusion
    if finger.layers is not None:
        room = room - jnp.sum(finger.layers.thickness)
    high = jnp.minimum(room, body.thickness) - clear
    camera = (half, spec.camera.depth, -0.6)
    distal = [[-over, low], [outer / 2, low]]
    ends = [[-inner / 2, low], [clear - inner, low]]
    least = _placement(finger, camera, distal, ends, 0.0)
    camera = (body.intermediate - half, high - clear, 0.6)
    distal = [[outer / 2, high], [outer - clear, high]]
    ends, reach = [[over, high], [-inner / 2, high]], float(spec.pads.reach == "free")
    return least, _placement(finger, camera, distal, ends, reach)


def scale(finger: Finger) -> Placement:
    """A change of each number that matters about as much as that of the others.

    1 mm, 0.1 rad, and a third of what is free for a layer.
    """
    ones = [[1.0, 1.0], [1.0, 1.0]]
    return _placement(finger, (1.0, 1.0, 0.1), ones, ones, 1 / 3)
