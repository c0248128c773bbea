"""All that a page shows of a set of values: the drawings, and then what is computed beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from designopt.explore.explorer import Explorer
from designopt.optimize.parametric import Values


class Whole(NamedTuple):
    """Views with all their notes and charts, readouts, what is the matter."""

    panels: Any
    readouts: Sequence[Any]
    message: str


def show(explorer: Explorer, values: Values) -> Whole:
    """What an explorer shows of values."""
    views, compute = explorer.show(values)
    numbers = compute()
    assert numbers.notes.keys() <= {view.name for view in views}
    noted = [
        replace(view, notes={**view.notes, **numbers.notes.get(view.name, {})}) for view in views
    ]
    return Whole([*noted, *numbers.charts], numbers.readouts, numbers.message)
