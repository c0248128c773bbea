"""The grasping finger as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from designopt.design_kind import Design
from kinematics.design import LINKAGE
from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from studies.models.finger import Finger
from studies.models.grasp.cases import finger_of
from studies.models.grasp.mjcf import grasp_mjcf
from studies.models.grasp.spec import GraspSpec

NAME = "finger-grasp"


@dataclass(frozen=True)
class DesignedGrasp(DesignedLinkage):
    """The finger's linkage with what closes it.

    Attributes:
        finger: body, pins and spring.
    """

    finger: Finger


GRASP = replace(LINKAGE, mjcf=lambda model: grasp_mjcf(model.finger))
"""The linkage with its spring and servo, joint stops and pads as a MuJoCo model."""


def design(spec: GraspSpec, folder: Path | None) -> Design:
    """The linkage of the study's pins, driven by its crank, with its spring.

    Args:
        spec: the study's settings.
        folder: of an earlier result; not needed, for the pins stand in the settings.

    Raises:
        UserError: no linkage follows from them.
    """
    del folder
    finger = finger_of(spec)
    made = DesignedLinkage.of(parse_sketch(finger.linkage_tables("crank"), NAME), NAME)
    return Design(GRASP, DesignedGrasp(made.name, made.sketch, made.linkage, finger))
