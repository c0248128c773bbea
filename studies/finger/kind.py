"""Finger files as designs for ``designopt explore`` and ``designopt export``."""

from __future__ import annotations

from designopt.design_kind import DesignKind
from designopt.study.study import lazily

FINGER = DesignKind(
    "finger",
    "finger",
    read=lazily("studies.models.finger_file:read_finger"),
    explorer=lazily("studies.finger.bench:FingerBench"),
    drawing=lazily("studies.finger.drawing:make_finger_drawing"),
    quantities=lazily("studies.finger.drawing:finger_quantities"),
    mjcf=lazily("studies.models.grasp.mjcf:grasp_mjcf"),
    assembly=lazily("studies.models.manufacture.parts:make_assembly"),
    shared=("camera",),
)
