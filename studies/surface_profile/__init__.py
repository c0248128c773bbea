"""Surfaces slid along the soft finger: their profile and kind from its chamber's images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.surface_profile.spec import SurfaceProfileSpec

if TYPE_CHECKING:
    from designopt.design_kind import Design


def _run(spec: SurfaceProfileSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX and OpenCV.
    from studies.surface_profile.run import run

    return run(spec, context)


def _design(spec: SurfaceProfileSpec, folder: Path | None) -> Design:
    from designopt.design_kind import Design
    from optics.design import CHAMBER
    from studies.models.soft_finger.design import soft_finger_design

    return Design(CHAMBER, soft_finger_design("surface-profile", spec, folder))


STUDY = Study(
    name="surface-profile",
    purpose="Soft finger: profile and kind of a surface it is slid along, in px and in mm",
    spec=SurfaceProfileSpec,
    run=_run,
    design=_design,
)
