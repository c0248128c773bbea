"""Joint angles from the finger's images: the paper's gap, better ways, and their bound."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.proprioception.spec import ProprioceptionSpec

if TYPE_CHECKING:
    from designopt.design_kind import Design


def _run(spec: ProprioceptionSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX and OpenCV.
    from studies.proprioception.run import run

    return run(spec, context)


def _design(spec: ProprioceptionSpec, folder: Path | None) -> Design:
    from designopt.design_kind import Design
    from optics.design import SCENE
    from studies.models.sensor.design import imaged_finger_design

    return Design(SCENE, imaged_finger_design(spec, folder))


STUDY = Study(
    name="proprioception",
    purpose="Joint angles from images: gap, edge, all corners, calibrated with and without labels",
    spec=ProprioceptionSpec,
    run=_run,
    design=_design,
)
