"""Paper B's finger from its requirements: linkage, mirrors, grasp."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.finger.spec import FingerSpec

if TYPE_CHECKING:
    from designopt.design_kind import Design


def _run(spec: FingerSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.finger.run import run

    return run(spec, context)


def _design(spec: FingerSpec, folder: Path | None) -> Design:
    from designopt.design_kind import Design
    from studies.finger.bench import FingerBench
    from studies.finger.design import finger_design
    from studies.finger.kind import FINGER

    kind = replace(FINGER, explorer=lambda finger: FingerBench(finger, spec.mirrors.floor))
    return Design(kind, finger_design(spec, folder))


STUDY = Study(
    name="finger",
    purpose="Requirements in, finger out: paper B's linkage, mirrors and camera, and its grasp",
    spec=FingerSpec,
    run=_run,
    design=_design,
)
