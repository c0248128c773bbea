"""The soft finger's chamber as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from pathlib import Path

from optics.chamber.designed import DesignedChamber
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.spec import ChamberImagesSpec


def soft_finger_design(name: str, spec: ChamberImagesSpec, folder: Path | None) -> DesignedChamber:
    """The chamber whose images a study looks at.

    Args:
        name: of the study.
        spec: its settings.
        folder: of an earlier result; not needed, for the chamber follows from the settings.

    Raises:
        UserError: no chamber follows from them.
    """
    del folder
    return DesignedChamber(name, SoftFinger.of(spec).chamber)
