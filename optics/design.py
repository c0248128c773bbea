"""Scene and chamber files as designs for ``designopt explore`` and ``designopt export``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from designopt.design_kind import DesignKind
from designopt.export.json import Quantity

if TYPE_CHECKING:
    from designopt.explore.bench import Bench
    from designopt.export.drawing import Drawing
    from optics.chamber.designed import DesignedChamber
    from optics.scene.designed import DesignedScene


def _read_scene(path: Path) -> DesignedScene:
    from optics.scene.designed import DesignedScene

    return DesignedScene.read(path)


def _scene_explorer(model: DesignedScene) -> Bench:
    from optics.explore.scene_bench import SceneBench

    return SceneBench(model)


def _scene_drawing(model: DesignedScene) -> Drawing:
    from optics.export.scene_drawing import make_scene_drawing

    return make_scene_drawing(model)


def _scene_quantities(model: DesignedScene) -> Sequence[Quantity]:
    from optics.export.scene_drawing import scene_quantities

    return scene_quantities(model)


def _read_chamber(path: Path) -> DesignedChamber:
    from optics.chamber.designed import DesignedChamber

    return DesignedChamber.read(path)


def _chamber_explorer(model: DesignedChamber) -> Bench:
    from optics.explore.chamber_bench import ChamberBench

    return ChamberBench(model)


def _chamber_drawing(model: DesignedChamber) -> Drawing:
    from optics.export.chamber_drawing import make_chamber_drawing

    return make_chamber_drawing(model)


def _chamber_quantities(model: DesignedChamber) -> Sequence[Quantity]:
    from optics.export.chamber_drawing import chamber_quantities

    return chamber_quantities(model)


SCENE = DesignKind(
    "scene",
    "camera",
    _read_scene,
    _scene_explorer,
    _scene_drawing,
    _scene_quantities,
    command="designopt trace",
)

CHAMBER = DesignKind(
    "chamber", "chamber", _read_chamber, _chamber_explorer, _chamber_drawing, _chamber_quantities
)
