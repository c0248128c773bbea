"""The finger that images are made of as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path

from optics.scene.designed import DesignedScene
from studies.models.sensor.spec import FingerImagesSpec


def imaged_finger_design(spec: FingerImagesSpec, folder: Path | None) -> DesignedScene:
    """The scene in the file that the settings name, or that of the packaged finger.

    Args:
        spec: the study's settings.
        folder: of an earlier result; not needed, for a result does not hold its finger.

    Raises:
        UserError: that file describes no scene.
    """
    del folder
    if spec.scene:
        return DesignedScene.read(Path(spec.scene))
    with as_file(files("studies") / "finger" / "scene.toml") as packaged:
        return DesignedScene.read(packaged)
