"""The designed finger as ``designopt explore`` and ``designopt export`` take it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from designopt.design_kind import DesignKind
from studies.finger.spec import FingerSpec

if TYPE_CHECKING:
    from designopt.explore.bench import Bench
    from designopt.export.json import Quantity
    from designopt.export.sheet import Sheet
    from studies.finger.design import DesignedFinger


def _read(folder: Path) -> DesignedFinger:
    from studies.finger.design import finger_design

    return finger_design(FingerSpec(), folder)


def _explorer(model: DesignedFinger) -> Bench:
    from studies.finger.bench import FingerBench

    return FingerBench(model)


def _drawing(model: DesignedFinger) -> Sheet:
    from studies.finger.sheet import finger_sheet

    return finger_sheet(model)


def _quantities(model: DesignedFinger) -> Sequence[Quantity]:
    from studies.finger.sheet import finger_quantities

    return finger_quantities(model)


def _mjcf(model: DesignedFinger) -> str:
    from studies.finger.mjcf import finger_mjcf

    return finger_mjcf(model)


FINGER = DesignKind("finger", "finger", _read, _explorer, _drawing, _quantities, _mjcf)
