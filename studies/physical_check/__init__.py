"""What the library predicts of images, beside what an independent path tracer sees."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import AfterValidator

from designopt import Spec, Study, lazily, setting
from designopt.study.settings import distinct

LayersName = Literal[
    "none", "1 mm", "2 mm", "3 mm", "3+2 mm", "3 mm clear", "3 mm clear, overhang",
    "3 mm bevelled", "3+2 mm overhang", "3 mm bezel",
]  # fmt: skip

LAYERS: list[LayersName] = list(get_args(LayersName))


class PhysicalCheckSpec(Spec):
    """All settings of ``designopt run physical-check``."""

    fingers: int = setting(
        3, "random fingers beside the designed one and a thin one", scales=True, ge=0, le=100
    )
    postures: int = setting(
        7, "random postures of each finger under all kinds of layers", scales=True, ge=1, le=1000
    )
    layers: Annotated[list[LayersName], AfterValidator(distinct)] = setting(
        LAYERS, "kinds of clear layers on the pads", min_length=1
    )
    cache: str = setting(
        "", "folder that keeps judged frames (empty: the user's cache folder)", free=True
    )


STUDY = Study(
    name="physical-check",
    purpose="Predicted corners, views and coverage of layered pads beside those of a path tracer",
    spec=PhysicalCheckSpec,
    run=lazily("studies.physical_check.run:run"),
    needs=("judge",),
)
