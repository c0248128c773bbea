"""Settings that the studies on images of the finger share."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from designopt.io.spec import Spec
from designopt.study.settings import distinct, setting
from studies.models.mirror_design.spec import Error, Length, ToleranceSpec

LEAST_ROWS, MOST_ROWS = 200, 4000
"""Heights of images that can be analysed, px."""

WIDTH = 24.0
"""Of the pads across the section, as in paper B, mm."""

Rows = Annotated[int, Field(ge=LEAST_ROWS, le=MOST_ROWS)]


class MadeSpec(ToleranceSpec):
    """Errors of a finger as it is made: those of its assembly, of its pads, and of its lens.

    Those of layers and of a moving entrance pupil count where the finger has them.
    """

    pad_position: Error = Field(
        default=0.1, description="each pad, along its normal and along itself (mm)"
    )
    pad_tilt_deg: Error = Field(default=0.2, description="each pad, about its middle (degrees)")
    lens_k1: Annotated[float, Field(gt=0, le=0.01)] = Field(
        default=0.003, description="lens: r over theta + k1 theta^3, the field of view kept"
    )
    camera_yaw_deg: Error = setting(0.5, "camera, out of the section (degrees)")
    camera_roll_deg: Error = setting(0.5, "camera, about its axis (degrees)")
    mirror_lean_deg: Error = setting(0.5, "each mirror, out of the section (degrees)")
    mirror_bow: Error = setting(0.05, "each mirror's middle, out of the line of its ends (mm)")
    pad_lean_deg: Error = setting(0.2, "each pad, out of the section (degrees)")
    layer_thickness: Error = setting(0.05, "each layer on a pad (mm)")
    layer_index: Error = setting(0.003, "each layer's index of refraction")
    pupil_shift: Error = setting(0.1, "entrance pupil, where it moves (mm per squared radian)")
    lateral_color: Error = setting(5e-4, "image's scale in red and in blue, over that in green")


class FingerImagesSpec(Spec):
    """What is rendered."""

    scene: str = setting("", "file of the finger, or of its scene; the bare finger by default")
    width: Length = setting(WIDTH, "of the pads, as in paper B (mm)")
    severity: float = setting(
        1.0, "of light, blur, noise, rough edges: 0 none, 1 good, 2 poor", ge=0, le=2
    )
    range_deg: float = setting(90.0, "range of both joints (degrees)", gt=0, le=90)
    sizes: Annotated[list[Rows], AfterValidator(distinct)] = setting(
        [360, 540, 810, 1080], "heights of images, error over run time (px)", free=True
    )
    tolerances: MadeSpec = MadeSpec()
