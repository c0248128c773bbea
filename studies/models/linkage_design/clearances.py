"""What lies between the parts of the linkage, and from them to the finger's outline, by posture.

The section of the bent finger is bounded by the palmar faces of the phalanges and, on the back, by
a line as far from the axes O-A-B-T as the dorsal faces: over a joint it is an arc about the axis.
(An argument of this project: the cheeks of the intermediate phalanx, which close the gap that
flexion opens between the faces, as paper B's fins and its cloth do, end in such arcs.) On the back
this section is convex, so a bar lies inside it where its pins do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.vectors import Vector
from kinematics.solve.clearance import find_separation
from studies.models.finger import Body, Finger, links_of
from studies.models.link_layers import Meeting
from studies.models.linkage_design.postures import Postures
from studies.models.links import OUTLINES

HOSTS = {
    "F": "proximal",
    "E": "proximal",
    "D": "intermediate",
    "G": "intermediate",
    "H": "intermediate",
    "C": "distal",
    "K": "proximal",
}
"""The phalanx beside which a pin lies, in whose frame it is looked at. (An argument from their
motions: F, G and C are fixed there, E and K swing beside the proximal phalanx, D and G' beside the
intermediate one.)"""


def name_of(meeting: Meeting) -> str:
    """What people read: the bar, and what it keeps from."""
    axle = {"A": "the PIP axle", "B": "the DIP axle"}
    return f"{meeting.first} from {axle.get(meeting.second, 'the ' + meeting.second)}"


def find_clearances(
    finger: Finger, places: Mapping[str, Vector], meetings: Sequence[Meeting]
) -> dict[str, Float[Array, "*batch"]]:
    """Clearances of parts, mm; negative where they run into each other.

    Args:
        finger: with links.
        places: of the pins, in one frame.
        meetings: of parts whose pins have places.
    """
    links, found = links_of(finger), {}
    for one in meetings:
        second, radius = OUTLINES.get(one.second), links.bar_width / 2
        if second is None:
            second, radius = one.second, links.axle_diameter / 2
        between = find_separation(_corners(places, OUTLINES[one.first]), _corners(places, second))
        found[name_of(one)] = between - links.bar_width / 2 - radius
    return found


def _corners(places: Mapping[str, Vector], pins: str) -> Float[Array, "*batch corners 2"]:
    at = [places[pin] for pin in pins if pin in places]
    shape = jnp.broadcast_shapes(*(place.x.shape for place in at))
    return jnp.stack([jnp.broadcast_to(one.stacked(), (*shape, 2)) for one in at], axis=-2)


def clearances_at(
    finger: Finger, postures: Postures, knuckle: Vector, meetings: Sequence[Meeting]
) -> dict[str, Float[Array, "..."]]:
    """`find_clearances` in postures; what DIP alone decides is a row.

    Args:
        finger: with pins and links.
        postures: its own.
        knuckle: turns of the intermediate phalanx, one per PIP angle.
        meetings: of parts.
    """
    zero = jnp.zeros_like(finger.body.intermediate)
    axles = {"A": Vector(zero, zero), "B": Vector(finger.body.intermediate, zero)}
    inner = postures.inner | axles
    turned = {
        name: place[None].turned(knuckle[:, None])
        if place.x.ndim
        else place.turned(knuckle[:, None])
        for name, place in inner.items()
    }
    rows, squares = [], []
    for one in meetings:
        pins = OUTLINES[one.first] + OUTLINES.get(one.second, one.second)
        (rows if set(pins) <= set(inner) else squares).append(one)
    return find_clearances(finger, inner, rows) | find_clearances(
        finger, turned | postures.outer, squares
    )


def faces_of(place: Vector, host: str, body: Body) -> dict[str, Float[Array, "..."]]:
    """Distances of a pin from the faces of the finger, and from the end that is the finger's, mm.

    That from the back is the least over all angles of the joint beyond which the pin may lie.

    Apart, not in one array: compiled into one, each element would trace the pin anew, and the
    derivatives take a hundred times as long.
    """
    height = place.y
    if host == "proximal":
        height = jnp.where(place.x > 0, place.length(), height)
    else:
        height = jnp.where(place.x < 0, place.length(), height)
    if host == "intermediate":
        over_b = Vector(place.x - body.intermediate, place.y)
        height = jnp.where(over_b.x > 0, over_b.length(), height)
    found = {"palmar face": place.y - body.palmar, "dorsal face": body.dorsal - height}
    if host == "proximal":
        found["rear end"] = place.x + body.proximal
    if host == "distal":
        found["tip"] = body.distal - place.x
    return found
