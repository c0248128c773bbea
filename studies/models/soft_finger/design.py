"""The soft finger's chamber as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from pathlib import Path

from designopt.design_kind import Design
from optics.chamber.designed import DesignedChamber
from optics.design import CHAMBER
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.spec import ChamberImagesSpec


def chamber_design(name: str, spec: ChamberImagesSpec, folder: Path | None) -> Design:
    """The chamber whose images a study analyzes.

    A study gives ``design=partial(lazily("studies.models.soft_finger.design:chamber_design"),
    "its-name")``.

    Args:
        name: of the study.
        spec: its settings.
        folder: of an earlier result; not needed, for the chamber follows from the settings.

    Raises:
        UserError: no chamber follows from them.
    """
    del folder
    return Design(CHAMBER, DesignedChamber(name, SoftFinger.of(spec).chamber))
