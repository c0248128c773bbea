"""Paper A's bending directions (Table II, Fig. 12), and the chamber that shows them best."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.bending_direction.spec import BendingDirectionSpec

if TYPE_CHECKING:
    from designopt.design_kind import Design


def _run(spec: BendingDirectionSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.bending_direction.run import run

    return run(spec, context)


def _design(spec: BendingDirectionSpec, folder: Path | None) -> Design:
    from designopt.design_kind import Design
    from optics.design import CHAMBER
    from studies.models.soft_finger.design import soft_finger_design

    return Design(CHAMBER, soft_finger_design("bending-direction", spec, folder))


STUDY = Study(
    name="bending-direction",
    purpose="Which way a soft finger bends, from its coloured chamber: Table II of paper A",
    spec=BendingDirectionSpec,
    run=_run,
    design=_design,
)
