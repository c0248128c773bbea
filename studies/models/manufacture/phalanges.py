"""The three phalanges as solids: walls, seats of pads and mirrors, pocket of the camera.

Each is one piece. The outer ones are troughs: the back, the end, and a wall at either side of the
pads, which holds PIP or DIP axle and the linkage's pins. The intermediate one has its walls outside
the linkage: cheeks that close both joints at any angle. Ledges reach from the walls inwards as far
as the LED strips, which lie beside the pads; between the ends of strips, posts hold the pads. A
mirror lies on two rails behind it, in the intermediate phalanx on two ribs of its back; the camera
lies in a bridge that has its own outline. So nothing stands where light passes.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from designopt.export.parts import Disc, Outline, Part, Prism, around, circle, polygon, wrapped
from studies.models.finger import Finger, camera_of
from studies.models.finger_parts import AXES, OUTWARD, FingerMirror, Phalanx
from studies.models.links import AXLES
from studies.models.manufacture.section import (
    ACROSS,
    BESIDE_PADS,
    Outer,
    Section,
    rectangle,
    sides,
    through,
)

POST, SEAT, STEP = 1.5, 1.5, 1.0
"""Length of the posts that hold a pad, width of a mirror's rails, and where walls begin beyond a
joint's axis, mm."""

SWEEP = 0.3
"""What the outer phalanges leave to the cheeks that turn beside them, mm."""

COLORS = {"proximal": "#5B7DB1", "intermediate": "#C9A24B", "distal": "#5FA38A"}


def make_phalanges(finger: Finger) -> list[Part]:
    """The three phalanges, printed in one piece each.

    Args:
        finger: with pins and links; with a camera where it has mirrors.
    """
    section = Section.of(finger)
    shells = {
        "proximal": _outer(section, "proximal", finger),
        "intermediate": _middle(section, finger),
        "distal": _outer(section, "distal", finger),
    }
    return [
        Part(
            f"{name} phalanx",
            f"{name} phalanx",
            name,
            "printed polyamide PA12, black",
            "see STEP",
            tuple(prisms),
            tuple(_drilled(section, name)),
            COLORS[name],
            shell=True,
        )
        for name, prisms in shells.items()
    ]


def side_wall(section: Section, phalanx: Outer) -> Outline:
    """Outline of an outer phalanx's walls beside the pads, with an ear for the motor's axis."""
    length, low, gap = section.lengths[phalanx], section.strip_top, section.gaps[phalanx]
    pins = [pin for pin in section.kind.walls[phalanx] if pin in section.pins]
    rings = {pin: section.inward(phalanx, section.ring(pin)) for pin in pins}
    motor, others = rings.pop("M", None), sorted(rings.values())
    # Before the pad the wall reaches round the axle and the pins about it.
    near = [ring for ring in others if ring[0] - ring[2] < gap]
    begin = max([gap, *(u + radius for u, y, radius in near if y - radius < low)])
    corner, top = (length, low, 0.0), (length, section.ceiling, 0.0)
    above, foremost = (begin, section.ceiling, 0.0), (begin, low, 0.0)
    near = 2 * wrapped(above, (STEP, section.ceiling, 0.0), *near, foremost)
    first = near.index(above) + 1
    discs = [corner, top, *near[first : near.index(foremost, first) + 1]]
    for u, y, radius in others:
        if y - radius < low < y + radius and gap < u - radius and u + radius < length - POST:
            # The post below it is part of the wall.
            discs += [(u - radius, low, 0.0), (u, y, radius), (u + radius, low, 0.0)]
    if motor is not None:
        u, y, radius = motor
        ear = [(u, y, radius), (length, y + radius, 0.0)]
        foot = [(length, low, 0.0), (length, y - radius, 0.0)]
        if y - radius < low:
            foot = [(length - POST, low, 0.0), (length - POST, y - radius, 0.0)]
        discs = [*foot, *ear, *discs[1:]]
    return around(*section.outward(phalanx, *discs))


def cheek(section: Section) -> Outline:
    """Outline of the intermediate phalanx's walls: between the joints, and quarters about these."""
    middle, radius = section.middle, section.cheek
    rear, front = (-radius, -STEP / 2, 0.0), (middle + radius, -STEP / 2, 0.0)
    below = 2 * wrapped(rear, *_below_cheek(section), front)
    first = below.index(rear)
    return around(
        *below[first : below.index(front, first) + 1],
        (middle, 0.0, radius),
        (middle - STEP, radius, 0.0),
        (middle - STEP, section.ceiling, 0.0),
        (STEP, section.ceiling, 0.0),
        (STEP, radius, 0.0),
        (0.0, 0.0, radius),
    )


def _below_cheek(section: Section) -> list[Disc]:
    """What the intermediate phalanx's walls enclose below the joints: ends of the pad, pins."""
    (pip, dip), middle = section.gaps.values(), section.middle
    pad = (pip, section.palmar, 0.0), (middle - dip, section.palmar, 0.0)
    return [*pad, *(section.ring(pin) for pin in section.kind.walls["intermediate"])]


def _beyond_cheek(section: Section, phalanx: Outer) -> float:
    """Where an outer phalanx's ledge begins, u: at its pad, or where the cheek leaves room above.

    The cheek's lower edge rises outwards from what it encloses to its end. Bent, it is higher.
    """
    end, height = section.cheek, -STEP / 2
    slope = 0.0
    for u, y, radius in (section.inward(phalanx, disc) for disc in _below_cheek(section)):
        away = np.hypot(end - u, height - y)
        angle = np.arctan2(height - y, end - u) + np.arcsin(radius / away)
        slope = max(slope, float(np.tan(angle)))
    room = height - (section.palmar + section.shell + SWEEP)
    return max(section.gaps[phalanx], end - room / slope)


def strip_spans(section: Section, phalanx: Phalanx) -> list[tuple[float, float]]:
    """Where the LED strips beside a pad begin and end, x: between the posts."""
    posts, found = _posts(section, phalanx), []
    for (_, end), (start, _) in itertools.pairwise(posts):
        if start - end > 2 * section.play:
            found.append((end + section.play, start - section.play))
    return found


def _posts(section: Section, phalanx: Phalanx) -> list[tuple[float, float]]:
    """Where posts stand beside a pad, x, in order: at its ends, and where a pin lies low."""
    (pip, dip), middle = section.gaps.values(), section.middle
    if phalanx == "intermediate":
        start, end = pip, middle - dip
        return [(start, start + POST), (end - POST, end)]
    length, rim = section.lengths[phalanx], section.rim
    if phalanx == "proximal":
        start, end = -length, -pip
        posts = [(start, start + rim + POST), (end - POST, end)]
    else:
        start, end = middle + dip, middle + length
        posts = [(start, start + POST), (end - rim - POST, end)]
    for pin in section.kind.walls[phalanx]:
        if pin in section.pins and pin not in (*AXLES, "M"):
            x, y, radius = section.ring(pin)
            if y - radius < section.strip_top and start < x + radius and x - radius < end:
                posts.append((max(x - radius, start), min(x + radius, end)))
    return _merged(sorted(posts), POST)


def _merged(spans: Sequence[tuple[float, float]], least: float) -> list[tuple[float, float]]:
    """Spans in order, those that less than a length lies between as one."""
    found: list[tuple[float, float]] = []
    for start, end in spans:
        if found and start - found[-1][1] < least:
            found[-1] = found[-1][0], max(end, found[-1][1])
        else:
            found.append((start, end))
    return found


def _outer(section: Section, phalanx: Outer, finger: Finger) -> list[Prism]:
    length, shell = section.lengths[phalanx], section.shell
    (inner, outer), widest = section.layers[BESIDE_PADS], section.layers[ACROSS][1]
    low, palmar, dorsal = section.strip_top, section.palmar, section.dorsal
    ledge = section.box(phalanx, _beyond_cheek(section, phalanx), length, palmar, palmar + shell)
    end = section.box(phalanx, length - shell, length, low, dorsal)
    found = [
        *sides(
            side_wall(section, phalanx), inner, outer, section.holes(section.kind.walls[phalanx])
        ),
        through(section.box(phalanx, section.play, length, section.ceiling, dorsal), widest),
        through(end, widest if phalanx == "distal" else outer),
        *sides(ledge, outer, widest),
    ]
    for start, stop in _posts(section, phalanx):
        found += sides(rectangle(start, stop, palmar, low + shell), inner, outer)
    if phalanx == "distal":
        found += sides(section.box(phalanx, length - shell, length, palmar, low), inner, widest)
    begin = section.cheek + SWEEP
    if length - begin > shell:
        cover = section.box(phalanx, begin, length, palmar, dorsal)
        found += sides(cover, section.layers[ACROSS][0], widest)
    for mirror in finger.mirrors:
        if mirror.phalanx == phalanx:
            rail = _rail(section, finger, mirror)
            found += sides(rail, section.half_width - SEAT, outer)
    return found + _camera_seat(section, finger, phalanx)


def _camera_seat(section: Section, finger: Finger, phalanx: Phalanx) -> list[Prism]:
    """A bridge with the camera's own outline at both its sides, and what it hangs on."""
    if finger.camera is None or finger.camera.phalanx != phalanx:
        return []
    half = camera_half_width(finger) + section.play
    found = [through(_pedestal(section, finger), section.half_width)]
    for box in camera_outlines(finger):
        found += sides(box, half, section.half_width)
    return found


def _rail(section: Section, finger: Finger, mirror: FingerMirror) -> Outline:
    """Behind a mirror's mount, from its outer end to where its own wall begins at the joint."""
    near, _, behind_far, behind_near = mirror_corners(finger, mirror)
    behind = section.shell * (behind_near - near) / np.hypot(*(behind_near - near))
    wall = section.pins[AXES[mirror.phalanx]][0] + STEP * OUTWARD[mirror.phalanx]
    share = (wall - behind_near[0]) / (behind_far[0] - behind_near[0])
    start = behind_near + max(0.0, share) * (behind_far - behind_near)
    return polygon(start, behind_far, behind_far + behind, start + behind)


def _rib(section: Section, finger: Finger, mirror: FingerMirror) -> Outline:
    """Between the mount of a mirror in the intermediate phalanx and the back, on which it hangs."""
    return _hung(section, mirror_corners(finger, mirror)[2:])


def _hung(section: Section, places: np.ndarray) -> Outline:
    """From places up into the wall of the back."""
    top = section.ceiling + section.shell / 2
    return polygon(*places, *((x, top) for x, _ in places))


def mirror_corners(finger: Finger, mirror: FingerMirror) -> np.ndarray:
    """Corners of a mirror with its mount, in the order of `FingerMirror.corners`, mm."""
    return np.asarray(finger.body.place(mirror.phalanx, mirror.corners), float)


def _middle(section: Section, finger: Finger) -> list[Prism]:
    (pip, dip), middle, palmar = section.gaps.values(), section.middle, section.palmar
    (inner, outer), (within, widest) = section.layers[BESIDE_PADS], section.layers[ACROSS]
    play, shell = section.play, section.shell
    ledge = rectangle(pip, middle - dip, palmar, palmar + shell)
    found = [
        *sides(cheek(section), within, widest, section.holes(section.kind.walls["intermediate"])),
        through(rectangle(play, middle - play, section.ceiling, section.dorsal), widest),
        *sides(ledge, outer, widest),
    ]
    for start, stop in _posts(section, "intermediate"):
        found += sides(rectangle(start, stop, palmar, palmar + section.stack), inner, outer)
    for mirror in finger.mirrors:
        if mirror.phalanx == "intermediate":
            rib = _rib(section, finger, mirror)
            found += sides(rib, section.half_width - SEAT, section.half_width)
    return found + _camera_seat(section, finger, "intermediate")


def camera_outlines(finger: Finger) -> list[Outline]:
    """The camera's body in the section, as convex outlines."""
    return [polygon(*corners) for corners in np.asarray(finger.camera_boxes(), float)]


def camera_half_width(finger: Finger) -> float:
    """Of the camera's body across the section: half its board, or half its width, mm."""
    camera = camera_of(finger)
    return float(camera.width if camera.module is None else camera.module.board[1]) / 2


def _pedestal(section: Section, finger: Finger) -> Outline:
    """Between the back of the camera's body and the back of the finger."""
    tilt = float(camera_of(finger).tilt)
    corners = np.asarray(finger.camera_boxes(), float).reshape(-1, 2)
    heights = corners @ [-np.sin(tilt), np.cos(tilt)]
    return _hung(section, corners[heights > np.max(heights) - 1e-6])


def _drilled(section: Section, phalanx: str) -> list[Prism]:
    """The walls' holes through all that these are joined with."""
    layer = ACROSS if phalanx == "intermediate" else BESIDE_PADS
    low, high = section.layers[layer]
    spare, found = section.play / 2, []
    for hole in section.holes(section.kind.walls[phalanx]):
        found += sides(circle(*hole.center, hole.radius), low - spare, high + spare)
    return found
