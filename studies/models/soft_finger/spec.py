"""Settings that the studies on the soft finger share: its chamber, its camera, and its images."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from designopt import Spec, setting

CLEARANCE = 1.5
"""How far |Δl_D| stays inside Δl_A where η is chosen, mm."""

# Beyond these no finger is built, and the study's sentences and figures lose their meaning.
Length = Annotated[float, Field(ge=1e-3, le=1e4)]
Severity = Annotated[float, Field(ge=0, le=2)]

WIDEST_DEG = 80.0
"""Widest field of view, with all distortions that are allowed, whose rays are all followed."""


class ChamberSpec(Spec):
    """The chamber and the camera as printed in paper A (§II.A). Lengths in mm."""

    length_ab: Length = setting(40.0, "a, length of the red region (mm)")
    length_bc: Length = setting(30.0, "b, length of the blue region (mm)")
    length_cd: Length = setting(30.0, "c, length of the yellow region (mm)")
    offset_a: Length = setting(4.1, "Δl_A, offset of the wall at the lens (mm)")
    offset_b: float = setting(2.0, "Δl_B, wall offset where red meets blue (mm)", ge=-1e4, le=1e4)
    wall_angle_bc_deg: float = setting(
        2.0, "θ_BC, angle of the blue wall to the centre line (degrees)", ge=0, le=89
    )
    focal_length: Length = setting(4.0, "f of the camera (mm)")
    image_distance: Length = setting(3.5, "v of the camera (mm)")


class EndoscopeSpec(Spec):
    """The camera; the paper gives its pixels, 640 × 480, and no angle."""

    field_of_view_deg: float = setting(
        60.0, "angle between opposite corners of the image (degrees)", ge=30, le=WIDEST_DEG
    )
    distortion: float = setting(
        -0.1, "k1 of r (1 + k1 r²), r the tangent of the angle to the axis", ge=-0.2, le=0.2
    )


class MadeSpec(Spec):
    """Standard deviations of a finger and its camera as they are made."""

    length: float = setting(0.3, "of each region's length (mm)", ge=0, le=2)
    offset: float = setting(0.15, "of each of the wall's offsets (mm)", ge=0, le=1)
    field_of_view_deg: float = setting(0.5, "of the camera's field of view (degrees)", ge=0, le=5)


class ChamberImagesSpec(Spec):
    """What is rendered."""

    chamber: ChamberSpec = ChamberSpec()
    eta: float = setting(0.6, "yellow ring over blue ring; the paper chooses 0.6", ge=0.3, le=1.2)
    endoscope: EndoscopeSpec = EndoscopeSpec()
    severity: Severity = setting(1.0, "of light, shake, blur and noise: 0 none, 1 good, 2 poor")
