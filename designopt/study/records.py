"""Rows with named columns, their groups and their statistics."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

MEASURES: dict[str, Callable[[np.ndarray], Any]] = {
    "mean": np.mean,
    "rms": lambda values: np.sqrt(np.mean(values**2)),
    "sd": np.std,
    "median": np.median,
    "min": np.min,
    "max": np.max,
}
_PERCENTILE = re.compile(r"p(\d{1,2})")

Summary = str | Callable[["Records"], Any]


class Records:
    """Rows with named columns, added a few at a time.

    Args:
        columns: the first rows, as `add` takes them.

    Example:
        >>> errors = Records()
        >>> errors.add(method="gap", joint=["pip", "dip"], error_deg=[1.0, -3.0])
        >>> errors.add(method="corners", joint=["pip", "dip"], error_deg=[0.1, float("nan")])
        >>> len(errors), errors.stat("mean_abs error_deg")
        (4, 1.3666666666666665)
        >>> {name: own.stat("defined error_deg") for name, own in errors.group("method").items()}
        {'gap': 1.0, 'corners': 0.5}
    """

    def __init__(self, columns: Mapping[str, ArrayLike] | Records | None = None) -> None:
        self._columns: dict[str, list[np.ndarray]] = {}
        if columns is not None:
            self.add(**columns)

    def add(self, **columns: Any) -> None:
        """Add rows: arrays and sequences of one length; a single value stands in each of the rows.

        Raises:
            ValueError: the columns are not those of the earlier rows, or of several lengths.
        """
        if self._columns and columns.keys() != self._columns.keys():
            raise ValueError(f"columns {sorted(columns)} beside earlier {sorted(self._columns)}")
        arrays = np.broadcast_arrays(*(np.atleast_1d(_array(v)) for v in columns.values()))
        for name, values in zip(columns, arrays, strict=True):
            self._columns.setdefault(name, []).append(values)

    def keys(self) -> list[str]:
        """The columns' names, in their order; with it, ``add(**records)`` takes over rows."""
        return list(self._columns)

    def __getitem__(self, name: str) -> np.ndarray:
        """A column, shape (rows,)."""
        parts = self._columns[name] if self._columns else [np.zeros(0, object)]
        if len(parts) > 1:
            parts[:] = [np.concatenate(parts)]
        return parts[0]

    def __len__(self) -> int:
        """Number of rows."""
        return len(self[self.keys()[0]]) if self._columns else 0

    def __or__(self, columns: Mapping[str, ArrayLike]) -> Records:
        """The same rows with further or other columns."""
        return Records({**{name: self[name] for name in self.keys()}, **columns})

    def where(self, mask: ArrayLike | None = None, **values: Any) -> Records:
        """The rows of a mask, or those whose columns have the given values.

        Args:
            mask: shape (rows,).
            values: by column, one value, or a list or tuple of which any will do.
        """
        kept = np.ones(len(self), bool) if mask is None else np.asarray(mask, bool)
        for name, value in values.items():
            any_of = value if isinstance(value, (list, tuple)) else [value]
            kept = kept & np.isin(self[name], np.asarray(any_of, self[name].dtype))
        return Records({name: self[name][kept] for name in self.keys()})

    def group(self, *names: str) -> dict[Any, Records]:
        """The rows of each value of a column, or of each tuple of values, as they first occur."""
        keys = list(zip(*(self[name].tolist() for name in names), strict=True))
        rows: dict[tuple, list[int]] = {}
        for row, key in enumerate(keys):
            rows.setdefault(key, []).append(row)
        return {
            key[0] if len(names) == 1 else key: Records(
                {name: self[name][own] for name in self.keys()}
            )
            for key, own in rows.items()
        }

    def stat(self, what: str) -> float:
        """A statistic of a column, such as ``"p95_abs error_deg"``.

        Args:
            what: ``count``, ``sum``, ``share`` (mean of truth values), ``defined`` (share of finite
                values), or one of the finite values: ``mean``, ``rms``, ``sd``, ``median``,
                ``min``, ``max``, ``p`` with a percentile; with ``_abs``, of their magnitudes. Then
                the column.

        Returns:
            The number; NaN of no rows, but for ``count`` and ``sum``.

        Raises:
            KeyError: there is no such statistic, or no such column.
        """
        measure, column = what.split()
        values = np.asarray(self[column], float)
        if measure == "count":
            return len(values)
        if measure == "sum":  # of whole numbers a whole one
            whole = not self._columns or self[column].dtype.kind in "biu"
            return int(np.sum(self[column])) if whole else float(np.sum(values))
        if measure in ("share", "defined"):
            counted = values if measure == "share" else np.isfinite(values)
            return float(np.mean(counted)) if len(counted) else float("nan")
        values = values[np.isfinite(values)]
        if measure.endswith("_abs"):
            measure, values = measure.removesuffix("_abs"), np.abs(values)
        percentile = _PERCENTILE.fullmatch(measure)
        if percentile is None and measure not in MEASURES:
            raise KeyError(f"no statistic is named {measure!r}; there are {', '.join(MEASURES)}")
        if not len(values):
            return float("nan")
        if percentile:
            return float(np.quantile(values, int(percentile[1]) / 100))
        return float(MEASURES[measure](values))

    def summary(self, *by: str, **columns: Summary) -> Records:
        """A row for each group: its key, then a statistic of it in each column.

        Args:
            by: columns to group by.
            columns: what `stat` takes, or a function of a group's rows.

        Example:
            >>> errors = Records({"way": ["a", "b", "a"], "error_mm": [1.0, 2.0, -3.0]})
            >>> table = errors.summary("way", trials="count error_mm", mean_mm="mean_abs error_mm")
            >>> table["way"].tolist(), table["mean_mm"].tolist()
            (['a', 'b'], [2.0, 2.0])
        """
        groups = self.group(*by)
        keys = [key if len(by) > 1 else (key,) for key in groups]
        made: dict[str, Any] = {name: [key[i] for key in keys] for i, name in enumerate(by)}
        for name, what in columns.items():
            made[name] = [
                own.stat(what) if isinstance(what, str) else what(own) for own in groups.values()
            ]
        return Records(made)


def _array(values: Any) -> np.ndarray:
    # Texts of several lengths, and cells that may be empty, keep what they are.
    array = np.asarray(values)
    mixed = isinstance(values, Sequence) and any(value is None for value in values)
    return np.asarray(values, object) if mixed or array.dtype.kind in "US" else array
