"""Values given on the command line: ``NAME=VALUE``, ``NAME=START:STOP:COUNT``, and their grid."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping

import numpy as np

from designopt.errors import UserError

LARGEST_INPUT = 1e12
"""In degrees or mm."""

MOST_POSES = 10_000_000
"""A larger grid is more likely a slip of the pen than a wish."""


def single_values(
    texts: Iterable[str], option: str, names: Collection[str], noun: str
) -> dict[str, float]:
    """The numbers that texts such as ``crank=2`` give to names.

    Args:
        texts: as they were written after the option.
        option: the option, such as ``--rate``, for messages.
        names: the names that exist.
        noun: what they name, such as ``input``, for messages.

    Raises:
        UserError: a text of another form, an unknown name, a name given twice, or no finite number.
    """
    values: dict[str, float] = {}
    form = f"{_symbol(noun)}=VALUE"
    for text in texts:
        place = f"{option} {text}"
        name, value = _split(text, place, names, noun, form)
        if name in values:
            raise UserError(f"{place}: '{name}' is given twice; once is enough")
        values[name] = _number(value, place, form)
    return values


def grid_of(
    texts: Iterable[str],
    option: str,
    angles: Mapping[str, bool],
    noun: str,
    defaults: Mapping[str, float] | None = None,
) -> np.ndarray:
    """All combinations of swept values, the last name's changing fastest.

    Args:
        texts: ``name=start:stop:count``, both ends included, or ``name=value``.
        option: the option they were written after, such as ``--sweep``, for messages.
        angles: the names that exist, in the order of the columns, and whether each is an angle.
        noun: what they name, such as ``input``, for messages.
        defaults: values of names that are not swept.

    Returns:
        Values as they were written, degrees or mm, shape (poses, names).

    Raises:
        UserError: a text of another form, an unknown name, a name that is swept twice or has no
            value, no finite number, or more than `MOST_POSES` combinations.
    """
    symbol = _symbol(noun)
    form = f"{symbol}=START:STOP:COUNT or {symbol}=VALUE"
    ranges: dict[str, np.ndarray] = {}
    for text in texts:
        place = f"{option} {text}"
        name, value = _split(text, place, angles, noun, form)
        if name in ranges:
            raise UserError(f"{place}: '{name}' is swept twice; once is enough")
        ranges[name] = _range(value, place, form)
    ranges = {name: np.array([value]) for name, value in (defaults or {}).items()} | ranges
    missing = [name for name in angles if name not in ranges]
    if missing:
        example = " ".join(
            f"{option} {name}={'0:360:361' if angles[name] else '0:10:101'}" for name in missing
        )
        raise UserError(f"{option}: no values for {', '.join(missing)}; add for example {example}")
    columns = [ranges[name] for name in angles]
    count = math.prod(len(column) for column in columns)
    if count > MOST_POSES:
        poses = f"{count:,}" if count < 10**12 else f"1e{int(math.log10(count))}"
        raise UserError(
            f"{option}: a grid of {poses} poses is too large (at most {MOST_POSES:,}); "
            "sweep fewer values"
        )
    # One pose, even where nothing has a name. (NumPy's grids have 64 axes at most.)
    grid = np.empty((count, len(columns)))
    each = count
    for column, values in zip(grid.T, columns, strict=True):
        each //= len(values)
        column.reshape(-1, len(values), each)[:] = values[:, None]
    return grid


def split_name(text: str, place: str, form: str) -> tuple[str, str]:
    """The name and the value of a text such as ``crank=2``.

    Args:
        text: as it was written.
        place: the option and the text, for messages.
        form: how it should have been written, for messages.

    Raises:
        UserError: a name or an equals sign is missing.
    """
    name, mark, value = text.partition("=")
    if not (name and mark):
        raise UserError(f"{place}: write it as {form}")
    return name, value


def values_of(text: str, place: str, symbol: str) -> np.ndarray:
    """The values of ``start:stop:count``, both ends included, or of ``value,value,…``.

    Args:
        text: what was written after the name.
        place: the option and all that was written after it, for messages.
        symbol: what stands for the name, such as ``KEY``, in messages.

    Raises:
        UserError: a text of another form, a number that is not finite, or a COUNT that is no
            whole number.
    """
    if "," in text:
        return np.array([_number(part, place) for part in text.split(",")])
    return _range(text, place, f"{symbol}=START:STOP:COUNT or {symbol}=VALUE,VALUE,…")


def ends_of(text: str, place: str, symbol: str) -> tuple[float, float]:
    """The bounds of ``low:high``.

    Args:
        text: what was written after the name.
        place: the option and all that was written after it, for messages.
        symbol: what stands for the name, such as ``KEY``, in messages.

    Raises:
        UserError: a text of another form, a number that is not finite, or low above high.
    """
    parts = text.split(":")
    if len(parts) != 2:
        raise UserError(f"{place}: write it as {symbol}=LOW:HIGH")
    low, high = (_number(part, place) for part in parts)
    if not low < high:
        raise UserError(f"{place}: LOW must be smaller than HIGH")
    return low, high


def _symbol(noun: str) -> str:
    return noun.upper().replace(" ", "_")


def _split(text: str, place: str, names: Collection[str], noun: str, form: str) -> tuple[str, str]:
    name, value = split_name(text, place, form)
    if name not in names:
        raise UserError(
            f"{place}: no {noun} is named '{name}'; there are: {', '.join(names) or 'none'}"
        )
    return name, value


def _number(text: str, place: str, form: str = "") -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        cure = f"; write it as {form}" if form else ""
        raise UserError(f"{place}: '{text}' is not a finite number{cure}")
    return number


def _range(value: str, place: str, form: str) -> np.ndarray:
    parts = value.split(":")
    if len(parts) == 1:
        start = stop = _number(value, place, form)
        count = 1.0
    elif len(parts) == 3:
        start, stop, count = (_number(part, place, form) for part in parts)
    else:
        raise UserError(f"{place}: write it as {form}")
    if count != int(count) or not 1 <= count <= MOST_POSES:
        raise UserError(
            f"{place}: COUNT is the number of values, a whole number from 1 to "
            f"{MOST_POSES:,}; both ends are included"
        )
    if max(abs(start), abs(stop)) > LARGEST_INPUT:
        raise UserError(f"{place}: values beyond {LARGEST_INPUT:g} have no digits left")
    return np.linspace(start, stop, int(count))
