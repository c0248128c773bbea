"""A chamber with its name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from optics.chamber.chamber import Chamber
from optics.chamber.file import read_chamber


@dataclass(frozen=True)
class DesignedChamber:
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
