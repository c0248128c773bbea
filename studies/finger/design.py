"""The finger that the study designs, as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from designopt.progress import step_display
from designopt.study.study import Context
from studies.finger.spec import FingerSpec, SpringSpec
from studies.models.finger import Finger, FingerSpring
from studies.models.finger_file import packaged_finger, read_finger
from studies.models.linkage_design.analysis import design_linkage
from studies.models.mirror_design.design import design_mirrors

DECIDING = {"body", "linkage", "mirrors"}
"""The settings on which linkage and mirrors depend."""


def finger_design(spec: FingerSpec, folder: Path | None) -> Finger:
    """The finger that the study designs for these requirements.

    Args:
        spec: the requirements.
        folder: the ``specs`` of an earlier result with them; the package has those of the default
            body, linkage and mirrors.

    Raises:
        UserError: the folder lacks its files, or they have been spoilt.
    """
    if folder is not None:
        finger = read_finger(folder)
    elif _deciding(spec) == _deciding(FingerSpec()):
        finger = packaged_finger()
    else:
        with step_display() as step:
            context = Context(0, "float64", step)
            with context.step("Linkage"):
                finger = design_linkage(spec.linkage_spec(), context.seed).finger
            finger = design_mirrors(finger, spec.mirrors, context).finger
    return replace(finger, spring=spring_from(spec.spring))


def spring_from(spec: SpringSpec) -> FingerSpring:
    """Spring and motor of the settings."""
    return FingerSpring(spec.stiffness, spec.preload, spec.servo)


def _deciding(spec: FingerSpec) -> dict[str, Any]:
    return spec.model_dump(include=DECIDING)
