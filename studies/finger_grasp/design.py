"""The grasping finger as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from designopt.design_kind import Design
from kinematics.design import LINKAGE
from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from studies.models.grasp.cases import finger_of
from studies.models.grasp.mjcf import grasp_mjcf
from studies.models.grasp.spec import GraspSpec

NAME = "finger-grasp"


def design(spec: GraspSpec, folder: Path | None) -> Design:
    """The linkage of the study's pins, driven by its crank.

    As a MuJoCo model it has its spring and servo, joint stops and pads.

    Args:
        spec: the study's settings.
        folder: of an earlier result; not needed, for the pins stand in the settings.

    Raises:
        UserError: no linkage follows from them.
    """
    del folder
    finger = finger_of(spec)
    kind = replace(LINKAGE, mjcf=lambda _: grasp_mjcf(finger))
    sketch = parse_sketch(finger.linkage_tables("crank"), NAME)
    return Design(kind, DesignedLinkage.of(sketch, NAME))
