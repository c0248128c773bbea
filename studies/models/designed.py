"""Linkage and scene of a finger with their files, as their own packages draw and explore them."""

from __future__ import annotations

from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from optics.scene.designed import DesignedScene
from optics.scene.file import SceneFile
from optics.scene.writer import scene_tables
from studies.models.finger import Finger


def designed_linkage(finger: Finger, name: str = "") -> DesignedLinkage:
    """The linkage, driven at its joints.

    Args:
        finger: with pins.
        name: in titles and file names; by default the finger's.

    Raises:
        UserError: the finger has no pins.
    """
    name = name or finger.name
    return DesignedLinkage.of(parse_sketch(finger.linkage_tables(), name), name)


def designed_scene(finger: Finger, name: str = "") -> DesignedScene:
    """Camera, mirrors and pads.

    Args:
        finger: with a camera.
        name: in titles and file names; by default the finger's.

    Raises:
        UserError: the finger has no camera.
    """
    file = SceneFile.model_validate(scene_tables(finger.scene()))
    return DesignedScene.of(file, name or finger.name)
