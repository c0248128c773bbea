"""The settings of the study; defaults are paper A's chamber (§II.A)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PositiveFloat, model_validator

from designopt.io.spec import Spec
from studies.models.soft_finger.chamber_spec import CLEARANCE, ChamberSpec


class Table1Spec(Spec):
    """All settings of ``designopt run table1``."""

    chamber: ChamberSpec = ChamberSpec()
    clearance: PositiveFloat = Field(
        default=CLEARANCE, description="how far |Δl_D| must stay inside Δl_A when η is chosen (mm)"
    )
    f_number: Annotated[float, Field(ge=0.1, le=1000)] = Field(
        default=2.8, description="f-number of the real lens set beside Eq. 1; the paper gives none"
    )
    blur: Annotated[float, Field(ge=1e-6, le=10)] = Field(
        default=0.003,
        description="blur spot that counts as sharp, about a pixel of an endoscope (mm)",
    )
    precision: bool = Field(default=True, description="measure error against run time")
    precision_problems: Annotated[int, Field(ge=1, le=10_000_000)] = Field(
        default=100_000, description="problems in a batch of the run-time study"
    )
    precision_repeats: Annotated[int, Field(ge=3, le=1000)] = Field(
        default=5, description="timed repeats of each setting"
    )
    stability: bool = Field(default=True, description="run the stiff and extreme cases")

    @model_validator(mode="after")
    def _clearance_leaves_room(self) -> Table1Spec:
        if self.clearance >= self.chamber.offset_a:
            raise ValueError(
                f"clearance ({self.clearance:g} mm) must be smaller than chamber.offset_a "
                f"({self.chamber.offset_a:g} mm), or no Δl_D is left"
            )
        return self
