"""Settings that the studies on images of the soft finger share."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from designopt.io.spec import Spec
from studies.models.soft_finger.chamber_spec import ChamberSpec

Severity = Annotated[float, Field(ge=0, le=2)]


WIDEST_DEG = 80.0
"""Widest field of view, with all distortions that are allowed, whose rays are all followed."""


class EndoscopeSpec(Spec):
    """The camera; the paper gives its pixels, 640 × 480, and no angle."""

    field_of_view_deg: Annotated[float, Field(ge=30, le=WIDEST_DEG)] = Field(
        default=60.0, description="angle between opposite corners of the image (degrees)"
    )
    distortion: Annotated[float, Field(ge=-0.2, le=0.2)] = Field(
        default=-0.1, description="k1 of r (1 + k1 r²), r the tangent of the angle to the axis"
    )


class MadeSpec(Spec):
    """Standard deviations of a finger and its camera as they are made."""

    length: Annotated[float, Field(ge=0, le=2)] = Field(
        default=0.3, description="of each region's length (mm)"
    )
    offset: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.15, description="of each of the wall's offsets (mm)"
    )
    field_of_view_deg: Annotated[float, Field(ge=0, le=5)] = Field(
        default=0.5, description="of the camera's field of view (degrees)"
    )


class ChamberImagesSpec(Spec):
    """What is rendered."""

    chamber: ChamberSpec = ChamberSpec()
    eta: Annotated[float, Field(ge=0.3, le=1.2)] = Field(
        default=0.6, description="yellow ring over blue ring; the paper chooses 0.6"
    )
    endoscope: EndoscopeSpec = EndoscopeSpec()
    severity: Severity = Field(
        default=1.0, description="of light, shake, blur and noise: 0 none, 1 good, 2 poor"
    )
