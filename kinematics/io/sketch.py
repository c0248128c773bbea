"""The file a person writes: joints near the wanted assembly, bodies, sliders, inputs, springs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import pydantic

from designopt.designs import read_tables
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
    format: Format = FORMAT


def _some(joints: list[str]) -> list[str]:
    if not joints:
        raise ValueError("a body needs a joint; add one")
    return joints


class BodyTable(Spec):
    """``[bodies.NAME]``: a rigid body, by its joints; exact lengths replace the sketch's."""

    joints: Annotated[list[Name], pydantic.AfterValidator(_some)]
    lengths: dict[str, Length] = pydantic.Field(default_factory=dict)
    fixed: pydantic.StrictBool = False


class SliderTable(Spec):
    """``[[sliders]]``: a joint slides along a line that is fixed in a body.

    A point of the line that is drawn at a joint of that body stays at that joint when exact
    lengths move it. With ``keeps``, a body that holds the joint, that body slides without turning
    (a prismatic joint); without, the joint is a pin in a slot.
    """

    joint: Name
    on: Name
    line: Line
    keeps: Name | None = None


class InputTable(Spec):
    """``[[inputs]]``: the angle of a body relative to another, or the place of a slider."""

    name: Name
    body: Name | None = None
    slider: Name | None = None
    relative_to: Name | None = None


class SpringTable(Spec):
    """``[[springs]]``: a torsion spring between two bodies, N mm/rad and rad."""

    between: tuple[Name, Name]
    stiffness: Annotated[Number, pydantic.Field(ge=0)]
    preload: Number = 0.0


class Sketch(Spec):
    """A whole linkage file; lengths in mm."""

    linkage: LinkageTable = LinkageTable()
    joints: dict[Name, Point]
    bodies: dict[Name, BodyTable]
    sliders: list[SliderTable] = pydantic.Field(default_factory=list)
    inputs: list[InputTable] = pydantic.Field(default_factory=list)
    springs: list[SpringTable] = pydantic.Field(default_factory=list)


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
