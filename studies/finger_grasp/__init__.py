"""How paper B's finger closes: pinching, adapting and opening, with its contact forces."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.models.grasp.spec import GraspSpec

if TYPE_CHECKING:
    from designopt.design_kind import Design


def _run(spec: GraspSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.finger_grasp.run import run

    return run(spec, context)


def _design(spec: GraspSpec, folder: Path | None) -> Design:
    from designopt.design_kind import Design
    from studies.finger_grasp.design import GRASP, finger_grasp_design

    return Design(GRASP, finger_grasp_design(spec, folder))


STUDY = Study(
    name="finger-grasp",
    purpose="Paper B's finger closing on objects: pinch, adaptive grasp, contact forces",
    spec=GraspSpec,
    run=_run,
    design=_design,
)
