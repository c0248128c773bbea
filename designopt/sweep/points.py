"""Which points are swept: a grid of settings, or Sobol points between bounds."""

from __future__ import annotations

import difflib
import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast, get_args

import numpy as np
from scipy.stats import qmc

from designopt.errors import UserError
from designopt.io.ranges import ends_of, split_name, values_of
from designopt.io.spec import Spec
from designopt.study.settings import NO_CONFIG, Config, fields
from designopt.study.study import Study

MOST_POINTS = 100_000
"""More are more likely a slip of the pen than a wish: every point is kept in a file of its own."""

Value = float | int


@dataclass(frozen=True)
class Points:
    """What is varied, and its value in every point.

    Attributes:
        keys: the settings that are varied, in the order in which they were written.
        labels: these with their units, where their descriptions end in one.
        rows: their values, one row per point.
        grid: the values of each key, if the points are all their combinations with the last key
            changing fastest; ``None`` for Sobol points.
        definition: what makes these points, as plain data.
    """

    keys: tuple[str, ...]
    labels: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]
    grid: tuple[tuple[Value, ...], ...] | None
    definition: Mapping[str, Any]

    def __len__(self) -> int:
        return len(self.rows)

    def settings(self, index: int) -> dict[str, Value]:
        """What is varied, with its value in one point."""
        return dict(zip(self.keys, self.rows[index], strict=True))

    def assignments(self, index: int) -> tuple[str, ...]:
        """The settings of one point, as they would be written after ``--set``."""
        return tuple(f"{key}={value!r}" for key, value in self.settings(index).items())


class Sweep(NamedTuple):
    """A sweep, as asked for: all that its numbers depend on.

    Attributes:
        study: which.
        points: over what.
        settings: ``key=value`` texts that all points share.
        seed: seed of every random draw.
        dtype: float type to compute in.
        versions: of Python and of the packages that shape the numbers.
        config: settings of all points, over which the others lie.
    """

    study: Study
    points: Points
    settings: tuple[str, ...]
    seed: int
    dtype: str
    versions: Mapping[str, str]
    config: Config = NO_CONFIG

    def settings_of(self, index: int) -> tuple[str, ...]:
        """All settings of one point, as they would be written after ``--set``."""
        return (*self.settings, *self.points.assignments(index))


def grid_points(model: type[Spec], texts: Sequence[str]) -> Points:
    """All combinations of the values of several settings, the last one's changing fastest.

    Args:
        model: the study's spec.
        texts: ``key=start:stop:count``, both ends included, or ``key=value,value,…``.

    Raises:
        UserError: a text of another form, an unknown key, a key given twice, or too many points.
    """
    ranges: dict[str, tuple[Value, ...]] = {}
    for text in texts:
        key, value = _named(model, "--vary", text, "KEY=START:STOP:COUNT", ranges)
        ranges[key] = _whole(model, key, values_of(value, f"--vary {text}", "KEY"))
    count = math.prod(map(len, ranges.values()))
    if count > MOST_POINTS:
        raise UserError(
            f"--vary: a grid of {count:,} points is too large (at most {MOST_POINTS:,}); "
            "vary fewer values"
        )
    grid = tuple(ranges.values())
    definition = {"grid": {key: list(values) for key, values in ranges.items()}}
    rows = tuple(itertools.product(*grid))
    return Points(tuple(ranges), _labels(model, ranges), rows, grid, definition)


def sobol_points(model: type[Spec], count: int, texts: Sequence[str], seed: int) -> Points:
    """Scrambled Sobol points between bounds; of an integer setting all values are as likely.

    Args:
        model: the study's spec.
        count: how many; best a power of two.
        texts: ``key=low:high``.
        seed: of the scrambling.

    Raises:
        UserError: no texts, a text of another form, an unknown key, a key given twice, bounds of
            an integer setting that are no whole numbers, or too many points.
    """
    if not texts:
        raise UserError(
            f"--sobol {count}: say between which bounds, such as --sobol {count} key=1:2"
        )
    if count > MOST_POINTS:
        raise UserError(f"--sobol {count}: at most {MOST_POINTS:,} points; ask for fewer")
    bounds: dict[str, tuple[float, float]] = {}
    for text in texts:
        key, value = _named(model, "--sobol", text, "KEY=LOW:HIGH", bounds)
        bounds[key] = ends_of(value, f"--sobol {text}", "KEY")
        if _is_integer(model, key) and not all(end.is_integer() for end in bounds[key]):
            raise UserError(f"--sobol {text}: '{key}' has whole numbers; so must its bounds be")
    sampler = qmc.Sobol(len(bounds), rng=np.random.default_rng(seed))
    unit = sampler.random_base2(max(count - 1, 0).bit_length())[:count]
    columns = []
    for (key, (low, high)), column in zip(bounds.items(), unit.T, strict=True):
        whole = _is_integer(model, key)
        values = np.floor(low + column * (high - low + 1)) if whole else low + column * (high - low)
        columns.append(_whole(model, key, values))
    rows = tuple(zip(*columns, strict=True))
    definition = {"sobol": count, "bounds": {key: list(ends) for key, ends in bounds.items()}}
    return Points(tuple(bounds), _labels(model, bounds), rows, None, definition)


def _named(
    model: type[Spec], option: str, text: str, form: str, known: Mapping[str, Any]
) -> tuple[str, str]:
    place = f"{option} {text}"
    key, value = split_name(text, place, form)
    keys = [name for name, _, _ in fields(model)]
    if key not in keys:
        close = difflib.get_close_matches(key, keys, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"the keys are {', '.join(keys)}"
        raise UserError(f"{place}: unknown key '{key}'; {hint}")
    if key in known:
        raise UserError(f"{place}: '{key}' is varied twice; once is enough")
    return key, value


def _labels(model: type[Spec], keys: Iterable[str]) -> tuple[str, ...]:
    words = {key: description for key, _, description in fields(model)}
    units = (re.search(r" (\([^() ]+\))$", words[key].replace("(degrees)", "(°)")) for key in keys)
    return tuple(f"{key} {unit[1]}" if unit else key for key, unit in zip(keys, units, strict=True))


def _is_integer(model: type[Spec], key: str) -> bool:
    *tables, name = key.split(".")
    for table in tables:
        model = cast("type[Spec]", model.model_fields[table].annotation)
    kind = model.model_fields[name].annotation
    # Behind ``Annotated``, and beside ``None``.
    kinds = {getattr(one, "__origin__", one) for one in (kind, *get_args(kind))}
    return int in kinds and float not in kinds


def _whole(model: type[Spec], key: str, values: np.ndarray) -> tuple[Value, ...]:
    """The values as plain numbers; whole ones of an integer setting as integers."""
    plain = values.tolist()
    if not _is_integer(model, key):
        return tuple(plain)
    return tuple(int(value) if value.is_integer() else value for value in plain)
