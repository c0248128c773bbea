"""Tables as CSV that spreadsheets take for what it is: text stays text."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import TextIO

import numpy as np

FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a cell begins with that a spreadsheet runs as a formula."""


def write_csv(stream: TextIO, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table: names of the columns, and rows of numbers, texts and ``None``."""
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(map(inert, columns))
    writer.writerows(map(inert, row) for row in rows)


def write_numbers(stream: TextIO, columns: Sequence[np.ndarray]) -> None:
    """Write rows of numbers by their columns, fast: an empty cell for NaN, all digits otherwise."""
    texts = []
    for column in columns:
        cells = list(map(repr, column.tolist()))  # shortest decimals that give the same number
        if column.dtype.kind == "f":
            for row in np.flatnonzero(np.isnan(column)).tolist():
                cells[row] = ""
        texts.append(cells)
    stream.writelines(f"{','.join(row)}\n" for row in zip(*texts, strict=True))


def inert(cell: object) -> object:
    """A cell that no spreadsheet runs: a text that looks like a formula gets an apostrophe.

    Source: the rule of OWASP's page on CSV injection.
    """
    if not isinstance(cell, str) or not cell.startswith(FORMULA):
        return cell
    with suppress(ValueError):
        if math.isfinite(float(cell)):
            return cell
    return f"'{cell}"
