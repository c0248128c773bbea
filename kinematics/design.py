"""A linkage file as the design that ``designopt explore`` and ``designopt export`` take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from designopt.designs import Design, DesignFile, Quantity
from designopt.export.sheet import Sheet
from kinematics.io.reading import build_linkage
from kinematics.io.sketch import Sketch, load_sketch
from kinematics.model.linkage import Linkage

if TYPE_CHECKING:
    from designopt.explore.bench import Bench


@dataclass(frozen=True)
class DesignedLinkage(Design):
    """A linkage and the sketch it was read from.

    Attributes:
        name: the linkage's.
        sketch: the file's content.
        linkage: the same, assembled.
    """

    name: str
    sketch: Sketch
    linkage: Linkage

    @classmethod
    def of(cls, sketch: Sketch, source: str) -> DesignedLinkage:
        """The design of a sketch; see `build_linkage`."""
        return cls(sketch.linkage.name, sketch, build_linkage(sketch, source))

    @classmethod
    def read(cls, path: Path) -> DesignedLinkage:
        """The design of a linkage file; see `read_linkage`."""
        return cls.of(load_sketch(path), str(path))

    def bench(self) -> Bench:
        """Inputs and lengths as knobs; pose, traced curves, margins, transmission angles."""
        from kinematics.explore.bench import LinkageBench

        return LinkageBench(self)

    def sheet(self) -> Sheet:
        """Every body on a layer of its own, pins as circles, in the sketched pose."""
        from kinematics.export.sheet import linkage_sheet

        return linkage_sheet(self)

    def quantities(self) -> Sequence[Quantity]:
        """Lengths, places, lines and springs."""
        from kinematics.export.sheet import linkage_quantities

        return linkage_quantities(self)

    def mjcf(self) -> str:
        """Bodies, hinges, slides, loop closures, springs and motors."""
        from kinematics.export.mjcf import linkage_mjcf

        return linkage_mjcf(self.linkage)


FILE = DesignFile("linkage", "joints", DesignedLinkage.read, "designopt solve")
