"""Specs in files that people write: kinds of fields, and every fault in words of the file."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from types import NoneType, UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

import pydantic

from designopt.errors import UserError, shortened
from designopt.io.spec import Spec

LARGEST, SMALLEST = 1e30, 1e-30
"""Sizes beyond these are slips of the pen, and their squares leave the range of numbers."""

Number = Annotated[float, pydantic.Field(strict=True, ge=-LARGEST, le=LARGEST)]
Length = Annotated[float, pydantic.Field(strict=True, ge=SMALLEST, le=LARGEST)]
Point = tuple[Number, Number]
Line = tuple[Point, Point]

LONGEST_NAME = 100
"""Characters; no drawing has room for more."""


def _title(name: str) -> str:
    # Not printable are control characters, line separators and marks of the direction of writing:
    # in a terminal, a table or a drawing they would change what stands around a name.
    if not name.strip() or not name.isprintable() or len(name) > LONGEST_NAME:
        raise ValueError(
            f"a name must not be blank, longer than {LONGEST_NAME} characters, or hold what cannot "
            "be printed; choose another"
        )
    return name


def _name(name: str) -> str:
    if not name or any(char.isspace() or char in ',="[]' for char in name):
        raise ValueError(
            "a name must not be empty or hold blanks, commas, quotes, brackets or '='; choose "
            "another"
        )
    return _title(name)


Title = Annotated[str, pydantic.AfterValidator(_title)]
"""A name of something that no command line and no other entry names."""

Name = Annotated[str, pydantic.AfterValidator(_name)]

FORMAT = 1
"""Version of the formats of files; it grows when old files mean another thing."""


def _known_format(number: int) -> int:
    if number != FORMAT:
        raise ValueError(
            f"this version reads format {FORMAT} and not {number}; update designopt, or write the "
            "file anew"
        )
    return number


Format = Annotated[int, pydantic.Field(strict=True), pydantic.AfterValidator(_known_format)]
"""The version that a file states; the present one where it states none."""

Place = tuple[int | str, ...]
S = TypeVar("S", bound=Spec)


def validated(model: type[S], data: Mapping[str, Any], source: str) -> S:
    """The spec that the tables of a file describe.

    Words beyond those for the kinds of fields are the model's: a `ValueError` that one of its
    validators raises is passed on unchanged.

    Args:
        model: the spec of the whole file.
        data: the tables, as `tomllib` gives them.
        source: where they come from, for messages.

    Raises:
        UserError: there are unknown, missing or impossible entries; all of these at once.
    """
    try:
        return model.model_validate(data)
    except pydantic.ValidationError as error:
        faults = dict.fromkeys(
            f"{_where(fault['loc'])}: {_said(fault, model)}" for fault in error.errors()
        )
        raise UserError(f"{source}: " + "; ".join(faults)) from error


def _where(place: Place) -> str:
    text = ".".join(str(part) for part in place if part != "[key]") or "file"
    return text if text.isprintable() else repr(text)


def _said(fault: Any, model: type[Spec]) -> str:
    """What is wrong and how it is cured, in words of the file instead of Python's."""
    place: Place = fault["loc"]
    kind, table = _kind(model, place), _kind(model, place[:-1])
    it_is = f"(it is {shortened(repr(fault['input']), 40)})"
    match fault["type"]:
        case "value_error":
            return str(fault["ctx"]["error"])
        case "extra_forbidden":
            return f"no such key; {_hint(str(place[-1]), table)}"
        case "missing" if isinstance(place[-1], int) and Point in (kind, table):
            return "missing; a point is two numbers, [x, y]"
        case "missing":
            return "missing; add it"
        case "model_type" | "dict_type" if len(place) == 1:
            return f"write it as a table, [{place[0]}] {it_is}"
        case "model_type" | "dict_type":
            return f"write it as a table, {{ … }} {it_is}"
        case "list_type" if _is_table(_item(kind)):
            return f"write each as a table of its own, [[{place[-1]}]], in double brackets"
        case "list_type" | "tuple_type":
            return f"write it as {_form(kind)} {it_is}"
        case "too_long" if kind in (Point, Line):
            return f"write it as {_form(kind)} {it_is}"
        case "string_type":
            return f'write it as text in quotes, "…" {it_is}'
        case "bool_type":
            return f"write true or false, without quotes {it_is}"
        case "float_type" | "finite_number":
            return f"write a finite number, without quotes {it_is}"
        case "greater_than_equal" if fault["ctx"]["ge"] == SMALLEST:
            return f"a length must be positive {it_is}; correct it"
        case "greater_than_equal" | "less_than_equal" if {-LARGEST, LARGEST} & {
            *fault["ctx"].values()
        }:
            return f"a number of that size {it_is} is a slip of the pen; correct it"
        case _:
            message = f"{fault['msg'][0].lower()}{fault['msg'][1:]}"
            return f"{message} {it_is}; correct it"


def _kind(model: type[Spec], place: Place) -> Any:
    """What a field holds, by its annotation; ``None`` where the annotation leaves it open."""
    kind: Any = model
    for part in place:
        if _is_table(kind):
            field = _fields(kind).get(part)
            kind = None if field is None else _bare(field.annotation)
        else:
            kind = _item(kind)
    return kind


def _item(kind: Any) -> Any:
    """What a list, a tuple or a dictionary holds; items of a tuple are of one kind."""
    items = get_args(kind)
    return _bare(items[get_origin(kind) is dict]) if items else None


def _bare(kind: Any) -> Any:
    if get_origin(kind) is Annotated:
        return _bare(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        choices = [choice for choice in get_args(kind) if choice is not NoneType]
        return _bare(choices[0]) if len(choices) == 1 else None
    return kind


def _is_table(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Spec)


def _form(kind: Any) -> str:
    """How a list is written in a file."""
    if kind == Point:
        return "two numbers, [x, y]"
    if kind == Line:
        return "two points, [[x, y], [x, y]]"
    if _item(kind) == Point:
        return "a list of points, [[x, y], [x, y], …]"
    return 'a list of names, ["A", "B"]' if _item(kind) is str else "a list, […]"


def _fields(table: Any) -> dict[Any, Any]:
    """Fields of a table by their names in the file."""
    return {field.alias or name: field for name, field in table.model_fields.items()}


def _hint(key: str, table: Any) -> str:
    if not _is_table(table):
        return "remove it"
    known = list(_fields(table))
    close = difflib.get_close_matches(key, known, n=1)
    return f"did you mean '{close[0]}'?" if close else f"remove it (there are: {', '.join(known)})"
