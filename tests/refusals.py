"""Files that a reader must refuse, from tables in ``tests/data``: one test for each reader.

A table has ``[bases]``, contents of files that are right, and lists of cases: the name of a base,
the entries changed in it, by their path, or ``"(removed)"``, and the words that must be in the
error. A case that names a path one beyond the end of a list appends to it.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import pytest

from designopt import UserError
from tests.helpers import load_toml

REMOVED = "(removed)"


def changed(data: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A copy with entries replaced, appended or removed."""
    data = copy.deepcopy(data)
    for path, value in changes.items():
        places: list[Any] = [int(part) if part.isdigit() else part for part in path.split("/")]
        table: Any = data
        last = places.pop()
        for place in places:
            table = table[place]
        if value == REMOVED:
            del table[last]
        elif isinstance(table, list) and last == len(table):
            table.append(value)
        else:
            table[last] = value
    return data


def refusals(file: str, base: Callable[[str], dict[str, Any]] | None = None) -> list[Any]:
    """Parameters (data, words) of a file's cases; ``base`` returns what is not in ``[bases]``."""
    table = load_toml(file)
    bases, found = table.pop("bases"), []
    for kind, cases in table.items():
        for number, (name, changes, words) in enumerate(cases):
            data = bases[name] if name in bases or base is None else base(name)
            found.append(pytest.param(changed(data, changes), words, id=f"{kind}-{number}"))
    return found


def check_refused(read: Callable[[Any, str], Any], data: dict[str, Any], words: list[str]) -> str:
    """One line that begins with the file's name and has all the words; returned."""
    with pytest.raises(UserError) as raised:
        read(data, "f.toml")
    message = str(raised.value)
    assert message.startswith("f.toml: ")
    assert message.isprintable()
    assert "pydantic" not in message
    assert message.count("cannot hold each other") <= 1
    for word in words:
        assert word in message
    return message
