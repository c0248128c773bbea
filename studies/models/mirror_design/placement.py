"""What is free: where camera, mirrors and ends of layers are, and between which bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from studies.models.finger import Finger, camera_of
from studies.models.finger_parts import MOUNT, OUTWARD, FingerCamera, FingerMirror, Phalanx
from studies.models.mirror_design.clearances import ENDS
from studies.models.mirror_design.spec import CameraSpec, MirrorSpec

Placement = Finger
"""A finger of which only the places of camera and mirrors and the reaches of layers are left, also
as a bound or a scale; all other leaves are ``None``."""

Place = tuple[ArrayLike, ArrayLike, float]
Ends = Sequence[Sequence[ArrayLike]]

CARRIERS: tuple[Phalanx, ...] = ("distal", "proximal")
"""What carries the mirrors, unless settings have others."""

BETWEEN = 2.0
"""What mirrors that share a line leave between them, mm."""


def with_layout(
    finger: Finger,
    lens: CameraSpec,
    place: Place,
    lines: Mapping[Phalanx, Ends],
    phalanges: Sequence[Phalanx],
    mount: float,
) -> Finger:
    """A finger with a camera and mirrors.

    Args:
        finger: its own camera and mirrors are replaced.
        lens: the camera's settings.
        place: of the camera in its phalanx: along and depth of the pinhole, mm, and tilt, degrees;
            see `FingerCamera`.
        lines: ends of the mirror of each phalanx; several mirrors share its line, `BETWEEN` apart.
        phalanges: what carries the mirrors; those of one phalanx are in order from the joint.
        mount: thickness of each, mm.
    """
    mirrors = []
    for number, phalanx in enumerate(phalanges):
        own, count = _rank(phalanges, number)
        start, end = (jnp.asarray(one, float) for one in lines[phalanx])
        margin = BETWEEN / 2 / jnp.linalg.norm(end - start)
        near = own / count + (margin if own else 0.0)
        far = (own + 1) / count - (margin if own + 1 < count else 0.0)
        ends = jnp.stack([(1 - part) * start + part * end for part in (near, far)])
        mirrors.append(FingerMirror(ends, phalanx, mount))
    return replace(finger, camera=FingerCamera.of(lens, *place), mirrors=tuple(mirrors))


def hosts(finger: Finger) -> tuple[Phalanx, ...]:
    """What carries each mirror."""
    return tuple(mirror.phalanx for mirror in finger.mirrors)


def _rank(phalanges: Sequence[Phalanx], number: int) -> tuple[int, int]:
    """Of a mirror among those of its phalanx, and how many these are."""
    host = phalanges[number]
    return list(phalanges[:number]).count(host), list(phalanges).count(host)


def reference_layout(
    finger: Finger,
    lens: CameraSpec,
    phalanges: Sequence[Phalanx] = CARRIERS,
    mount: float = MOUNT,
) -> Finger:
    """The layout that an earlier, independent search with errors found for T = 25, h = 4 mm.

    Its camera is in the intermediate phalanx, and its mirrors are in the outer ones.
    """
    lines: dict[Phalanx, Ends] = {
        "distal": [[0.24, 1.96], [30.81, 20.66]],
        "proximal": [[4.16, 2.5], [-28.35, 11.7]],
    }
    return with_layout(finger, lens, (15.75, 4.01, -6.3), lines, phalanges, mount)


def poor_layout(
    finger: Finger,
    lens: CameraSpec,
    phalanges: Sequence[Phalanx] = CARRIERS,
    mount: float = MOUNT,
) -> Finger:
    """Where the search begins on purpose: mirrors along the back of the finger, which show little.

    The camera sits 5 mm over the palmar face amid its phalanx and looks straight at it.
    """
    body = finger.body
    host: Phalanx = lens.phalanx
    place = (OUTWARD[host] * getattr(body, host) / 2, body.thickness - 5, 0.0)
    lines: dict[Phalanx, Ends] = {
        "distal": [[2.0, 2.0], [body.distal - 4, 2.0]],
        "proximal": [[-2.0, 2.0], [4 - body.proximal, 2.0]],
        "intermediate": [[2.0, 2.0], [body.intermediate - 2, 2.0]],
    }
    return with_layout(finger, lens, place, lines, phalanges, mount)


def free_part(finger: Finger) -> Placement:
    """What is free alone; ``equinox.combine(part, finger)`` puts other numbers in."""
    nothing = jax.tree.map(lambda _: False, finger)
    free = partial(_free, mirrors=len(finger.mirrors))
    return eqx.filter(finger, eqx.tree_at(free, nothing, replace_fn=lambda _: True))


def _free(finger: Finger, mirrors: int) -> list[Any]:
    camera = finger.camera
    assert camera is not None  # a layout has one
    # Counted, for `equinox.tree_at` has something else in the place of no mirrors.
    ends = [finger.mirrors[number].ends for number in range(mirrors)]
    places = camera.along, camera.depth, camera.tilt, *ends
    layers = finger.layers
    return [*places, *([] if layers is None else [layers.reach, layers.outer_reach])]


def _placement(
    finger: Finger, place: Place, mirrors: Sequence[Ends | Float[Array, "2 2"]], reach: float
) -> Placement:
    parts = [jnp.asarray(part, float) for part in (*place, *mirrors)]
    if finger.layers is not None:
        parts += [jnp.full_like(finger.layers.reach, reach)] * 2
    return eqx.tree_at(partial(_free, mirrors=len(mirrors)), free_part(finger), parts)


def bounds(finger: Finger, spec: MirrorSpec) -> tuple[Placement, Placement]:
    """Least and greatest values of everything that is free: inside its phalanx.

    The camera's body lies over its phalanx and no more than its length below the dorsal face. A
    mirror's ends keep the clearance from the layers (the palmar plane, if there are none), the
    dorsal face and the end wall. One end lies in the half next to the joint, and may reach beyond
    the joint's axis by the overhang (the reference layout's proximal mirror does so by 4.16 mm: the
    cheeks that carry it enclose the joint), the other in the far half, which in the intermediate
    phalanx ends at a joint likewise; n mirrors on one phalanx divide it in this way, at 1/2n, 3/2n,
    … of its length. That mirrors with their mounts stay inside and keep away from all else are
    inequalities (`clearances`), and that the camera's body stays inside the wall of the back,
    however it is tilted, is so by construction (`problem.put_in`). Reaches of layers are shares of
    what is free; those of layers that end at the membrane stay 0.

    Returns:
        The least and the greatest placement, mm and rad.
    """
    body, clear, over = finger.body, spec.room.clearance, spec.room.overhang
    half, phalanges = spec.camera.width / 2, hosts(finger)

    def along(phalanx: Phalanx, ends: Sequence[ArrayLike]) -> Float[Array, " ends"]:
        """Places so far outwards from a phalanx's joint, in order towards the tip."""
        return jnp.sort(OUTWARD[phalanx] * jnp.stack([jnp.asarray(one, float) for one in ends]))

    low, room = clear, body.thickness + body.protrusion
    if finger.layers is not None:
        room = room - jnp.sum(finger.layers.thickness)
    high = jnp.minimum(room, body.thickness) - clear
    least, greatest = [], []
    for number, phalanx in enumerate(phalanges):
        own, count = _rank(phalanges, number)
        length: Any = getattr(body, phalanx)
        inner = [(2 * i + 1) / (2 * count) * length for i in range(count)]
        cuts = (-over, *inner, length - clear if phalanx in ENDS else length + over)
        cells = jnp.stack([along(phalanx, cuts[own + end : own + end + 2]) for end in (0, 1)])
        for found, side, depth in ((least, 0, low), (greatest, 1, high)):
            found.append(jnp.stack([cells[:, side], jnp.full(2, depth)], axis=-1))
    host = camera_of(finger).phalanx
    first, last = along(host, (half, getattr(body, host) - half))
    lowest = _placement(finger, (first, spec.camera.depth, -0.6), least, 0.0)
    highest = last, high - clear, 0.6
    return lowest, _placement(finger, highest, greatest, float(spec.pads.reach == "free"))


def scale(finger: Finger) -> Placement:
    """A change of each number that matters about as much as that of the others.

    1 mm, 0.1 rad, and a third of what is free for a layer.
    """
    ones = [jnp.ones((2, 2))] * len(finger.mirrors)
    return _placement(finger, (1.0, 1.0, 0.1), ones, 1 / 3)
