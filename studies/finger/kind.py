"""Finger files as designs for ``designopt explore`` and ``designopt export``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from designopt.design_kind import DesignKind

if TYPE_CHECKING:
    from designopt.explore.bench import Bench
    from designopt.export.drawing import Drawing
    from designopt.export.json import Quantity
    from studies.models.finger import Finger


def _read(path: Path) -> Finger:
    from studies.models.finger_file import read_finger

    return read_finger(path)


def _explorer(model: Finger) -> Bench:
    from studies.finger.bench import FingerBench

    return FingerBench(model)


def _drawing(model: Finger) -> Drawing:
    from studies.finger.drawing import make_finger_drawing

    return make_finger_drawing(model)


def _quantities(model: Finger) -> Sequence[Quantity]:
    from studies.finger.drawing import finger_quantities

    return finger_quantities(model)


def _mjcf(model: Finger) -> str:
    from studies.models.grasp.mjcf import grasp_mjcf

    return grasp_mjcf(model)


FINGER = DesignKind(
    "finger", "finger", _read, _explorer, _drawing, _quantities, _mjcf, shared=("camera",)
)
