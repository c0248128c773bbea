"""The grasping finger as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from kinematics.design import LINKAGE
from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from studies.models.finger import Finger
from studies.models.grasp.cases import finger_of
from studies.models.grasp.spec import GraspSpec

NAME = "finger-grasp"


@dataclass(frozen=True)
class DesignedGrasp(DesignedLinkage):
    """The finger's linkage with what closes it.

    Attributes:
        finger: body, pins and spring.
    """

    finger: Finger


def finger_grasp_design(spec: GraspSpec, folder: Path | None) -> DesignedGrasp:
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
    return DesignedGrasp(made.name, made.sketch, made.linkage, finger)


def _mjcf(model: DesignedGrasp) -> str:
    from studies.models.grasp.mjcf import grasp_mjcf

    return grasp_mjcf(model.finger)


GRASP = replace(LINKAGE, mjcf=_mjcf)
"""The linkage with its spring and servo, joint stops and pads as a MuJoCo model."""
