"""Scene and chamber files as designs for ``designopt explore`` and ``designopt export``."""

from __future__ import annotations

from designopt.design_kind import DesignKind
from designopt.study.study import lazily

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
    parametric=lazily("optics.parametric.chamber:ChamberParameters"),
)
