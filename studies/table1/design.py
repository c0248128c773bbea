"""The chosen chamber as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from pathlib import Path

from designopt.errors import UserError
from optics.chamber.designed import DesignedChamber
from studies.table1.analysis import analyze
from studies.table1.spec import Table1Spec

NAME = "table1"


def table1_design(spec: Table1Spec, folder: Path | None) -> DesignedChamber:
    """The chamber with the identified camera constants, at the largest η that leaves the clearance.

    Args:
        spec: the study's settings.
        folder: of an earlier result; not needed, for the chamber follows from the settings.

    Raises:
        UserError: the table follows no camera constants with this chamber, or no η is left.
    """
    del folder
    found = analyze(spec).imaging
    if not bool(found.choice.ok):
        raise UserError(f"--set chamber: no η could be chosen: {found.choice.messages()[0]}")
    return DesignedChamber(NAME, found.chosen)
