"""Files with random changes: what slips, scripts and bad disks make of them."""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

UNKNOWN = "zz_unknown"
"""A key that no table has; its value is a text that nothing takes."""

_ODD = tomllib.loads(r"""
numbers = [nan, inf, -inf, 0, -0.0, 5e-324, 1e-30, 1e30, 1e308, -1, 90, 360, 9223372036854775808]
others = [true, "", " ", "A", "world", "direct", "α", '$\frac{$', "_", "=1+1", "a\u001b[31mb",
          "\u202e", "\n", "%s{}", "../x", [], {}, [[]], [nan, nan], [0, 0], [[0, 0], [0, 0]],
          {"" = 1}, {x = {x = {x = {}}}}]
""")
ODD_NUMBERS = (*_ODD["numbers"], 10**400)
ODD: tuple[Any, ...] = (*ODD_NUMBERS, *_ODD["others"], 3000 * "x", 2000 * [1.0])
"""Values that a reader may not expect."""

ODD_KEYS = ("", "a b", "$x^", "\x1b", "0", "=1", "x.y", 200 * "k")

FACTORS = (-1.0, 0.0, 0.5, 0.999, 1.001, 2.0, 57.3, 1e-9, 1e9)

Place = tuple[Any, Any]
"""A table or a list, and a key or an index of it."""


@dataclass(frozen=True)
class Mutated:
    """A changed file.

    Attributes:
        content: of the file.
        changes: what was done.
        unknown: whether it has a key that no such file has, and must be refused.
    """

    content: bytes
    changes: tuple[str, ...]
    unknown: bool = False


def mutated(text: str, generator: np.random.Generator) -> Mutated:
    """A TOML file with other bytes, with other numbers, or with other contents of any kind."""
    how = generator.uniform()
    if how < 0.2:
        return _with_other_bytes(text.encode(), generator)
    document = tomllib.loads(text)
    changes = mutate(document, generator, only_numbers=how < 0.6)
    text = "".join(f"{json.dumps(key)} = {toml(part)}\n" for key, part in document.items())
    return Mutated(text.encode(), changes, any(UNKNOWN in change for change in changes))


def toml(value: Any) -> str:
    """Any value in TOML, tables in braces; lists may hold values of different kinds."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{json.dumps(key)} = {toml(one)}' for key, one in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    return json.dumps(value) if isinstance(value, (str, bool)) else repr(value)


def mutate(
    document: dict[str, Any], generator: np.random.Generator, *, only_numbers: bool = False
) -> tuple[str, ...]:
    """Change a document in one place or in a few; returns what was done."""
    change = _with_another_number if only_numbers else _with_another_content
    return tuple(change(document, generator) for _ in range(int(generator.geometric(0.6))))


def _with_another_number(document: dict[str, Any], generator: np.random.Generator) -> str:
    places = [(table, key) for table, key in _places(document) if _is_number(table[key])]
    if not places:
        return "nothing"
    table, key = _one_of(places, generator)
    before = table[key]
    if generator.uniform() < 0.2 or abs(before) > 1e300:
        table[key] = _one_of(ODD_NUMBERS, generator)
    else:
        table[key] = before * _one_of(FACTORS, generator)
    return f"{key!r} = {before} replaced by {table[key]}"


def _with_another_content(document: dict[str, Any], generator: np.random.Generator) -> str:
    # Tables and lists are as likely as the many numbers in them.
    places = list(_places(document))
    if not places:
        return "nothing"
    nested = [place for place in places if isinstance(place[0][place[1]], (dict, list))]
    table, key = _one_of(nested if nested and generator.uniform() < 0.5 else places, generator)
    value, where = table[key], f"{key!r} = {str(table[key])[:60]}"
    match int(generator.integers(7)):
        case 0:
            del table[key]
            return f"{where} removed"
        case 1:
            inside = next(one for one in (value, table, document) if isinstance(one, dict))
            inside[UNKNOWN] = "x"
            return f"{UNKNOWN} added in or beside {where}"
        case 2 if isinstance(table, dict):
            odd = generator.uniform() < 0.5
            table[_one_of(ODD_KEYS, generator) if odd else f"{key}x"] = table.pop(key)
            return f"{where} renamed"
        case 3 if isinstance(table, list):
            table.insert(key, copy.deepcopy(value))
            return f"{where} repeated"
        case 4:
            other, name = _one_of(places, generator)
            table[key] = copy.deepcopy(other[name])
        case 5:
            table[key] = [value] if generator.uniform() < 0.5 else {str(key): value}
        case _:
            table[key] = copy.deepcopy(_one_of(ODD, generator))
    return f"{where} replaced by {str(table[key])[:60]}"


def _places(value: Any) -> Iterator[Place]:
    """Every part of tables and lists."""
    for key, part in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield value, key
        if isinstance(part, (dict, list)):
            yield from _places(part)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _one_of(choices: Any, generator: np.random.Generator) -> Any:
    return choices[int(generator.integers(len(choices)))]


def _with_other_bytes(content: bytes, generator: np.random.Generator) -> Mutated:
    at = int(generator.integers(len(content)))
    lines = content.split(b"\n")
    first, second = (int(i) for i in generator.integers(len(lines), size=2))
    match generator.integers(10):
        case 0:
            return Mutated(content[:at], (f"cut at byte {at}",))
        case 1:
            flipped = content[at] ^ (1 << int(generator.integers(8)))
            made = content[:at] + bytes([flipped]) + content[at + 1 :]
            return Mutated(made, (f"a bit of byte {at} flipped",))
        case 2:
            put = _one_of((b"\x00", b"\xff", b"\r", b"\x1b", b"\xef\xbb\xbf", b'"', b"[", b"#"),
                          generator)  # fmt: skip
            return Mutated(content[:at] + put + content[at:], (f"{put!r} put in at byte {at}",))
        case 3:
            del lines[first]
            return Mutated(b"\n".join(lines), (f"line {first + 1} removed",))
        case 4:
            lines.insert(first, lines[second])
            return Mutated(b"\n".join(lines), (f"line {second + 1} repeated at {first + 1}",))
        case 5:
            lines[first], lines[second] = lines[second], lines[first]
            return Mutated(b"\n".join(lines), (f"lines {first + 1} and {second + 1} exchanged",))
        case 6:
            return Mutated(b"\xef\xbb\xbf" + content.replace(b"\n", b"\r\n"), ("as by Windows",))
        case 7:
            return Mutated(content + 5000 * b"[", ("thousands of brackets at its end",))
        case 8:
            key = b".".join([UNKNOWN.encode()] * 3000)
            return Mutated(key + b' = "x"\n' + content, ("a key of 3,000 parts",), unknown=True)
        case _:
            return Mutated(content.decode().encode("utf-16"), ("in UTF-16",))
