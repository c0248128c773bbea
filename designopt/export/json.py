"""A design's numbers with their units, as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

from designopt.errors import UserError
from designopt.io.files import printable

DIGITS = 14
"""Of every number: what was computed from 13.73 should not come out as 13.730000000000002."""


@dataclass(frozen=True)
class Quantity:
    """One number of a design.

    Attributes:
        name: parts joined by dots, such as ``crank.length``.
        value: the number.
        unit: ``"mm"``, ``"°"``, ``"N mm/rad"``, …; empty for a pure number.
        note: what it is measured between, where that is not in its name.
    """

    name: str
    value: float
    unit: str
    note: str = ""


def json_text(name: str, quantities: Sequence[Quantity]) -> str:
    """A document of every number with its unit.

    Args:
        name: the design's.
        quantities: its numbers.

    Raises:
        UserError: two of them have the same name, so that one would be lost.
    """
    numbers: dict[str, dict[str, float | str]] = {}
    for part in quantities:
        if part.name in numbers:
            raise UserError(
                f"--to json: two numbers of {name} are called '{part.name}'; rename a part of it"
            )
        value = float(f"{part.value:.{DIGITS}g}") if isinstance(part.value, float) else part.value
        numbers[part.name] = {"value": value, "unit": part.unit}
        if part.note:
            numbers[part.name]["note"] = part.note
    document = {"name": printable(name), "quantities": numbers}
    return json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False) + "\n"
