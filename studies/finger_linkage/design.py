"""The designed linkage as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from pathlib import Path

from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from studies.models.finger_file import packaged_finger
from studies.models.linkage_design.searching import search
from studies.models.linkage_design.spec import FingerLinkageSpec

NAME = "finger-linkage"

SEED = 0
"""Of the search's starts; that of ``designopt run``."""

DECIDING = {"body", "limits", "search"}
"""The settings on which the design depends; the others say how it is judged."""


def finger_linkage_design(spec: FingerLinkageSpec, folder: Path | None) -> DesignedLinkage:
    """The linkage that the study designs for these settings, driven at its joints.

    Args:
        spec: the study's settings.
        folder: the ``specs`` of an earlier result with them; the package has that of the default.

    Raises:
        UserError: the folder lacks its file, or it has been spoilt.
    """
    if folder is not None:
        return DesignedLinkage.read(folder / "linkage.toml")
    default = FingerLinkageSpec()
    if spec.model_dump(include=DECIDING) == default.model_dump(include=DECIDING):
        finger = packaged_finger()
    else:
        finger = search(spec, SEED).finger
    return DesignedLinkage.of(parse_sketch(finger.linkage_tables(), NAME), NAME)
