"""The settings of the study; the targets belong to the default numbers of points and rays."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from designopt.io.spec import Spec

STATED_SAMPLES = 65536
STATED_RAYS = 4_000_000
"""The numbers of which the study's targets speak."""


class VisibilityPrecisionSpec(Spec):
    """All settings of ``designopt run visibility-precision``."""

    samples: Literal[64, 256, 1024, 4096, 16384, 65536] = Field(
        default=STATED_SAMPLES, description="most points or rays of a method; the least is 64"
    )
    reference_rays: Annotated[int, Field(ge=1000, le=20_000_000)] = Field(
        default=STATED_RAYS, description="rays of the reference"
    )
    repeats: Annotated[int, Field(ge=3, le=1000)] = Field(
        default=5, description="timed repeats of each setting"
    )
    flexion: bool = Field(default=True, description="measure a sweep of poses besides one pose")
    edge_refined: bool = Field(
        default=True, description="measure edge-refined rays, and the gallery's curved mirrors"
    )
    gallery: bool = Field(default=True, description="compare the scenes of the gallery")
    grid: bool = Field(default=True, description="time the finger over a grid of poses")
    tracers: bool = Field(default=True, description="compare ray tracers")
    peers: bool = Field(
        default=True, description="measure optiland and rayoptics where they are installed"
    )
    left_out: bool = Field(default=True, description="count operations left out")
