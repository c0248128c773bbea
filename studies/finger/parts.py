"""Linkage and scene of a finger with their files, as their own packages draw and explore them."""

from __future__ import annotations

from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from optics.scene.designed import DesignedScene
from optics.scene.file import SceneFile
from optics.scene.writer import scene_tables
from studies.models.finger import Finger


def finger_linkage(finger: Finger) -> DesignedLinkage:
    """The linkage, driven at its joints.

    Raises:
        UserError: the finger has no pins.
    """
    return DesignedLinkage.of(parse_sketch(finger.linkage_tables(), finger.name), finger.name)


def finger_scene(finger: Finger) -> DesignedScene:
    """Camera, mirrors and pads.

    Raises:
        UserError: the finger has no camera.
    """
    file = SceneFile.model_validate(scene_tables(finger.scene()))
    return DesignedScene.of(file, finger.name)
