"""A linkage together with the sketch it was read from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from kinematics.io.reading import build_linkage
from kinematics.io.sketch import Sketch, load_sketch
from kinematics.model.linkage import Linkage


@dataclass(frozen=True)
class DesignedLinkage:
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
