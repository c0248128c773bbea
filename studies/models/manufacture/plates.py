"""Flat parts of a finger: the bars of its linkage, its side walls, and the glass of its mirrors."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from designopt.export.drawing import Place
from designopt.export.parts import Outline, hull
from studies.models.finger import Finger
from studies.models.links import AXLES, BARS, OUTLINES, WALLS
from studies.models.manufacture.phalanges import cheek, side_wall
from studies.models.manufacture.section import Section
from studies.models.mirror_design.clearances import mirror_outlines
from studies.models.pins import pin_name


class PlateHole(NamedTuple):
    """A hole of a plate, by the pin in it."""

    name: str
    center: Place
    radius: float


class Plate(NamedTuple):
    """An outline with holes in the section of the straight finger."""

    name: str
    outline: Outline
    holes: list[PlateHole]


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
        Plate(f"{name} wall", outline, holes_for(section, WALLS[name]))
        for name, outline in walls.items()
    ]
    for bar in BARS:
        holes = holes_for(section, OUTLINES[bar])
        if len(holes) > 1:
            found.append(Plate(bar, bar_outline(section, bar), holes))
    glass = mirror_glass(finger)
    return found + [Plate(f"{name} mirror", outline, []) for name, outline in glass.items()]


def bar_outline(section: Section, bar: str) -> Outline:
    """Outline of a bar: round about its pins."""
    return hull(
        *((*section.pins[pin], section.bar) for pin in OUTLINES[bar] if pin in section.pins)
    )


def holes_for(section: Section, pins: str) -> list[PlateHole]:
    """Holes for those of some pins that the finger has."""
    return [
        PlateHole(pin_name(pin), section.pins[pin], section.axle if pin in AXLES else section.pin)
        for pin in pins
        if pin in section.pins
    ]


def mirror_glass(finger: Finger) -> dict[str, Outline]:
    """Outlines of the mirrors with their mounts, by their names."""
    found = {}
    for name, mirror in zip(finger.mirror_names, finger.mirrors, strict=True):
        corners = np.asarray(mirror_outlines(finger, mirror, jnp.zeros(1))[0], float)
        found[name] = hull(*((x, y, 0.0) for x, y in corners.tolist()))
    return found
