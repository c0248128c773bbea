"""The settings of the study; the targets belong to the default number of poses."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from designopt.io.spec import Spec

STATED_POSES = 1_000_000
"""The sweep of which the study's targets speak."""


class LinkagePrecisionSpec(Spec):
    """All settings of ``designopt run linkage-precision``."""

    poses: Annotated[int, Field(ge=10, le=4_000_000)] = Field(
        default=STATED_POSES, description="poses of the longest sweep, one turn of the crank"
    )
    repeats: Annotated[int, Field(ge=3, le=1000)] = Field(
        default=5, description="timed repeats of each setting"
    )
    linkage: Literal["all", "four-bar", "slider-crank", "six-bar"] = Field(
        default="all", description="which linkages: all of them, or one"
    )
    optimistix: bool = Field(default=True, description="measure Optimistix as well")
    gradients: bool = Field(default=True, description="measure gradients as well")
    float32: bool = Field(default=True, description="measure in float32 as well")
    peers: bool = Field(
        default=True, description="measure mechanism and pylinkage where they are installed"
    )
    first_call: bool = Field(
        default=True, description="time the first call of four-bar and finger in fresh processes"
    )
