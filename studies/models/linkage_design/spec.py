"""The settings of the study; defaults are paper B's requirements as this project reads them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from designopt.io.spec import Spec
from studies.models.body import BodySpec

Positive = Annotated[float, Field(gt=0, le=1e3)]


class LimitsSpec(Spec):
    """What every posture must leave. Lengths in mm."""

    clearance: Annotated[float, Field(ge=0, le=100)] = Field(
        default=2.0, description="pin axes to the faces and ends of their phalanx (mm)"
    )
    spacing: Positive = Field(default=6.0, description="least distance of two pins on a link (mm)")
    crank_offset: Positive = Field(
        default=8.0,
        description="least |AF| (mm); near 0 the crank becomes coaxial with the PIP joint",
    )
    crank_length: Positive = Field(default=22.0, description="greatest |EF| (mm)")
    crank_range_deg: Annotated[float, Field(gt=0, le=180)] = Field(
        default=150.0,
        description="greatest turn of the crank (degrees); 100 for a motor parallelogram, whose "
        "transmission angle is the crank's angle",
    )
    assembly: Positive = Field(
        default=1.0, description="least distance of a dyad from stretching or folding (mm)"
    )
    turn: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.01, description="least turn of crank and plate per turn of a joint"
    )
    force_ratio: Annotated[float, Field(gt=0, le=10)] | None = Field(
        default=None, description="greatest φ₂/φ₁, which decides whether a pinch holds; any if none"
    )
    transmission_deg: Annotated[float, Field(gt=0, lt=90)] = Field(
        default=40.0, description="least transmission angle that is required (degrees)"
    )


class SensorSpec(Spec):
    """The room beside the sensing pads, in which the links lie. Lengths in mm."""

    finger_width: Positive = Field(default=34.0, description="width of the finger (mm)")
    pad_width: Positive = Field(default=24.0, description="width kept free for the pads (mm)")
    link_thickness: Positive = Field(default=2.0, description="thickness of a link (mm)")


class SearchSpec(Spec):
    """How the optimum is searched."""

    starts: Annotated[int, Field(ge=1, le=256)] = Field(
        default=16, description="local solves, from the most promising Sobol points"
    )
    among: Annotated[int, Field(ge=1, le=2**20)] = Field(
        default=16384, description="Sobol points looked at"
    )
    step_deg: Annotated[float, Field(ge=1, le=45)] = Field(
        default=15.0, description="step of the postures of the first solve (degrees)"
    )
    exchanges: Annotated[int, Field(ge=0, le=20)] = Field(
        default=4, description="most further solves, each with the worst postures in between added"
    )
    finalists: Annotated[int, Field(ge=1, le=64)] = Field(
        default=4, description="different optima of the first solve that are solved on"
    )
    allowance: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.02,
        description="kept beyond every length that is required, for what lies between the "
        "postures and for rounding the dimensions (mm)",
    )
    rounding: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.01, description="dimensions are multiples of it (mm)"
    )


class LinkageSpec(Spec):
    """What `design_linkage` needs to know besides the body."""

    limits: LimitsSpec = LimitsSpec()
    sensor: SensorSpec = SensorSpec()
    search: SearchSpec = SearchSpec()
    tolerance: Annotated[float, Field(ge=0, le=10)] = Field(
        default=0.1, description="error of every coordinate of a pin, 1 σ (mm)"
    )
    draws: Annotated[int, Field(ge=10, le=1_000_000)] = Field(
        default=2000, description="draws of the tolerance study"
    )


class FingerLinkageSpec(LinkageSpec):
    """All settings of ``designopt run finger-linkage``."""

    body: BodySpec = BodySpec()
    precision: bool = Field(default=True, description="measure error against run time")
    evolution_seconds: Annotated[float, Field(gt=0, le=3600)] = Field(
        default=20.0, description="time given to differential evolution, the yardstick (s)"
    )

    @model_validator(mode="after")
    def _room_for_pins(self) -> FingerLinkageSpec:
        room = self.body.thickness - 2 * self.limits.clearance - 2 * self.search.allowance
        if room <= 0:
            raise ValueError(
                f"thickness ({self.body.thickness:g} mm) leaves no room between pins that keep "
                f"limits.clearance ({self.limits.clearance:g} mm) from both faces"
            )
        return self
