"""The settings of the study."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from studies.models.soft_finger.spec import ChamberImagesSpec, MadeSpec, Severity, distinct

Frames = Annotated[int, Field(ge=0, le=200)]
Sagitta = Annotated[float, Field(gt=0, le=6)]
Roughness = Annotated[float, Field(gt=0, le=1)]


class SurfaceProfileSpec(ChamberImagesSpec):
    """All settings of ``designopt run surface-profile``."""

    made: MadeSpec = MadeSpec()
    trials: Annotated[int, Field(ge=1, le=2000)] = Field(
        default=50, description="surfaces of each of the four kinds"
    )
    fingers: Annotated[int, Field(ge=1, le=100)] = Field(
        default=5,
        description="fingers with errors of fabrication, which share the surfaces; at most trials",
    )
    slide: Annotated[float, Field(ge=40, le=200)] = Field(
        default=60.0, description="length of a slide (mm)"
    )
    frames: Annotated[int, Field(ge=15, le=500)] = Field(
        default=41, description="frames of a slide, evenly over it"
    )
    contact: Annotated[float, Field(ge=50, le=100)] = Field(
        default=90.0, description="where along the finger it touches (mm)"
    )
    tip_radius: Annotated[float, Field(ge=0.5, le=15)] = Field(
        default=5.0, description="of the pad that touches, in the direction of the slide (mm)"
    )
    preload: Annotated[float, Field(ge=0.5, le=5)] = Field(
        default=3.0, description="deflection of the finger at the surface's lowest place (mm)"
    )
    pressed: Annotated[float, Field(ge=0, le=2)] = Field(
        default=0.5, description="how deep the wall is pressed in where it touches (mm)"
    )
    pressed_more: Annotated[float, Field(ge=0, le=0.2)] = Field(
        default=0.05, description="and how much deeper for every mm of deflection"
    )
    direction_scatter_deg: Annotated[float, Field(ge=0, le=10)] = Field(
        default=1.5,
        description="standard deviation of the bending direction, slide to slide (degrees)",
    )
    rest_frames: Annotated[int, Field(ge=2, le=200)] = Field(
        default=20, description="frames of every finger before it touches anything"
    )
    calibration: Annotated[int, Field(ge=0, le=200)] = Field(
        default=17, description="frames on a flat plate at known heights, for every finger"
    )
    setting_error: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.05, description="standard deviation of the plate's height (mm)"
    )
    calibrations: Annotated[list[Frames], AfterValidator(distinct)] = Field(
        default=[0, 1, 2, 3, 5, 9, 17, 33],
        description="other numbers of frames to calibrate with, for the error over them",
    )
    severities: Annotated[list[Severity], AfterValidator(distinct)] = Field(
        default=[0.0, 0.5, 1.5, 2.0], description="other severities, with one finger"
    )
    severity_trials: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=3, description="surfaces of each kind at each of these"
    )
    sagittas: Annotated[list[Sagitta], AfterValidator(distinct)] = Field(
        default=[0.4, 0.8, 1.0, 1.1, 1.2, 1.3, 1.4, 1.8, 2.4],
        description="of curved surfaces, through the limit from which on they are called so (mm)",
    )
    roughnesses: Annotated[list[Roughness], AfterValidator(distinct)] = Field(
        default=[0.05, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2, 0.3, 0.4],
        description="of rough surfaces, likewise; root mean square (mm)",
    )
    size_slides: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=12, description="surfaces of each of these sizes"
    )
