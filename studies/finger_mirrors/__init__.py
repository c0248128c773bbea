"""Mirrors of the finger: one camera that shows all pads in every posture, errors included."""

from __future__ import annotations

from designopt.study.study import Study, lazily
from studies.models.mirror_design.spec import FingerMirrorsSpec

STUDY = Study(
    name="finger-mirrors",
    purpose="Camera and mirrors of the finger: every pad seen in every posture, errors included",
    spec=FingerMirrorsSpec,
    run=lazily("studies.finger_mirrors.run:run"),
    design=lazily("studies.finger_mirrors.run:design"),
)
