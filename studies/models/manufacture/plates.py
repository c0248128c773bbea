"""Flat parts of a finger: the bars of its linkage, its side walls, and the glass of its mirrors."""

from __future__ import annotations

from typing import NamedTuple

from designopt.export.parts import Hole, Outline, hull, polygon
from studies.models.finger import Finger
from studies.models.manufacture.phalanges import cheek, mirror_corners, side_wall
from studies.models.manufacture.section import Section


class Plate(NamedTuple):
    """An outline with holes in the section of the straight finger."""

    name: str
    outline: Outline
    holes: tuple[Hole, ...] = ()


def make_plates(finger: Finger) -> list[Plate]:
    """Bars, side walls of the phalanges, and mirrors.

    Args:
        finger: with pins and links.

    Example:
        >>> from studies.models import packaged_finger
        >>> [plate.name for plate in make_plates(packaged_finger())][:3]
        ['proximal wall', 'intermediate wall', 'distal wall']
    """
    section = Section.of(finger)
    walls = {
        "proximal": side_wall(section, "proximal"),
        "intermediate": cheek(section),
        "distal": side_wall(section, "distal"),
    }
    found = [
        Plate(f"{name} wall", outline, section.holes(section.kind.walls[name]))
        for name, outline in walls.items()
    ]
    for bar, pins in section.kind.outlines.items():
        holes = section.holes(pins)
        if len(holes) > 1:
            found.append(Plate(bar, bar_outline(section, bar), holes))
    glass = mirror_glass(finger)
    return found + [Plate(f"{name} mirror", outline) for name, outline in glass.items()]


def bar_outline(section: Section, bar: str) -> Outline:
    """Outline of a bar: round about its pins."""
    pins = (pin for pin in section.kind.outlines[bar] if pin in section.pins)
    return hull(*((*section.pins[pin], section.bar) for pin in pins))


def mirror_glass(finger: Finger) -> dict[str, Outline]:
    """Outlines of the mirrors with their mounts, by their names."""
    named = zip(finger.mirror_names, finger.mirrors, strict=True)
    return {name: polygon(*mirror_corners(finger, mirror)) for name, mirror in named}
