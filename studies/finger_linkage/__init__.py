"""The linkage of paper B's finger, designed for the largest least transmission angle."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.models.linkage_design.spec import FingerLinkageSpec

if TYPE_CHECKING:
    from designopt.design_kind import Design


def _run(spec: FingerLinkageSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.finger_linkage.run import run

    return run(spec, context)


def _design(spec: FingerLinkageSpec, folder: Path | None) -> Design:
    from designopt.design_kind import Design
    from kinematics.design import LINKAGE
    from studies.finger_linkage.design import finger_linkage_design

    return Design(LINKAGE, finger_linkage_design(spec, folder))


STUDY = Study(
    name="finger-linkage",
    purpose="The pins of paper B's six-bar finger, for the largest least transmission angle",
    spec=FingerLinkageSpec,
    run=_run,
    design=_design,
)
