"""Finger files as designs for ``designopt explore`` and ``designopt export``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from designopt.design_kind import DesignKind, Ranges
from designopt.errors import UserError
from designopt.study.study import lazily

if TYPE_CHECKING:
    from designopt.explore.explorer import Explorer
    from designopt.optimize.parametric import ParametricDesign
    from studies.models.finger import Finger


def finger_parametric(finger: Finger, over: Ranges, **asked: Any) -> ParametricDesign:
    """A finger as named numbers; what is asked of it is as of `FingerParametric`.

    Raises:
        UserError: ranges of joints are given, which its body has.
    """
    from studies.models.finger_parametric.design import FingerParametric

    if over:
        raise UserError(
            f"--over {next(iter(over))}: the joints of a finger have the ranges of its body; "
            "change range_deg of [body]"
        )
    return FingerParametric(finger, **asked)


def finger_explorer(finger: Finger, **asked: Any) -> Explorer:
    """A finger to turn and to change; what is asked of it is as of `FingerParametric`."""
    from studies.finger.explorer import FingerExplorer
    from studies.models.finger_parametric.design import FingerParametric

    return FingerExplorer(FingerParametric(finger, **asked))


FINGER = DesignKind(
    "finger",
    "finger",
    read=lazily("studies.models.finger_file:read_finger"),
    explorer=finger_explorer,
    drawing=lazily("studies.finger.drawing:make_finger_drawing"),
    quantities=lazily("studies.finger.drawing:finger_quantities"),
    mjcf=lazily("studies.models.grasp.mjcf:grasp_mjcf"),
    parametric=finger_parametric,
    assembly=lazily("studies.models.manufacture.parts:make_assembly"),
    shared=("camera",),
)
