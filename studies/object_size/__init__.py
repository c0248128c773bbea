"""The diameter of a grasped bottle from the chamber of the finger around it (paper A, Fig. 13)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.object_size.spec import ObjectSizeSpec

if TYPE_CHECKING:
    from designopt.design_kind import Design


def _run(spec: ObjectSizeSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.object_size.run import run

    return run(spec, context)


def _design(spec: ObjectSizeSpec, folder: Path | None) -> Design:
    from designopt.design_kind import Design
    from optics.design import CHAMBER
    from studies.models.soft_finger.design import soft_finger_design

    return Design(CHAMBER, soft_finger_design("object-size", spec, folder))


STUDY = Study(
    name="object-size",
    purpose="How wide a grasped bottle is, from the posture that its finger's chamber shows",
    spec=ObjectSizeSpec,
    run=_run,
    design=_design,
)
