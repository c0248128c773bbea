"""A finger as the files that other commands read."""

from __future__ import annotations

from designopt import SpecFile, format_toml
from optics.scene.writer import scene_tables
from studies.models.finger import Finger
from studies.models.finger_file import format_finger


def linkage_file(finger: Finger) -> SpecFile:
    """The file of the linkage, driven at its joints."""
    dip = " --sweep dip=0" if finger.kind.freedoms > 1 else ""
    text = format_toml(
        finger.linkage_tables(),
        "The finger's linkage, driven at its joints; flexion is negative.\n"
        f"designopt solve linkage.toml --sweep pip=0:-90:91{dip}",
    )
    return SpecFile("linkage.toml", "the linkage, for `designopt solve`", text)


def scene_file(finger: Finger) -> SpecFile:
    """The scene file of a finger."""
    text = format_toml(
        scene_tables(finger.scene()),
        "Camera, mirrors and pads; the intermediate phalanx is the world.\n"
        "designopt trace scene.toml --sweep pip=0:90:91 --pose dip=30",
    )
    return SpecFile("scene.toml", "camera, mirrors and pads, for `designopt trace`", text)


def finger_files(finger: Finger) -> list[SpecFile]:
    """The finger, and what follows from it: its linkage, driven both ways, and its scene."""
    found = [
        SpecFile("finger.toml", "every dimension, for `designopt explore`", format_finger(finger)),
        linkage_file(finger),
    ]
    if finger.kind.freedoms > 1:  # else it is the same file, whichever body is driven
        by_crank = format_toml(
            finger.linkage_tables("crank"),
            "The finger's linkage as the motor drives it: by its crank, and by the angle between\n"
            "plate and distal phalanx, which a spring holds in the straight finger.",
        )
        words = "the linkage, driven by its crank"
        found.append(SpecFile("linkage-crank.toml", words, by_crank))
    return [*found, scene_file(finger)]
