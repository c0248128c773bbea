"""What lies between the parts of the linkage, and from them to the finger's outline, by posture.

The section of the bent finger is bounded by the palmar faces of the phalanges and, on the back, by
a line as far from the axes O-A-B-T as the dorsal faces: over a joint it is an arc about the axis.
(An argument of this project: the cheeks of the intermediate phalanx, which close the gap that
flexion opens between the faces, as paper B's fins and its cloth do, end in such arcs.) On the back
this section is convex, so a bar lies inside it where its pins do.

On the palmar side it is not: of a bent joint the palmar faces, which end where the pads do
(`finger_parts.Body.gaps`), enclose a corner, and a bar with pins beside both phalanges may cut it.
A bar with all pins beside one phalanx cannot. In the frame of this phalanx, a point of the
neighbour's face that is x from the axis and t above the palmar plane is −x sin r − (h − t) cos r
high when the joint is bent by r. That is at most t − h, as x is h tan r/2 or more (the least gap):
the neighbour's face stays below the inner side of its own, from which its pins keep away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.vectors import Vector
from kinematics.solve.clearance import find_separation
from studies.models.finger import Finger, links_of
from studies.models.finger_parts import Body
from studies.models.link_layers import Meeting, find_meetings
from studies.models.linkage_design.postures import Postures
from studies.models.links import AXLES, OUTLINES
from studies.models.pins import pin_name

FACES = {"proximal": "OA", "intermediate": "AB", "distal": "BT"}
"""The phalanges by the ends of their axes, which their palmar faces are parallel to."""

BESIDE = {"rod": "A", "plate": "B", "coupling": ""}
"""Bars with pins beside both phalanges of a joint, and its axle; of one beside both joints none."""


def name_of(meeting: Meeting) -> str:
    """What people read: the bar, and what it keeps from."""
    known = {"A": "the PIP axle", "B": "the DIP axle"}
    known |= {phalanx: f"the palmar face of the {phalanx} phalanx" for phalanx in FACES}
    kind = "the " if meeting.second in OUTLINES else "pin "
    return f"{meeting.first} from {known.get(meeting.second) or kind + pin_name(meeting.second)}"


def find_face_meetings(finger: Finger) -> list[Meeting]:
    """The bars beside a joint with all palmar faces, which are in every layer beside the pads."""
    bodies = {body for names in finger.joined().values() for body in names}
    return [Meeting(bar, phalanx) for bar in BESIDE if bar in bodies for phalanx in FACES]


def find_free_meetings(finger: Finger) -> list[Meeting]:
    """The parts that can meet and that nothing else keeps apart, which a search has to ask for.

    A palmar face is not among them where an axle crosses the bar's layer and leaves no room for the
    bar below it: in every posture the bar then passes the joint on the axle's dorsal side.

    Args:
        finger: with links; body and links are plain numbers.
    """
    links = links_of(finger)
    found = find_meetings(links, finger.joined())
    needed = float(links.axle_diameter) / 2 + float(links.bar_width) + float(links.shell)
    room = float(finger.body.axis_height) - needed
    held = {one for one in BESIDE.items() if room < 0} & {tuple(one) for one in found}
    faces = find_face_meetings(finger)
    return found + [one for one in faces if (one.first, BESIDE[one.first]) not in held]


def find_clearances(
    finger: Finger, places: Mapping[str, Vector], meetings: Sequence[Meeting]
) -> dict[str, Float[Array, "*batch"]]:
    """Clearances of parts, mm; negative where they run into each other.

    Args:
        finger: with links.
        places: of the pins, in one frame; for palmar faces also of O, A, B and T.
        meetings: of parts whose pins have places.
    """
    links, found = links_of(finger), {}
    for one in meetings:
        if one.second in FACES:
            second, radius = face_corners(places, one.second, finger), 0.0
        elif one.second in OUTLINES:
            second, radius = corners_of(places, OUTLINES[one.second]), links.bar_width / 2
        else:
            diameter = links.axle_diameter if one.second in AXLES else links.pin_diameter
            second, radius = corners_of(places, one.second), diameter / 2
        between = find_separation(corners_of(places, OUTLINES[one.first]), second)
        found[name_of(one)] = between - links.bar_width / 2 - radius
    return found


def face_corners(
    places: Mapping[str, Vector], phalanx: str, finger: Finger
) -> Float[Array, "*batch corners 2"]:
    """Corners of a palmar face in their order around it; it ends at joints where the pad does."""
    body, (pip, dip) = finger.body, finger.body.gaps
    low, high = body.palmar, body.palmar + links_of(finger).shell
    start, end = (places[name] for name in FACES[phalanx])
    line = end - start
    ahead = line.scaled(1 / line.length())
    zero = jnp.zeros_like(pip)
    gaps = {"proximal": (zero, pip), "intermediate": (pip, dip), "distal": (dip, zero)}[phalanx]
    left, right = gaps[0], line.length() - gaps[1]
    around = (left, low), (right, low), (right, high), (left, high)
    corners = [start + ahead.scaled(x) + ahead.perpendicular().scaled(y) for x, y in around]
    return jnp.stack([corner.stacked() for corner in corners], axis=-2)


def corners_of(places: Mapping[str, Vector], pins: str) -> Float[Array, "*batch corners 2"]:
    """Places of those of some pins that there are, as corners of one outline."""
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
    outer = postures.outer | {"O": Vector(-finger.body.proximal, zero)}
    turned = {
        name: place[None].turned(knuckle[:, None])
        if place.x.ndim
        else place.turned(knuckle[:, None])
        for name, place in inner.items()
    }
    rows, squares = [], []
    for one in meetings:
        pins = OUTLINES[one.first] + (OUTLINES | FACES).get(one.second, one.second)
        (rows if set(pins) <= set(inner) else squares).append(one)
    return find_clearances(finger, inner, rows) | find_clearances(finger, turned | outer, squares)


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
