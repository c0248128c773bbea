"""Paper A's chamber and camera (§II.A) as settings."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from designopt.io.spec import Spec

CLEARANCE = 1.5
"""How far |Δl_D| stays inside Δl_A where η is chosen, mm."""

# Beyond these no finger is built, and the study's sentences and figures lose their meaning.
Length = Annotated[float, Field(ge=1e-3, le=1e4)]
Offset = Annotated[float, Field(ge=-1e4, le=1e4)]


class ChamberSpec(Spec):
    """The chamber and the camera as printed. Lengths in mm."""

    length_ab: Length = Field(default=40.0, description="a, length of the red region (mm)")
    length_bc: Length = Field(default=30.0, description="b, length of the blue region (mm)")
    length_cd: Length = Field(default=30.0, description="c, length of the yellow region (mm)")
    offset_a: Length = Field(default=4.1, description="Δl_A, offset of the wall at the lens (mm)")
    offset_b: Offset = Field(default=2.0, description="Δl_B, wall offset where red meets blue (mm)")
    wall_angle_bc_deg: Annotated[float, Field(ge=0, le=89)] = Field(
        default=2.0, description="θ_BC, angle of the blue wall to the centre line (degrees)"
    )
    focal_length: Length = Field(default=4.0, description="f of the camera (mm)")
    image_distance: Length = Field(default=3.5, description="v of the camera (mm)")
