"""The linkage of paper B's finger, designed for the largest least transmission angle."""

from __future__ import annotations

from designopt.study.study import Study, lazily
from studies.models.linkage_design.spec import FingerLinkageSpec

STUDY = Study(
    name="finger-linkage",
    purpose="The pins of paper B's six-bar finger, for the largest least transmission angle",
    spec=FingerLinkageSpec,
    run=lazily("studies.finger_linkage.run:run"),
    design=lazily("studies.finger_linkage.run:design"),
)
