"""Linkage files as designs for ``designopt explore`` and ``designopt export``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from designopt.design_kind import DesignKind
from designopt.study.study import lazily

if TYPE_CHECKING:
    from kinematics.io.designed import DesignedLinkage


def _mjcf(model: DesignedLinkage) -> str:
    from kinematics.export.mjcf import linkage_mjcf

    return linkage_mjcf(model.linkage)


LINKAGE = DesignKind(
    "linkage",
    "joints",
    lazily("kinematics.io.designed:DesignedLinkage.read"),
    lazily("kinematics.explore.explorer:LinkageExplorer"),
    lazily("kinematics.export.drawing:make_linkage_drawing"),
    lazily("kinematics.export.drawing:linkage_quantities"),
    _mjcf,
    parametric=lazily("kinematics.parametric.linkage_design:LinkageDesign"),
    command="designopt solve",
)
