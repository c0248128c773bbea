"""Settings that the studies on images of the finger share."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from designopt.io.spec import Spec
from studies.models.mirror_design.spec import Error, Length, ToleranceSpec


class MadeSpec(ToleranceSpec):
    """Errors of a finger as it is made: those of its assembly, of its pads, and of its lens."""

    pad_position: Error = Field(
        default=0.1, description="each pad, along its normal and along itself (mm)"
    )
    pad_tilt_deg: Error = Field(default=0.2, description="each pad, about its middle (degrees)")
    lens_k1: Annotated[float, Field(gt=0, le=0.01)] = Field(
        default=0.003, description="lens: r over theta + k1 theta^3, the field of view kept"
    )


class FingerImagesSpec(Spec):
    """What is rendered."""

    scene: str = Field(
        default="",
        description="file of the finger, or of its scene; the packaged finger by default",
    )
    width: Length = Field(default=24.0, description="of the pads, as in paper B (mm)")
    severity: Annotated[float, Field(ge=0, le=2)] = Field(
        default=1.0, description="of light, blur, noise, rough edges: 0 none, 1 good, 2 poor"
    )
    tolerances: MadeSpec = MadeSpec()
