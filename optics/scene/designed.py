"""A scene together with the file it was read from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from designopt.design_kind import read_tables
from designopt.io.spec_files import validated
from optics.scene.file import SceneFile
from optics.scene.reading import build_scene
from optics.scene.scene import Scene


@dataclass(frozen=True)
class DesignedScene:
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
