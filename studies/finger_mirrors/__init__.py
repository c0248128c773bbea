"""Mirrors of the finger: one camera that sees all pads in every posture, and bears its errors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.models.mirror_design.spec import FingerMirrorsSpec

if TYPE_CHECKING:
    from designopt.design_kind import Design


def _run(spec: FingerMirrorsSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.finger_mirrors.run import run

    return run(spec, context)


def _design(spec: FingerMirrorsSpec, folder: Path | None) -> Design:
    from designopt.design_kind import Design
    from optics.design import SCENE
    from studies.finger_mirrors.designed import finger_mirrors_design

    return Design(SCENE, finger_mirrors_design(spec, folder))


STUDY = Study(
    name="finger-mirrors",
    purpose="Camera and mirrors of the finger: every pad seen in every posture, errors included",
    spec=FingerMirrorsSpec,
    run=_run,
    design=_design,
)
