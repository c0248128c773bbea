"""TOML text of a spec: the standard library reads that format and does not write it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def format_toml(table: Mapping[str, Any], comment: str = "") -> str:
    """The text of a TOML file.

    Args:
        table: tables of strings, numbers, booleans, lists and further tables; a list of tables
            becomes an array of tables. ``tomllib`` reads the same back.
        comment: lines to begin with, without their ``#``.

    Example:
        >>> print(format_toml({"body": {"thickness": 20.0}}, "Lengths in mm."), end="")
        # Lengths in mm.
        <BLANKLINE>
        [body]
        thickness = 20.0
    """
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += _table(table, "")
    return "\n".join(lines).strip("\n") + "\n"


def degrees_of(angle: float) -> float:
    """An angle of radians in degrees, such that `math.radians` gives the same angle if any does.

    Args:
        angle: rad.

    Returns:
        Of the numbers that do, the one with the fewest digits.

    Example:
        >>> import math
        >>> degrees_of(math.radians(1.5)), math.degrees(math.radians(1.5))
        (1.5, 1.5000000000000002)
    """
    for digits in range(1, 17):
        short = float(f"{math.degrees(angle):.{digits}g}")
        if math.radians(short) == angle:
            return short
    near = math.degrees(angle)
    both = (math.nextafter(near, -math.inf), near, math.nextafter(near, math.inf))
    return next((one for one in both if math.radians(one) == angle), near)


def _table(table: Mapping[str, Any], path: str) -> list[str]:
    plain, nested = [], []
    for key, value in table.items():
        name = f"{path}.{_key(key)}" if path else _key(key)
        if isinstance(value, Mapping):
            body = _table(value, name)
            # A table of tables alone needs no heading of its own.
            holds_tables = value and all(_is_table(part) for part in value.values())
            nested += body if holds_tables else ["", f"[{name}]", *body]
        elif _is_table(value):
            for part in value:
                nested += ["", f"[[{name}]]", *_table(part, name)]
        else:
            plain.append(f"{_key(key)} = {_value(value)}")
    return plain + nested


def _is_table(value: Any) -> bool:
    if isinstance(value, Mapping):
        return True
    listed = isinstance(value, Sequence) and not isinstance(value, str)
    return listed and len(value) > 0 and all(isinstance(part, Mapping) for part in value)


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else json.dumps(key, ensure_ascii=False)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)  # TOML's basic strings escape as JSON's do
    if isinstance(value, float):
        return repr(float(value))  # the repr of NumPy's floats names their type
    if isinstance(value, int):
        return repr(value)
    if isinstance(value, Sequence):
        return f"[{', '.join(map(_value, value))}]"
    raise TypeError(f"format_toml: no value of type {type(value).__name__}")
