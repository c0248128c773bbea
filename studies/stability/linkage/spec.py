"""The settings of the study."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from designopt.io.spec import Spec


class StabilitySpec(Spec):
    """All settings of ``designopt run linkage-stability``."""

    random_cases: Annotated[int, Field(ge=100, le=2_000_000)] = Field(
        default=100_000, description="random four-bars, and as many random slider-cranks"
    )
    decades: Annotated[float, Field(ge=0.1, le=6)] = Field(
        default=2.0, description="decades over which the lengths of random linkages spread"
    )
    family_cases: Annotated[int, Field(ge=16, le=2000, multiple_of=2)] = Field(
        default=40, description="cases in each extreme family; half of them in each assembly"
    )
    triad: bool = Field(
        default=True, description="follow a Stephenson six-bar through large steps of its input"
    )
