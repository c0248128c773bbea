"""The file a person writes: joints near the wanted assembly, bodies, sliders, inputs, springs."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any

import pydantic

from designopt.errors import UserError
from designopt.study import Spec

Point = tuple[float, float]
Positive = Annotated[float, pydantic.Field(gt=0)]
Name = Annotated[str, pydantic.Field(pattern=r"^[^\s,=\"\[\]]+$")]


class LinkageTable(Spec):
    """``[linkage]``."""

    name: str = "linkage"


class BodyTable(Spec):
    """``[bodies.NAME]``: a rigid body, by its joints; exact lengths replace the sketch's."""

    joints: Annotated[list[Name], pydantic.Field(min_length=1)]
    lengths: dict[str, Positive] = {}
    fixed: bool = False


class SliderTable(Spec):
    """``[[sliders]]``: a joint slides along a line that is fixed in a body.

    With ``keeps``, a body that holds the joint, that body slides without turning (a prismatic
    joint); without, the joint is a pin in a slot.
    """

    joint: Name
    on: Name
    line: tuple[Point, Point]
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
    stiffness: Annotated[float, pydantic.Field(ge=0)]
    preload: float = 0.0


class Sketch(Spec):
    """A whole linkage file; lengths in mm."""

    linkage: LinkageTable = LinkageTable()
    joints: dict[Name, Point]
    bodies: dict[Name, BodyTable]
    sliders: list[SliderTable] = []
    inputs: list[InputTable] = []
    springs: list[SpringTable] = []


def load_sketch(path: str | Path) -> Sketch:
    """The linkage file at ``path``, its form checked (its meaning is `build_linkage`'s to check).

    Raises:
        UserError: it cannot be read, is no TOML, or has unknown, missing or impossible entries;
            all of these at once.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        data = tomllib.loads(text)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise UserError(f"{path}: cannot be read: {reason}") from error
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{path}: not TOML: {error}") from error
    return parse_sketch(data, str(path))


def parse_sketch(data: dict[str, Any], source: str) -> Sketch:
    """A sketch from the tables of a linkage file.

    Args:
        data: the tables, as `tomllib` gives them.
        source: where they come from, for messages.

    Raises:
        UserError: as `load_sketch`.
    """
    try:
        return Sketch.model_validate(data)
    except pydantic.ValidationError as error:
        faults = [
            f"{'.'.join(map(str, fault['loc'])) or 'file'}: {_said(fault)}"
            for fault in error.errors()
        ]
        raise UserError(f"{source}: " + "; ".join(faults)) from error


def _said(fault: Any) -> str:
    if fault["type"] == "extra_forbidden":
        return "no such key; remove it or mend its spelling"
    if fault["type"] == "missing":
        return "missing; add it"
    if fault["type"] == "string_pattern_mismatch":
        return "a name must not be empty or hold blanks, commas, quotes, brackets or '='"
    return f"{fault['msg'][0].lower()}{fault['msg'][1:]} (it is {fault['input']!r})"
