"""The grasping finger as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from kinematics.design import LINKAGE
from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from studies.models.grasp.spec import GraspSpec
from studies.models.pins import linkage_table

NAME = "finger-grasp"


@dataclass(frozen=True)
class DesignedGrasp(DesignedLinkage):
    """The finger's linkage with what closes it.

    Attributes:
        spec: the settings.
    """

    spec: GraspSpec


def finger_grasp_design(spec: GraspSpec, folder: Path | None) -> DesignedGrasp:
    """The linkage of the study's pins, driven by its crank, with its spring.

    Args:
        spec: the study's settings.
        folder: of an earlier result; not needed, for the pins stand in the settings.

    Raises:
        UserError: no linkage follows from them.
    """
    del folder
    spring = (spec.spring_stiffness, spec.preload)
    table = linkage_table(spec.pins.design(), spec.body, "crank", spring)
    made = DesignedLinkage.of(parse_sketch(table, NAME), NAME)
    return DesignedGrasp(made.name, made.sketch, made.linkage, spec)


def _mjcf(model: DesignedGrasp) -> str:
    from studies.models.grasp.mjcf import grasp_mjcf

    return grasp_mjcf(model.linkage, model.spec.body, model.spec.servo_stiffness)


GRASP = replace(LINKAGE, mjcf=_mjcf)
"""The linkage with its spring and servo, joint stops and pads as a MuJoCo model."""
