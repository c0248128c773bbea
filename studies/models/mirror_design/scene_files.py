"""A layout as the scene file that ``designopt trace`` reads."""

from __future__ import annotations

from designopt.io.spec_file import SpecFile
from designopt.io.toml_writing import toml_text
from studies.models.body import BodySpec
from studies.models.mirror_design.arrangement import Arrangement, scene_table
from studies.models.mirror_design.spec import MirrorSpec


def scene_file(arrangement: Arrangement, body: BodySpec, spec: MirrorSpec) -> SpecFile:
    """The scene file of a design."""
    text = toml_text(
        scene_table(arrangement, body, spec),
        "Camera, mirrors and pads; the intermediate phalanx is the world.\n"
        "designopt trace scene.toml --sweep pip=0:90:91 --pose dip=30",
    )
    return SpecFile("scene.toml", "camera, mirrors and pads, for `designopt trace`", text)
