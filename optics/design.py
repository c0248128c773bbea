"""Scene and chamber files as designs for ``designopt explore`` and ``designopt export``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from designopt.design_kind import DesignKind, Ranges
from designopt.errors import UserError
from designopt.study.study import lazily

if TYPE_CHECKING:
    from optics.chamber.designed import DesignedChamber
    from optics.parametric.chamber import ChamberParameters


def _chamber_parameters(model: DesignedChamber, over: Ranges) -> ChamberParameters:
    from optics.parametric.chamber import ChamberParameters

    if over:
        raise UserError(f"--over {next(iter(over))}: a chamber has no joints; leave it out")
    return ChamberParameters(model)


SCENE = DesignKind(
    "scene",
    "camera",
    lazily("optics.scene.designed:DesignedScene.read"),
    lazily("optics.explore.scene:SceneExplorer"),
    lazily("optics.export.scene_drawing:make_scene_drawing"),
    lazily("optics.export.scene_drawing:scene_quantities"),
    parametric=lazily("optics.parametric.scene:SceneParameters"),
    command="designopt trace",
)

CHAMBER = DesignKind(
    "chamber",
    "chamber",
    lazily("optics.chamber.designed:DesignedChamber.read"),
    lazily("optics.explore.chamber:ChamberExplorer"),
    lazily("optics.export.chamber_drawing:make_chamber_drawing"),
    lazily("optics.export.chamber_drawing:chamber_quantities"),
    parametric=_chamber_parameters,
)
