"""The file a person writes: joints near the wanted assembly, bodies, sliders, inputs, springs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import pydantic

from designopt.design_kind import read_tables
from designopt.io.spec import Spec
from designopt.io.spec_files import (
    FORMAT,
    Format,
    Length,
    Line,
    Name,
    Number,
    Point,
    Title,
    validated,
)


class LinkageTable(Spec):
    """``[linkage]``."""

    name: Title = "linkage"
    """Its name, in titles and file names."""
    format: Format = FORMAT
    """Version of the file's format."""


def _some(joints: list[str]) -> list[str]:
    if not joints:
        raise ValueError("a body needs a joint; add one")
    return joints


class BodyTable(Spec):
    """``[bodies.NAME]``: a rigid body, by its joints; exact lengths replace the sketch's."""

    joints: Annotated[list[Name], pydantic.AfterValidator(_some)]
    """The joints that it holds; the angle of a body is that of its first to its second joint."""
    lengths: dict[str, Length] = pydantic.Field(default_factory=dict)
    """Exact lengths by pairs of its joints, such as ``{ A-B = 120 }``, mm. Others are the sketch's.
    """
    fixed: pydantic.StrictBool = False
    """Whether it stands still; at least one body does."""


class SliderTable(Spec):
    """``[[sliders]]``: a joint slides along a line that is fixed in a body.

    A point of the line that is drawn at a joint of that body stays at that joint when exact
    lengths move it. With ``keeps``, a body that holds the joint, that body slides without turning
    (a prismatic joint); without, the joint is a pin in a slot.
    """

    joint: Name
    """The joint that slides."""
    on: Name
    """The body in which the line is fixed."""
    line: Line
    """Two points of the line, near the wanted assembly, mm."""
    keeps: Name | None = None
    """A body of that joint that slides without turning."""


class InputTable(Spec):
    """``[[inputs]]``: the angle of a body relative to another, or the place of a slider."""

    name: Name
    """By which commands name it."""
    body: Name | None = None
    """The body whose angle is driven."""
    slider: Name | None = None
    """The joint whose place along its line is driven, instead of an angle; mm."""
    relative_to: Name | None = None
    """The body against which the angle counts; the fixed axes, ``"world"``, by default."""


class SpringTable(Spec):
    """``[[springs]]``: a torsion spring between two bodies, N mm/rad and rad."""

    between: tuple[Name, Name]
    """The two bodies."""
    stiffness: Annotated[Number, pydantic.Field(ge=0)]
    """N mm/rad."""
    preload: Number = 0.0
    """Angle by which it is wound in the sketch's pose, rad."""


class Sketch(Spec):
    """A whole linkage file; lengths in mm."""

    linkage: LinkageTable = LinkageTable()
    """What the whole is called."""
    joints: dict[Name, Point]
    """Places by name, near the wanted assembly, mm."""
    bodies: dict[Name, BodyTable]
    """Rigid bodies by name."""
    sliders: list[SliderTable] = pydantic.Field(default_factory=list)
    """Joints that slide along lines."""
    inputs: list[InputTable] = pydantic.Field(default_factory=list)
    """What is driven."""
    springs: list[SpringTable] = pydantic.Field(default_factory=list)
    """Torsion springs."""


def load_sketch(path: str | Path) -> Sketch:
    """The linkage file at ``path``, its form checked (its meaning is `build_linkage`'s to check).

    Raises:
        UserError: it cannot be read, is no TOML, or has unknown, missing or impossible entries;
            all of these at once.
    """
    return parse_sketch(read_tables(path, "linkage", "joints"), str(path))


def parse_sketch(data: dict[str, Any], source: str) -> Sketch:
    """A sketch from the tables of a linkage file.

    Args:
        data: the tables, as `tomllib` gives them.
        source: where they come from, for messages.

    Raises:
        UserError: as `load_sketch`.
    """
    return validated(Sketch, data, source)
