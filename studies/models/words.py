"""The words of a report that is put together from what several packages find."""

from __future__ import annotations

from importlib.resources import files

from designopt.study.report import WORDS


def words_of(*packages: str) -> str:
    """The texts of the packages' ``report.md``, one after the other, for `designopt.Report`.

    Example:
        >>> "# Figures" in words_of("studies.models.linkage_design").splitlines()
        True
    """
    return "\n".join((files(package) / WORDS).read_text(encoding="utf-8") for package in packages)
