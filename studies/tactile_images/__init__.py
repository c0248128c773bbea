"""Tactile images of the finger: its pads found in synthetic images, unwarped, and compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.tactile_images.spec import TactileImagesSpec

if TYPE_CHECKING:
    from designopt.design_kind import Design


def _run(spec: TactileImagesSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX and OpenCV.
    from studies.tactile_images.run import run

    return run(spec, context)


def _design(spec: TactileImagesSpec, folder: Path | None) -> Design:
    from designopt.design_kind import Design
    from optics.design import SCENE
    from studies.models.sensor.design import imaged_finger_design

    return Design(SCENE, imaged_finger_design(spec, folder))


STUDY = Study(
    name="tactile-images",
    purpose="Images of the finger: every view found, unwarped, and imprints made visible",
    spec=TactileImagesSpec,
    run=_run,
    design=_design,
)
