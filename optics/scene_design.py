"""A scene file as the design that ``designopt explore`` and ``designopt export`` take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from designopt.designs import Design, DesignFile, Quantity, read_tables
from designopt.export.sheet import Sheet
from designopt.io.spec_files import validated
from optics.scene.file import SceneFile
from optics.scene.reading import build_scene
from optics.scene.scene import Scene

if TYPE_CHECKING:
    from designopt.explore.bench import Bench


@dataclass(frozen=True)
class DesignedScene(Design):
    """A scene and the file it was read from.

    Attributes:
        name: the scene's.
        file: the file's content.
        scene: the same as arrays.
    """

    name: str
    file: SceneFile
    scene: Scene

    @classmethod
    def of(cls, file: SceneFile, source: str) -> DesignedScene:
        """The design of a file's content; see `build_scene`."""
        scene = build_scene(file, source)
        return cls(scene.layout.name, file, scene)

    @classmethod
    def read(cls, path: Path) -> DesignedScene:
        """The design of a scene file; see `read_scene`."""
        return cls.of(
            validated(SceneFile, read_tables(path, "scene", "camera"), str(path)), str(path)
        )

    def bench(self) -> Bench:
        """Joint angles, camera and mirrors as knobs; rays by path, coverage, px/mm."""
        from optics.explore.scene_bench import SceneBench

        return SceneBench(self)

    def sheet(self) -> Sheet:
        """Mirrors, pads, blockers and the camera on layers of their own."""
        from optics.export.scene_sheet import scene_sheet

        return scene_sheet(self)

    def quantities(self) -> Sequence[Quantity]:
        """Every number of the file."""
        from optics.export.scene_sheet import scene_quantities

        return scene_quantities(self)


FILE = DesignFile("scene", "camera", DesignedScene.read, "designopt trace")
