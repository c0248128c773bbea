"""The finger as files that the other commands read."""

from __future__ import annotations

from designopt.io.spec_file import SpecFile
from designopt.io.toml_writing import toml_text
from studies.finger.spec import FingerSpec
from studies.models.linkage_files import spec_file
from studies.models.mirror_design.arrangement import Arrangement
from studies.models.mirror_design.scene_files import scene_file
from studies.models.pins import Pins, linkage_table


def spec_files(spec: FingerSpec, pins: Pins, arrangement: Arrangement) -> list[SpecFile]:
    """The linkage, driven at its joints and by its crank, and the scene."""
    spring = (spec.spring.stiffness, spec.spring.preload)
    by_crank = toml_text(
        linkage_table(pins, spec.body, "crank", spring),
        "The finger's linkage as the motor sees it: driven by its crank, and by the angle between\n"
        "plate and distal phalanx, which a spring holds in the straight finger.",
    )
    return [
        spec_file(pins, spec.body),
        SpecFile("linkage-crank.toml", "the linkage, driven by its crank", by_crank),
        scene_file(arrangement, spec.body, spec.mirrors),
    ]
