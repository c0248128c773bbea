"""The finger that images are made of as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from pathlib import Path

from designopt.design_kind import Design
from optics.design import SCENE
from optics.scene.designed import DesignedScene
from optics.scene.file import SceneFile
from optics.scene.writer import scene_tables
from studies.models.sensor.imaged import designed
from studies.models.sensor.spec import FingerImagesSpec


def imaged_finger_design(spec: FingerImagesSpec, folder: Path | None) -> Design:
    """The scene in the file that the settings name, or that of the bare finger.

    Args:
        spec: the study's settings.
        folder: of an earlier result; not needed, for a result does not hold its finger.

    Raises:
        UserError: that file describes no scene.
    """
    del folder
    scene = designed(spec.scene)
    file = SceneFile.model_validate(scene_tables(scene))
    return Design(SCENE, DesignedScene.of(file, spec.scene or scene.layout.name))
