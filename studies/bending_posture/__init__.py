"""Paper A's bending posture (Figs. 10 and 11): a network that reads markers from the chamber."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.bending_posture.spec import BendingPostureSpec

if TYPE_CHECKING:
    from designopt.design_kind import Design


def _run(spec: BendingPostureSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.bending_posture.run import run

    return run(spec, context)


def _design(spec: BendingPostureSpec, folder: Path | None) -> Design:
    from designopt.design_kind import Design
    from optics.design import CHAMBER
    from studies.models.soft_finger.design import soft_finger_design

    return Design(CHAMBER, soft_finger_design("bending-posture", spec, folder))


STUDY = Study(
    name="bending-posture",
    purpose="How a soft finger is bent, from its chamber, by a network: Figs. 10 and 11 of paper A",
    spec=BendingPostureSpec,
    run=_run,
    design=_design,
)
