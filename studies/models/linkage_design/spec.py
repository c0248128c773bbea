"""The settings of the study; defaults are paper B's requirements as this project reads them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from designopt.io.spec import Spec
from designopt.study.settings import setting
from studies.models.body import BodySpec
from studies.models.body import Length as Positive


class LimitsSpec(Spec):
    """What every posture must leave. Lengths in mm."""

    clearance: float = setting(
        2.0, "pin axes to the faces and ends of their phalanx (mm)", ge=0, le=100
    )
    spacing: Positive = setting(6.0, "least distance of two pins on a link (mm)")
    crank_offset: Positive = setting(8.0, "least |AF| (mm); at 0 the crank turns about PIP")
    crank_length: Positive = setting(22.0, "greatest |EF| (mm)")
    crank_range_deg: float = setting(
        150.0,
        "greatest turn of the crank (degrees); 100 for a motor parallelogram, whose transmission "
        "angle is the crank's angle",
        gt=0,
        le=180,
    )
    assembly: Positive = setting(1.0, "least distance of a dyad from stretching or folding (mm)")
    turn: float = setting(0.01, "least turn of crank and plate per turn of a joint", gt=0, le=1)
    force_ratio: Annotated[float, Field(gt=0, le=10)] | None = setting(
        None, "greatest φ₂/φ₁, which decides whether a pinch holds; any if none"
    )
    transmission_deg: float = setting(40.0, "least transmission angle (degrees)", gt=0, lt=90)


class SensorSpec(Spec):
    """The room beside the sensing pads, in which the links lie. Lengths in mm."""

    finger_width: Positive = setting(34.0, "width of the finger (mm)")
    pad_width: Positive = setting(24.0, "width kept free for the pads (mm)")
    link_thickness: Positive = setting(2.0, "thickness of a link (mm)")


class SearchSpec(Spec):
    """How the optimum is searched."""

    starts: int = setting(16, "local solves, from the most promising Sobol points", ge=1, le=256)
    among: int = setting(16384, "Sobol points looked at", ge=1, le=2**20)
    step_deg: float = setting(15.0, "step of the first solve's postures (degrees)", ge=1, le=45)
    exchanges: int = setting(4, "most further solves, with the worst postures added", ge=0, le=20)
    finalists: int = setting(4, "different optima of the first solve, solved on", ge=1, le=64)
    allowance: float = setting(
        0.02, "kept beyond every length, for rounding and between postures (mm)", ge=0, le=1
    )
    rounding: float = setting(0.01, "dimensions are multiples of it (mm)", gt=0, le=1)


class LinkageSpec(Spec):
    """What `design_linkage` is given besides the body.

    Targets are what the settings require, so they apply whatever these are.
    """

    limits: LimitsSpec = setting(LimitsSpec(), "what every posture must leave", free=True)
    sensor: SensorSpec = setting(SensorSpec(), "the room beside the pads", free=True)
    search: SearchSpec = setting(SearchSpec(), "how the optimum is searched", free=True)
    tolerance: float = setting(
        0.1, "error of every coordinate of a pin, 1 σ (mm)", free=True, ge=0, le=10
    )
    draws: int = setting(2000, "draws of the tolerance study", free=True, ge=10, le=1_000_000)


class FingerLinkageSpec(LinkageSpec):
    """All settings of ``designopt run finger-linkage``."""

    body: BodySpec = setting(BodySpec(), "the phalanges", free=True)
    precision: bool = setting(True, "measure error against run time", free=True)
    evolution_seconds: float = setting(
        20.0, "time given to differential evolution, the yardstick (s)", scales=True, gt=0, le=3600
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
