"""The designed finger as a MuJoCo model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kinematics.io.reading import build_linkage
from kinematics.io.sketch import InputTable, SpringTable
from studies.models.grasp.mjcf import MOTOR, grasp_mjcf

if TYPE_CHECKING:
    from studies.finger.design import DesignedFinger


def finger_mjcf(design: DesignedFinger) -> str:
    """The text of a MuJoCo model of the designed finger, straight and driven by its crank.

    Raises:
        UserError: the crank and the spring cannot be in its linkage.
    """
    spring = design.spec.spring
    by_crank = {
        "inputs": [
            InputTable(name=MOTOR, body="crank"),
            InputTable(name="gamma", body="plate", relative_to="distal"),
        ],
        "springs": [
            SpringTable(
                between=("distal", "plate"), stiffness=spring.stiffness, preload=spring.preload
            )
        ],
    }
    sketch = design.linkage.sketch.model_copy(update=by_crank)
    return grasp_mjcf(build_linkage(sketch, design.name), design.spec.body, spring.servo)
