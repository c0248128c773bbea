"""The file a person writes: joints near the wanted assembly, bodies, sliders, inputs, springs."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any

import pydantic

from designopt.errors import UserError
from designopt.study import Spec

LARGEST, SMALLEST = 1e30, 1e-30
"""Sizes beyond these are slips of the pen, and their squares leave the range of numbers."""

Number = Annotated[float, pydantic.Field(strict=True, ge=-LARGEST, le=LARGEST)]
Length = Annotated[float, pydantic.Field(strict=True, ge=SMALLEST, le=LARGEST)]
Point = tuple[Number, Number]
Name = Annotated[str, pydantic.Field(pattern=r"^[^\s,=\"\[\]\p{C}]+$")]


class LinkageTable(Spec):
    """``[linkage]``."""

    name: str = "linkage"


class BodyTable(Spec):
    """``[bodies.NAME]``: a rigid body, by its joints; exact lengths replace the sketch's."""

    joints: Annotated[list[Name], pydantic.Field(min_length=1)]
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


TABLES: dict[str, type[Spec]] = {
    "linkage": LinkageTable,
    "bodies": BodyTable,
    "sliders": SliderTable,
    "inputs": InputTable,
    "springs": SpringTable,
}


def load_sketch(path: str | Path) -> Sketch:
    """The linkage file at ``path``, its form checked (its meaning is `build_linkage`'s to check).

    Raises:
        UserError: it cannot be read, is no TOML, or has unknown, missing or impossible entries;
            all of these at once.
    """
    try:
        # Some editors mark UTF-8 by a first character that TOML does not know.
        text = Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: cannot be read: it is not UTF-8 text") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UserError(f"{path}: cannot be read: {reason}") from error
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{path}: not TOML: {error}; correct it there") from error
    except ValueError as error:
        raise UserError(f"{path}: it holds a number of too many digits; shorten it") from error
    except RecursionError as error:
        raise UserError(f"{path}: its tables are nested too deeply for a linkage") from error
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
        faults = dict.fromkeys(
            f"{_where(fault['loc'])}: {_said(fault)}" for fault in error.errors()
        )
        raise UserError(f"{source}: " + "; ".join(faults)) from error


def _where(place: tuple[int | str, ...]) -> str:
    text = ".".join(str(part) for part in place if part != "[key]") or "file"
    return text if text.isprintable() else repr(text)


def _said(fault: Any) -> str:
    """What is wrong and how it is cured, in words of the file instead of Python's."""
    place, given = fault["loc"], fault["input"]
    point = "joints" in place[:1] or "line" in place
    match fault["type"]:
        case "extra_forbidden":
            return f"no such key; {_hint(place)}"
        case "missing" if point and len(place) > 1 and isinstance(place[-1], int):
            return "missing; a point is two numbers, [x, y]"
        case "missing":
            return "missing; add it"
        case "string_pattern_mismatch":
            return (
                "a name must not be empty or hold blanks, commas, quotes, brackets, '=' or what "
                "cannot be printed; choose another"
            )
        case "tuple_type" | "too_long" if point:
            wanted = (
                "two points, [[x, y], [x, y]]" if place[-1] == "line" else "two numbers, [x, y]"
            )
            return f"write it as {wanted} (it is {_short(given)})"
        case "too_short" if place[-1] == "joints":
            return "a body needs a joint; add one"
        case "model_type" | "dict_type" if len(place) == 1:
            return f"write it as a table, [{place[0]}] (it is {_short(given)})"
        case "model_type" | "dict_type":
            return f"write it as a table, {{ … }} (it is {_short(given)})"
        case "list_type" if place[-1] in ("sliders", "inputs", "springs"):
            return f"write each as a table of its own, [[{place[-1]}]], in double brackets"
        case "list_type" | "tuple_type":
            return f'write it as a list of names, ["A", "B"] (it is {_short(given)})'
        case "string_type":
            return f'write it as text in quotes, "…" (it is {_short(given)})'
        case "bool_type":
            return f"write true or false, without quotes (it is {_short(given)})"
        case "float_type" | "finite_number":
            return f"write a finite number, without quotes (it is {_short(given)})"
        case "greater_than_equal" if "lengths" in place:
            return f"a length must be positive (it is {_short(given)}); correct it"
        case "greater_than_equal" | "less_than_equal" if place[-1] != "stiffness":
            return f"a number of that size (it is {_short(given)}) is a slip of the pen; correct it"
        case _:
            said = f"{fault['msg'][0].lower()}{fault['msg'][1:]}"
            return f"{said} (it is {_short(given)}); correct it"


def _hint(place: tuple[int | str, ...]) -> str:
    table = Sketch if len(place) == 1 else TABLES.get(str(place[0]), Sketch)
    known = list(table.model_fields)
    close = difflib.get_close_matches(str(place[-1]), known, n=1)
    return f"did you mean '{close[0]}'?" if close else f"remove it (there are: {', '.join(known)})"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
