"""The settings of the study."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from designopt.io.spec import Spec


class StabilitySpec(Spec):
    """All settings of ``designopt run visibility-stability``."""

    scenes: Annotated[int, Field(ge=10, le=100_000)] = Field(
        default=10_000, description="random scenes"
    )
    bounces: Annotated[int, Field(ge=1, le=2)] = Field(
        default=2, description="most reflections of a path; random scenes are asked with 1 to this"
    )
    rays: Annotated[int, Field(ge=1000, le=1_000_000)] = Field(
        default=20_000, description="brute-force rays in each random scene"
    )
    fine_rays: Annotated[int, Field(ge=100_000, le=100_000_000)] = Field(
        default=4_000_000, description="rays in a scene that differs, and in the sample"
    )
    reference_scenes: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=40, description="sample of random scenes that get the fine rays in any case"
    )
    gradient_scenes: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=125, description="random scenes whose gradients meet central differences"
    )
    family_cases: Annotated[int, Field(ge=8, le=500)] = Field(
        default=24, description="scenes in each extreme family"
    )
    float32: bool = Field(default=True, description="ask everything in float32 as well")
