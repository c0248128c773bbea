"""The finger as files that the other commands read."""

from __future__ import annotations

from designopt.io.spec import SpecFile
from designopt.io.toml_writing import format_toml
from studies.models.finger import Finger
from studies.models.finger_file import format_finger
from studies.models.spec_files import linkage_file, scene_file


def spec_files(finger: Finger) -> list[SpecFile]:
    """The finger, and what follows from it: its linkage, driven both ways, and its scene."""
    by_crank = format_toml(
        finger.linkage_tables("crank"),
        "The finger's linkage as the motor sees it: driven by its crank, and by the angle between\n"
        "plate and distal phalanx, which a spring holds in the straight finger.",
    )
    return [
        SpecFile("finger.toml", "every dimension, for `designopt explore`", format_finger(finger)),
        linkage_file(finger),
        SpecFile("linkage-crank.toml", "the linkage, driven by its crank", by_crank),
        scene_file(finger),
    ]
