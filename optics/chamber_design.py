"""A chamber's file as the design that ``designopt explore`` and ``designopt export`` take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from designopt.designs import Design, DesignFile, Quantity
from designopt.export.sheet import Sheet
from optics.chamber.chamber import Chamber
from optics.chamber.file import read_chamber

if TYPE_CHECKING:
    from designopt.explore.bench import Bench


@dataclass(frozen=True)
class DesignedChamber(Design):
    """A chamber with its camera.

    Attributes:
        name: in titles and file names.
        chamber: its dimensions.
    """

    name: str
    chamber: Chamber

    @classmethod
    def read(cls, path: Path) -> DesignedChamber:
        """The design of a chamber's file; see `read_chamber`."""
        return cls(*read_chamber(path))

    def bench(self) -> Bench:
        """η, wall angles and lengths as knobs; the section and the image rings."""
        from optics.explore.chamber_bench import ChamberBench

        return ChamberBench(self)

    def sheet(self) -> Sheet:
        """The wall's section, region by region, on layers of their own."""
        from optics.export.chamber_sheet import chamber_sheet

        return chamber_sheet(self)

    def quantities(self) -> Sequence[Quantity]:
        """Every dimension, and the ratio that it is designed for."""
        from optics.export.chamber_sheet import chamber_quantities

        return chamber_quantities(self)


FILE = DesignFile("chamber", "chamber", DesignedChamber.read)
