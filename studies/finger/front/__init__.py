"""Trade-offs of a finger: fronts of what is asked for against what it costs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from designopt.study.settings import setting
from designopt.study.study import Study, lazily
from studies.finger.spec import FingerSpec

Objective = Literal[
    "transmission", "clearance", "thickness", "resolution", "yield", "layers", "coverage"
]

VARIED = {
    "clearance": "clearances",
    "thickness": "thickness_changes",
    "resolution": "sharper",
    "layers": "thicker_layers",
}
"""Objectives that are settings, and the list with the values of each. The others are what the best
design with these settings has."""


class FingerFrontSpec(FingerSpec):
    """All settings of ``designopt front finger``: those of ``designopt run finger`` and its own."""

    objectives: list[Objective] = setting(
        ["transmission", "clearance"],
        "what is traded: one or two of "
        + ", ".join(VARIED)
        + ", which are varied, and one or two of transmission, yield, coverage, which follow",
        free=True,
        min_length=2,
        max_length=3,
    )
    clearances: list[Annotated[float, Field(ge=0, le=100)]] = setting(
        [0.25, 0.5, 0.75, 1.0, 1.25], "of moving parts of the linkage (mm)", free=True, min_length=1
    )
    thickness_changes: list[Annotated[float, Field(ge=-100, le=100)]] = setting(
        [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0], "changes of body.thickness (mm)", free=True, min_length=1
    )
    sharper: list[Annotated[float, Field(gt=0, le=10)]] = setting(
        [1.0, 1.05, 1.1, 1.15, 1.2],
        "least resolution, in parts of what the finger has without asking for more",
        free=True,
        min_length=1,
    )
    thicker_layers: list[Annotated[float, Field(gt=0, le=10)]] = setting(
        [0.5, 1.0, 1.5, 2.0, 2.5], "thickness of all layers, in parts", free=True, min_length=1
    )

    @model_validator(mode="after")
    def _varies_some_and_looks_at_others(self) -> FingerFrontSpec:
        if len(set(self.objectives)) < len(self.objectives):
            raise ValueError("objectives must differ from each other")
        varied = [one for one in self.objectives if one in VARIED]
        if len(varied) in (0, len(self.objectives)):
            raise ValueError(
                f"objectives {', '.join(self.objectives)}: name at least one of "
                f"{', '.join(VARIED)}, which are varied, and one of transmission, yield, coverage"
            )
        if "layers" in varied and not self.mirrors.pads.thickness:
            raise ValueError("objectives: layers of bare pads have no thickness; leave it out")
        return self

    def finger(self) -> FingerSpec:
        """The settings of ``designopt run finger`` among them."""
        return FingerSpec.model_validate(self.model_dump(include={*FingerSpec.model_fields}))


STUDY = Study(
    name="finger-front",
    purpose="Trade-offs of a finger, each point a finger with its file, by continuation",
    spec=FingerFrontSpec,
    run=lazily("studies.finger.front.run:run"),
    front_of="finger",
)
