"""The designed finger as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from designopt.progress import step_display
from designopt.study.study import Context
from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from optics.scene.designed import DesignedScene
from optics.scene.file import SceneFile
from studies.finger.spec import FingerSpec
from studies.models.linkage_design.analysis import design_linkage
from studies.models.mirror_design.arrangement import scene_table
from studies.models.mirror_design.design import design_mirrors
from studies.models.pins import linkage_table

NAME = "finger"

DECIDING = {"body", "linkage", "mirrors"}
"""The settings on which linkage and mirrors depend."""


@dataclass(frozen=True)
class DesignedFinger:
    """Linkage, camera, mirrors and pads of one finger.

    Attributes:
        name: in titles and file names.
        spec: the requirements, body and spring.
        linkage: driven at its joints; flexion is negative.
        scene: camera, mirrors and pads; flexion is positive, the intermediate phalanx the world.
    """

    name: str
    spec: FingerSpec
    linkage: DesignedLinkage
    scene: DesignedScene


def finger_design(spec: FingerSpec, folder: Path | None) -> DesignedFinger:
    """The finger that the study designs for these requirements.

    Args:
        spec: the requirements.
        folder: the ``specs`` of an earlier result with them; the package has those of the default
            body, linkage and mirrors.

    Raises:
        UserError: the folder lacks its files, or they have been spoilt.
    """
    with ExitStack() as stack:
        if folder is None and _deciding(spec) == _deciding(FingerSpec()):
            folder = stack.enter_context(as_file(files("studies") / "finger"))
        if folder is not None:
            linkage = DesignedLinkage.read(folder / "linkage.toml")
            return DesignedFinger(NAME, spec, linkage, DesignedScene.read(folder / "scene.toml"))
        context = Context(0, "float64", stack.enter_context(step_display()))
        with context.step("Linkage"):
            pins = design_linkage(spec.linkage_spec(), context.seed).pins
        mirrors = design_mirrors(spec.body, spec.mirrors, context)
    sketch = parse_sketch(linkage_table(pins, spec.body, "joints"), NAME)
    scene = scene_table(mirrors.arrangement, spec.body, spec.mirrors)
    return DesignedFinger(
        NAME,
        spec,
        DesignedLinkage.of(sketch, NAME),
        DesignedScene.of(SceneFile.model_validate(scene), NAME),
    )


def _deciding(spec: FingerSpec) -> dict[str, Any]:
    return spec.model_dump(include=DECIDING)
