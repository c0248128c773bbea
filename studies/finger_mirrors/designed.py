"""The designed mirrors as a file, and as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from pathlib import Path

from designopt.progress import step_display
from designopt.study.study import Context
from optics.scene.designed import DesignedScene
from optics.scene.file import SceneFile
from optics.scene.writer import scene_tables
from studies.models.finger import Body, Finger
from studies.models.finger_file import packaged_finger
from studies.models.mirror_design.design import design_mirrors
from studies.models.mirror_design.spec import FingerMirrorsSpec, MirrorSpec

NAME = "finger-mirrors"

SEED = 0
"""Of the search's starts; that of ``designopt run``."""

DECIDING = {"body", *MirrorSpec.model_fields}
"""The settings on which the design depends; the others say how it is judged."""


def finger_mirrors_design(spec: FingerMirrorsSpec, folder: Path | None) -> DesignedScene:
    """Camera and mirrors that the study designs for these settings.

    Args:
        spec: the study's settings.
        folder: the ``specs`` of an earlier result with them; the package has that of the default.

    Raises:
        UserError: the folder lacks its file, or it has been spoilt.
    """
    if folder is not None:
        return DesignedScene.read(folder / "scene.toml")
    if spec.model_dump(include=DECIDING) == FingerMirrorsSpec().model_dump(include=DECIDING):
        finger = packaged_finger()
    else:
        with step_display() as step:
            context = Context(SEED, "float64", step)
            finger = design_mirrors(Finger.of(Body.of(spec.body)), spec, context).finger
    table = scene_tables(finger.scene())
    return DesignedScene.of(SceneFile.model_validate(table), NAME)
