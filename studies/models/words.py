"""Words of reports: those of several packages together, numbers of things, ranges of numbers."""

from __future__ import annotations

from importlib.resources import files

import numpy as np

from designopt.study.report import WORDS


def words_of(*packages: str) -> str:
    """The texts of the packages' ``report.md``, one after the other, for `designopt.Report`.

    Example:
        >>> "# Figures" in words_of("studies.models.linkage_design").splitlines()
        True
    """
    return "\n".join((files(package) / WORDS).read_text(encoding="utf-8") for package in packages)


def many(count: int, word: str) -> str:
    """A number of things.

    Example:
        >>> many(1, "seed"), many(3, "seed")
        ('one seed', '3 seeds')
    """
    return f"one {word}" if count == 1 else f"{count} {word}s"


def spread(values: np.ndarray, places: int, unit: str = "") -> str:
    """The least and the largest of some values, of those that are finite.

    Example:
        >>> spread(np.array([1.04, np.nan, 2.0]), 1, " %"), spread(np.ones(2), 1)
        ('1.0–2.0 %', '1.0')
    """
    if not len(finite := values[np.isfinite(values)]):
        return "none"
    low, high = f"{finite.min():.{places}f}", f"{finite.max():.{places}f}"
    return (low if low == high else f"{low}–{high}") + unit
