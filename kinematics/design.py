"""Linkage files as designs for ``designopt explore`` and ``designopt export``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from designopt.design_kind import DesignKind
from designopt.export.json import Quantity

if TYPE_CHECKING:
    from designopt.explore.bench import Bench
    from designopt.export.drawing import Drawing
    from kinematics.io.designed import DesignedLinkage


def _read(path: Path) -> DesignedLinkage:
    from kinematics.io.designed import DesignedLinkage

    return DesignedLinkage.read(path)


def _explorer(model: DesignedLinkage) -> Bench:
    from kinematics.explore.bench import LinkageBench

    return LinkageBench(model)


def _drawing(model: DesignedLinkage) -> Drawing:
    from kinematics.export.drawing import make_linkage_drawing

    return make_linkage_drawing(model)


def _quantities(model: DesignedLinkage) -> Sequence[Quantity]:
    from kinematics.export.drawing import linkage_quantities

    return linkage_quantities(model)


def _mjcf(model: DesignedLinkage) -> str:
    from kinematics.export.mjcf import linkage_mjcf

    return linkage_mjcf(model.linkage)


LINKAGE = DesignKind(
    "linkage", "joints", _read, _explorer, _drawing, _quantities, _mjcf, command="designopt solve"
)
