"""The finger's section as plain numbers, from which the outlines of all parts follow.

Coordinates are those of the straight finger: PIP axis at the origin, x towards the tip, y to the
back, z across, 0 in the middle of the finger, mm. An outer phalanx is written in u, the distance
outwards from its own joint.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from designopt import UserError
from designopt.export.drawing import Place
from designopt.export.parts import Disc, Hole, Outline, Prism, polygon
from studies.models.finger import Finger, links_of
from studies.models.linkage_design.problem import pin_places
from studies.models.linkage_kinds import LinkageKind
from studies.models.links import AXLES
from studies.models.pins import pin_name

Outer = Literal["proximal", "distal"]

BESIDE_PADS, ACROSS = 1, -1
"""Layers of the outer phalanges' walls and of the intermediate phalanx's, of every linkage."""


@dataclass(frozen=True)
class Section:
    """What the parts have in common.

    Attributes:
        kind: of the linkage.
        pins: places of A, B and all pins.
        layers: inner and outer side of every layer of the linkage, |z|.
        shell: thickness of walls; also what is left around a hole in one.
        play: between parts that lie beside each other.
        pin: radius of the pins.
        axle: radius of the PIP and DIP axles.
        bar: half the width of bars.
        palmar, dorsal: heights of the faces.
        lengths: of the outer phalanges.
        middle: from PIP to DIP.
        gaps: from an outer phalanx's joint to the pads beside it.
        rim: from the outer pads to the ends of the finger.
        stack: thickness of the layers on a pad; that of a wall where pads are bare.
    """

    kind: LinkageKind
    pins: Mapping[str, Place]
    layers: tuple[tuple[float, float], ...]
    shell: float
    play: float
    pin: float
    axle: float
    bar: float
    palmar: float
    dorsal: float
    lengths: Mapping[Outer, float]
    middle: float
    gaps: Mapping[Outer, float]
    rim: float
    stack: float

    @classmethod
    def of(cls, finger: Finger) -> Section:
        """That of a finger.

        Raises:
            UserError: it has no pins or links, or the links lie in another order.
        """
        links, body = links_of(finger), finger.body
        usual = links.kind.layers
        if [set(one) for one in links.layers] != [set(one) for one in usual]:
            raise UserError(
                f"{finger.name}: parts are made for links in the order {usual}; correct 'layers' "
                "of [links]"
            )
        places = {name: (float(x), float(y)) for name, (x, y) in pin_places(finger).items()}
        shell = float(links.shell)
        stack = shell if finger.layers is None else float(np.sum(finger.layers.thickness))
        pip, dip = map(float, body.gaps)
        return cls(
            kind=links.kind,
            pins=places,
            layers=tuple((low, high) for low, high in np.asarray(links.edges).tolist()),
            shell=shell,
            play=float(links.play),
            pin=float(links.pin_diameter) / 2,
            axle=float(links.axle_diameter) / 2,
            bar=float(links.bar_width) / 2,
            palmar=float(body.palmar),
            dorsal=float(body.dorsal),
            lengths={"proximal": float(body.proximal), "distal": float(body.distal)},
            middle=float(body.intermediate),
            gaps={"proximal": pip, "distal": dip},
            rim=float(body.rim),
            stack=stack,
        )

    @property
    def half_width(self) -> float:
        """Of pads and mirrors, |z|."""
        return self.layers[0][1]

    @property
    def ceiling(self) -> float:
        """Height of the inner side of the back's wall."""
        return self.dorsal - self.shell

    @property
    def strip_top(self) -> float:
        """Height up to which LED strips lie beside the pads."""
        return self.palmar + self.stack + self.play

    @property
    def cheek(self) -> float:
        """Radius of the intermediate phalanx's walls about the joints: just beneath the back."""
        return self.ceiling - 2 * self.play

    def holes(self, pins: str) -> tuple[Hole, ...]:
        """Holes for those of some pins that the finger has."""
        return tuple(
            Hole(self.pins[pin], self.axle if pin in AXLES else self.pin, pin_name(pin))
            for pin in pins
            if pin in self.pins
        )

    def ring(self, pin: str) -> Disc:
        """What a wall needs around a pin."""
        [hole] = self.holes(pin)
        return (*hole.center, hole.radius + self.shell)

    def inward(self, phalanx: Outer, disc: Disc) -> Disc:
        """A disc of the finger in u."""
        x, y, radius = disc
        return (x - self.middle if phalanx == "distal" else -x), y, radius

    def outward(self, phalanx: Outer, *discs: Disc) -> list[Disc]:
        """Discs in u, counter-clockwise, as those of the finger, counter-clockwise again."""
        if phalanx == "distal":
            return [(self.middle + u, y, radius) for u, y, radius in discs]
        return [(-u, y, radius) for u, y, radius in reversed(discs)]

    def box(self, phalanx: Outer, near: float, far: float, low: float, high: float) -> Outline:
        """A rectangle between two places outwards from a joint and two heights."""
        [(start, *_), (end, *_)] = self.outward(phalanx, (near, 0.0, 0.0), (far, 0.0, 0.0))
        return rectangle(start, end, low, high)


def rectangle(start: float, end: float, low: float, high: float) -> Outline:
    """A rectangle between two x and two y."""
    return polygon((start, low), (end, low), (end, high), (start, high))


def sides(
    outline: Outline, low: float, high: float, holes: tuple[Hole, ...] = ()
) -> tuple[Prism, Prism]:
    """Prisms over an outline at both sides of the finger."""
    return Prism(outline, (low, high), holes), Prism(outline, (-high, -low), holes)


def through(outline: Outline, reach: float) -> Prism:
    """A prism over an outline from one side of the finger to the other."""
    return Prism(outline, (-reach, reach))
