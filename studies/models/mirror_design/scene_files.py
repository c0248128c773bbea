"""What a finger's camera sees as the scene file that ``designopt trace`` reads."""

from __future__ import annotations

from designopt.io.spec_file import SpecFile
from designopt.io.toml_writing import format_toml
from optics.scene.writer import scene_tables
from studies.models.finger import Finger


def scene_file(finger: Finger) -> SpecFile:
    """The scene file of a finger."""
    text = format_toml(
        scene_tables(finger.scene()),
        "Camera, mirrors and pads; the intermediate phalanx is the world.\n"
        "designopt trace scene.toml --sweep pip=0:90:91 --pose dip=30",
    )
    return SpecFile("scene.toml", "camera, mirrors and pads, for `designopt trace`", text)
